"""Motion of the operator's hand from its packets: a cubic through the latest of them, without impossible packets."""

from __future__ import annotations

import math
from dataclasses import dataclass
from typing import Any

import numpy as np

from hqp.arrays import Mask, Mat, Vec

from .spaces import Space

WINDOW = 0.3
"""Packets of so long ago count for nothing, those of now most [s]."""

PRIOR = np.array([0.0, 1.0 / 2e3, 1.0 / 1e4, 1.0 / 3e5]) ** 2
"""Squares of a packet's error over an ordinary speed, acceleration and jerk: 1 mm over 2 m/s, 10 m/s^2, 300 m/s^3."""

ABRUPT = 100.0, 500.0
"""Acceleration of a hand beyond its present one [m/s^2, rad/s^2]."""

SLACK = 0.02, 0.2
"""Allowed error of a packet in any case [m, rad]."""

AGREEING = 3
"""Number of packets in a row that make a new track."""


@dataclass(frozen=True, slots=True)
class Sample:
    """A packet that was taken: its time on the sender's clock [s], and its value."""

    time: float
    value: Any


class Cubic:
    """Pose of a hand at a time: value ⊕ (x + v tau + a tau^2 / 2 + j tau^3 / 6), tau the time since the latest packet.

    Least squares over the packets of the last 0.3 s, whose weights fall from 1 to 0, and over an ordinary speed,
    acceleration and jerk: with one packet the hand stands, with two it moves.  No average, which would lag.
    """

    def __init__(self, space: Space, samples: list[Sample]) -> None:
        samples, latest = recent(samples), samples[-1]
        self.time, self.value = latest.time, latest.value
        tau = np.array([s.time - latest.time for s in samples])
        away = np.array([space.minus(s.value, latest.value) for s in samples])
        powers = np.stack((np.ones_like(tau), tau, tau**2 / 2.0, tau**3 / 6.0))
        weighted = powers * (1.0 + tau / WINDOW)
        normal: Mat = weighted @ powers.T + np.diag(PRIOR)
        self.motion = np.linalg.solve(normal, weighted @ away)

    def after(self, tau: float) -> tuple[Vec, Vec, Vec]:
        """x, v, a ``(k,)`` each, ``tau`` [s] after the latest packet."""
        half = 0.5 * tau * tau
        powers = np.array(((1.0, tau, half, tau * half / 3.0), (0.0, 1.0, tau, half), (0.0, 0.0, 1.0, tau)))
        x, v, a = powers @ self.motion
        return x, v, a

    def at(self, tau: float, rest: float) -> tuple[Vec, Vec, Vec]:
        """Pose of a hand that comes to rest by ``rest`` [s], from half of that on."""
        begin = 0.5 * rest
        if tau <= begin:
            return self.after(tau)
        x, v, _ = self.after(begin)
        u = min(tau / begin - 1.0, 1.0)
        return (
            x + begin * u * (1.0 - u * u * (1.0 - 0.5 * u)) * v,
            (1.0 - u * u * (3.0 - 2.0 * u)) * v,
            -6.0 * u * (1.0 - u) / begin * v,
        )


class Track:
    """Packets that agree with each other, and the hand's motion through them.

    A packet that is farther from the motion than a hand can get begins a rival track, as the first one does.  The rival
    is accepted once three of its packets agree for as long as the reference would take to get there, at ``speeds``
    [m/s, rad/s].
    """

    def __init__(self, space: Space, speeds: tuple[float, float]) -> None:
        self._space, self._speeds = space, speeds
        self._samples: list[Sample] = []
        self._rival: list[Sample] = []
        self._agreed, self._since = 0, 0.0
        self.motion: Cubic | None = None

    def forget(self) -> None:
        """Nothing is known of the hand."""
        self._samples, self._rival, self.motion = [], [], None

    def take(self, one: Sample) -> float:
        """Take a packet newer than those before; return its distance [m or rad] if it was rejected, else 0."""
        rival = self._rival
        with_rival = bool(rival) and self._off(Cubic(self._space, rival), one)[1] == 0.0
        far = off = 0.0
        if self.motion is not None:
            far, off = self._off(self.motion, one)
            if off == 0.0 and not with_rival:
                self._add(one)
                return 0.0
        if not with_rival:
            rival, self._agreed, self._since = [], 0, one.time
        self._rival, self._agreed = recent([*rival, one]), self._agreed + 1
        if self._agreed < AGREEING or one.time - self._since < far:
            return off
        self._samples = self._rival[:-1]
        self._add(one)
        return 0.0

    def _add(self, one: Sample) -> None:
        self._rival = []
        self._samples = recent([*self._samples, one])
        self.motion = Cubic(self._space, self._samples)

    def _off(self, motion: Cubic, one: Sample) -> tuple[float, float]:
        """The time that the reference would take to get to a packet [s]; its distance from the reachable motion of the
        hand [m or rad], 0 inside it."""
        tau = one.time - motion.time
        off = self._space.minus(one.value, self._space.plus(motion.value, motion.at(tau, WINDOW)[0]))
        turns, time, wrong = self._space.turns(off.size), 0.0, 0.0
        for rows, abrupt, slack, speed in zip((~turns, turns), ABRUPT, SLACK, self._speeds, strict=True):
            far = length(off, rows)
            time = max(time, far / speed)
            if far > slack + 0.5 * abrupt * tau * tau:
                wrong = max(wrong, far)
        return time, wrong


def recent(samples: list[Sample]) -> list[Sample]:
    """The samples at most ``WINDOW`` [s] older than the latest one, which is the last."""
    return [s for s in samples if samples[-1].time - s.time < WINDOW]


def length(vector: Vec, rows: Mask) -> float:
    """Norm of some rows."""
    part = vector[rows]
    return math.sqrt(float(part @ part))
