"""Results of the comparison with rivals: speed, and how each behaves in every scene."""

from __future__ import annotations

import json
from dataclasses import asdict, dataclass
from typing import Any

import numpy as np

from hqp.arrays import Mat, Vec
from hqp.lab.behaviour import Behaviour
from hqp.lab.measures import reversals
from hqp.markdown import table


@dataclass(frozen=True)
class Line:
    """A library in a scene.

    jump: largest change of a joint's speed in a tick [rad/s]; rate: its p99 over the period [rad/s^2].  off: largest
    distance from a target at the end [m].  drift: motion of a contact, at most [m, rad].  over, over_end: a joint's
    range, at most and at the end [rad].  speeding: a joint's speed limit [rad/s].  failed: ticks without a usable
    answer, in which the robot stood still.
    """

    library: str
    scene: str
    p50_us: float
    p99_us: float
    max_us: float
    jump: float
    rate: float
    reversals: float
    off: float
    drift: float
    over: float
    over_end: float
    speeding: float
    ticks: int
    failed: int
    said: str

    @classmethod
    def refused(cls, library: str, scene: str, said: str) -> Line:
        """A scene that a library does not take."""
        nan = float("nan")
        return cls(library, scene, nan, nan, nan, nan, nan, nan, nan, nan, nan, nan, nan, 0, 0, said)


LEGEND = (
    "jump: largest change of a joint's speed in a tick [rad/s]; rate: p99 of that change over the period [rad/s²]; "
    "reversals a second, worst joint; off: farthest target at the end; drift: of a contact, at most; over range, over "
    "speed: largest excess over a joint's limits [rad, rad/s]; no answer: ticks that raised or answered NaN, in which "
    "the robot stood still; said: what the library said. Targets carry no velocity, gains are the same for all."
)


def line(
    library: str, scene: str, wall: Vec, commands: Mat, judged: Behaviour, dt: float, failed: int, said: str
) -> Line:
    """The figures of a run: wall ``(k,)`` [us], commands ``(k, joints)`` [rad/s]."""
    change = np.abs(np.diff(commands, axis=0)).max(axis=1, initial=0.0)
    p50, p99 = np.percentile(wall, (50, 99))
    return Line(
        library, scene, float(p50), float(p99), float(wall.max()), float(change.max()),
        float(np.percentile(change, 99)) / dt, reversals(commands, dt), float(np.max(judged.errors[-1], initial=0.0)),
        float(judged.drift.max()), float(judged.over.max()), float(judged.over[-1]), float(judged.speeding.max()),
        len(wall), failed, said,
    )  # fmt: skip


@dataclass(frozen=True)
class RivalTable:
    """Lines by library and scene; ``markdown()`` is the text of the README, ``json()`` has all data."""

    manifest: dict[str, Any]
    lines: tuple[Line, ...]

    def __getitem__(self, key: tuple[str, str]) -> Line:
        """The line of a library in a scene."""
        return next(one for one in self.lines if (one.library, one.scene) == key)

    @property
    def libraries(self) -> tuple[str, ...]:
        """In order."""
        return tuple(dict.fromkeys(one.library for one in self.lines))

    @property
    def scenes(self) -> tuple[str, ...]:
        """In order."""
        return tuple(dict.fromkeys(one.scene for one in self.lines))

    def speed(self) -> tuple[tuple[str, ...], tuple[tuple[str, ...], ...]]:
        """Header and body: times of the first scene, and how many times ours they are."""
        first = [one for one in self.lines if one.scene == self.scenes[0]]
        ours = first[0].p50_us
        body = tuple(
            (one.library, f"{one.p50_us:.0f}", f"{one.p99_us:.0f}", f"{one.max_us:.0f}", f"{one.p50_us / ours:.1f}")
            for one in first
        )
        return ("library", "p50 us", "p99", "max", "times hqp"), body

    def behaviour(self) -> tuple[tuple[str, ...], tuple[tuple[str, ...], ...]]:
        """Header and body: every scene and library."""
        header = (
            "scene", "library", "p50 us", "jump", "rate p99", "reversals", "off mm", "drift mm", "over range",
            "at the end", "over speed", "no answer", "said",
        )  # fmt: skip
        body = []
        for scene in self.scenes:
            for one in (each for each in self.lines if each.scene == scene):
                if not one.ticks:
                    body.append((scene, one.library, *("",) * 10, one.said))
                    continue
                body.append((
                    scene, one.library, f"{one.p50_us:.0f}", f"{one.jump:.2g}", f"{one.rate:.3g}",
                    f"{one.reversals:.0f}",
                    f"{1e3 * one.off:.2g}", f"{1e3 * one.drift:.2g}", _small(one.over), _small(one.over_end),
                    _small(one.speeding),
                    f"{100.0 * one.failed / one.ticks:.0f} %" if one.failed else "", one.said[:70],
                ))  # fmt: skip
        return header, tuple(body)

    def markdown(self) -> str:
        """Both tables, with method and machine."""
        m = self.manifest
        stack = m["stack"].replace("|", "\\|").replace("\n", "  \n")
        scenes = "\n".join(f"- *{name}*: {text}" for name, text in m["scenes"].items())
        rivals = ", ".join(" ".join(text for text in listed) for listed in m["rivals"].values())
        return (
            f"{stack}\n\non {m['robot']}, {m['seconds']:g} s at {1e3 * m['dt']:g} ms, carried out exactly\n\n"
            f"{table(*self.speed())}\n\n{table(*self.behaviour())}\n\n{LEGEND}\n\n{scenes}\n\n"
            f"{m['machine']['processor']}, one thread; hqp {m['hqp']} {m['commit'][:10]}; {rivals}; {m['made']}\n"
        )

    def json(self) -> str:
        """Everything, with the manifest."""
        return json.dumps({"manifest": self.manifest, "lines": [asdict(one) for one in self.lines]}, indent=2)

    def __str__(self) -> str:
        from hqp.lab.result import as_text

        return as_text("", (self.speed(), self.behaviour()), (LEGEND,), width=400)


def _small(value: float) -> str:
    return "0" if value < 1e-6 else f"{value:.1g}"
