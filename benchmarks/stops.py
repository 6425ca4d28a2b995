"""Stops of moving robots: time and distance until the hand rests, at each level."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from benchmarks.lab.outcome import Figure, Outcome, table
from benchmarks.lab.setting import Setting
from hqp import Braking
from hqp.arrays import Vec
from tests.scenes.following import DT, Loop

ROBOTS = ("ur5", "ur10", "panda", "g1", "talos")
STANDING = ("g1", "talos")
LEVELS = ("velocity", "acceleration", "torque")
BRAKING = Braking()

RESTS = 0.01
"""Speed of the hand below which it counts as at rest [m/s]."""

MOVING, AFTER = 200, 1000
"""Ticks before the stop at most, and after it."""

SETTLED = 0.5
"""Time at the end of a hold in which the hand must rest [s]."""

SEEDS = 5


@dataclass
class Stop:
    """Stop at the fastest moment of a motion: speeds at its beginning, time and distance to rest."""

    hand: float
    """Speed of the hand at the stop [m/s]."""
    joint: float
    """Speed of the fastest motor at the stop [rad/s]."""
    time: float
    """Time until the hand is below ``RESTS`` and stays so [s]."""
    distance: float
    """Largest distance of the hand from its place at the stop [m]."""
    drift: float
    """Displacement of the hand in the last 0.5 s [m]."""


def stop(name: str, level: str, seed: int) -> Stop:
    """Stop a robot where its hand is fastest on the way to a drawn target."""
    before = _loop(name, level, seed)
    fastest = int(np.argmax(_speeds(_places(before, MOVING)))) + 1
    loop = _loop(name, level, seed)
    places = _places(loop, fastest)
    hand, joint = _speeds(places)[-1], np.abs(loop.v[loop.motors]).max()
    loop.session.stop("benchmark")
    after = np.vstack((places[-1:], _places(loop, AFTER)))
    moving = np.flatnonzero(_speeds(after) > RESTS)
    away = np.linalg.norm(after - after[0], axis=1)
    drift = np.linalg.norm(after[-round(SETTLED / DT) :] - after[-1], axis=1).max()
    time = DT * (moving[-1] + 1) if moving.size else 0.0
    return Stop(float(hand), float(joint), float(time), float(away.max()), float(drift))


def _loop(name: str, level: str, seed: int) -> Loop:
    return Loop(name, level, seed, braking=BRAKING, exact=integrated(name, level))


def integrated(name: str, level: str) -> bool:
    """Return true for a free base at acceleration level: no torque of MuJoCo's motors is that command."""
    return level == "acceleration" and name in STANDING


def _places(loop: Loop, ticks: int) -> Vec:
    places = []
    for _ in range(ticks):
        loop.step()
        places.append(loop.place())
    return np.array(places)


def _speeds(places: Vec) -> Vec:
    """Speeds between consecutive places [m/s]."""
    return np.asarray(np.linalg.norm(np.diff(places, axis=0), axis=1) / DT)


def experiment(setting: Setting) -> Outcome:
    """All robots at all levels."""
    outcome = Outcome("stops")
    outcome.parameters = {
        "deceleration [rad/s^2]": BRAKING.deceleration, "damping [s]": BRAKING.damping, "period [s]": DT,
        "seeds": SEEDS, "at rest [m/s]": RESTS,
    }  # fmt: skip
    rows: list[tuple[str, ...]] = []
    runs: dict[tuple[str, str], list[Stop]] = {}
    for name in ROBOTS:
        for level in LEVELS:
            found = [stop(name, level, seed) for seed in range(SEEDS if setting.full else 1)]
            setting.advance()
            runs[name, level] = found
            rows.append((
                name, level, "integrated" if integrated(name, level) else "MuJoCo",
                _both([s.hand for s in found], "{:.2f}"), _both([s.joint for s in found], "{:.1f}"),
                _both([1e3 * s.time for s in found], "{:.0f}"), _both([1e3 * s.distance for s in found], "{:.0f}"),
                f"{1e3 * max(s.drift for s in found):.2f}", CATEGORY,
            ))  # fmt: skip
    every = [s for found in runs.values() for s in found]
    arms = [s for (name, _), found in runs.items() if name not in STANDING for s in found]
    outcome.figures = [
        Figure("stops", len(every)),
        Figure("stops that end at rest", sum(s.time < AFTER * DT - SETTLED for s in every), low=len(every)),
        Figure("arms move in the last 0.5 s of a hold by", 1e3 * max(s.drift for s in arms), "mm", high=0.1),
        Figure("standing robots too", 1e3 * max(s.drift for s in every), "mm", high=5.0),
        Figure(
            "acceleration, integrated: time over (fastest motor / deceleration)",
            max(s.time * BRAKING.deceleration / s.joint for name in STANDING for s in runs[name, "acceleration"]),
            high=1.1,
        ),
        Figure(
            "torque: distance over (speed of the hand x damping)",
            max(s.distance / (s.hand * BRAKING.damping) for name in ROBOTS for s in runs[name, "torque"]),
            high=1.1,
        ),
    ]  # fmt: skip
    header = (
        "robot", "level", "plant", "hand at the stop [m/s]", "fastest motor [rad/s]", "time to rest [ms]",
        "distance [mm]", "moves in the hold [mm]", "category",
    )  # fmt: skip
    outcome.tables.append(table("Time and distance to rest, median / largest", header, rows))
    return outcome


CATEGORY = "2"
"""Stop category of IEC 60204-1: the motors keep their power in the stop and after it, at every level."""


def _both(numbers: list[float], text: str) -> str:
    return " / ".join(text.format(x) for x in (float(np.median(numbers)), max(numbers)))
