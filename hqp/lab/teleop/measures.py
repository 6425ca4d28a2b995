"""Quality of teleoperation: from states, speeds and failures alone, the same for every library."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from hqp.arrays import Mask, Mat, Vec

STILL, FAR, LONG = 1e-9, 0.01, 0.1
"""A robot none of whose joints moves by more [rad/s] while its hand is farther off [m], for so long [s], is frozen."""

HIGH = 3.0
"""An operator's hand has next to nothing above this frequency [Hz]."""

LONGEST = 0.3
"""Lags are looked for up to this [s]."""


@dataclass(frozen=True)
class Felt:
    """A library in a scene.

    jerk: RMS of the worst joint [rad/s^3].  lag [ms]: delay of the hand behind the operator's; NaN where that makes no
    motion to compare.  frozen: share of ticks without an answer, or in which the robot stands still for 0.1 s or longer
    while its hand is 1 cm off.  high: share of the power of joint accelerations above 3 Hz.  jump: largest change of a
    joint's speed in a tick [rad/s].  off: distance at the end [m].
    """

    library: str
    scene: str
    jerk: float
    lag: float
    frozen: float
    high: float
    jump: float
    off: float
    said: str = ""


def felt(
    library: str, scene: str, speeds: Mat, hand: Mat, operator: Mat, failed: Mask, dt: float, said: str = ""
) -> Felt:
    """speeds ``(n, joints)`` [rad/s], hand and operator ``(n, 3)`` [m], failed ``(n,)``."""
    change = np.diff(speeds, axis=0)
    jerk = np.diff(change, axis=0) / dt**2
    away = np.linalg.norm(hand - operator, axis=1)
    frozen = failed | long((np.abs(speeds).max(axis=1) < STILL) & (away > FAR), round(LONG / dt))
    return Felt(
        library, scene, float(np.sqrt(np.mean(jerk**2, axis=0)).max()), lag(hand, operator, dt),
        float(frozen.mean()), power_above(change / dt, dt), float(np.abs(change).max()), float(away[-1]), said,
    )  # fmt: skip


def long(found: Mask, least: int) -> Mask:
    """Mask of the entries in a run of at least that length."""
    edges = np.flatnonzero(np.diff(np.concatenate(([False], found, [False]))))
    kept = np.zeros_like(found)
    for begin, end in zip(edges[::2], edges[1::2], strict=True):
        kept[begin:end] = end - begin >= least
    return kept


def refused(library: str, scene: str, said: str) -> Felt:
    """A scene that a library does not take."""
    nan = float("nan")
    return Felt(library, scene, nan, nan, nan, nan, nan, nan, said)


def lag(hand: Mat, operator: Mat, dt: float) -> float:
    """The delay at which the operator's way fits the hand's best [ms]; negative where the hand is ahead."""
    most = round(LONGEST / dt)
    inner = slice(most, len(hand) - most)
    shifts = np.arange(-most, most + 1)
    misfits = np.array([
        np.mean(np.sum((hand[inner] - operator[most - s : len(hand) - most - s]) ** 2, axis=1)) for s in shifts.tolist()
    ])  # fmt: skip
    i = int(misfits.argmin())
    if i in (0, len(misfits) - 1):
        return float("nan")
    before, at, after = misfits[i - 1 : i + 2]
    curve = before - 2.0 * at + after
    return float(1e3 * dt * (shifts[i] + (0.5 * (before - after) / curve if curve > 0.0 else 0.0)))


def power_above(signals: Mat, dt: float) -> float:
    """Share of the power of signals ``(n, k)`` above 3 Hz."""
    power: Vec = np.sum(np.abs(np.fft.rfft(signals, axis=0)) ** 2, axis=1)
    high = power[np.fft.rfftfreq(len(signals), dt) > HIGH]
    return float(high.sum() / max(power.sum(), 1e-300))
