"""Which bipeds of the catalogue walk, by nothing but their own data, and why others do not."""

from __future__ import annotations

import math
from collections.abc import Mapping, Sequence
from typing import Any

import numpy as np

from benchmarks.lab.outcome import Table, table
from hqp.errors import DeclarationError, ModelError

SPEED = 0.05
"""Asked of each robot, a share of sqrt(g height): as fast for the small as for the tall."""

RUNS = 4
"""Of each: masses 10 % above and below, two offsets of encoders each."""

SECONDS = 8.0
"""Of walking, before a stop."""


def bipeds() -> tuple[tuple[str, ...], Mapping[str, str]]:
    """Names of robots with a free base and two soles, once each, and why others with legs are left out."""
    import hqp.robots
    from hqp.walking.feet import feet_of

    found: dict[Any, str] = {}
    refused: dict[str, str] = {}
    for name in hqp.robots.names():
        robot = hqp.robots.load(name)
        if not robot.floating:
            continue
        try:
            feet_of(robot)
        except (DeclarationError, ModelError) as error:
            if len(robot.landmarks.get("soles", ())) == 2:
                refused[name] = str(error)
            continue
        found.setdefault((robot.nv, round(robot.mass, 6), len(robot.geometry.geometryObjects)), name)
    return tuple(found.values()), refused


def one_robot(robot: str, seed: int) -> dict[str, Any]:
    """Figures of one walk; a case of a sweep."""
    from benchmarks.walking.course import SETTLE, STOP, Course
    from hqp.walking.standing import borne

    course = Course(robot, seed)
    walker = course.walker
    speed = SPEED * math.sqrt(9.81 * walker.height)
    own = walker.robot
    share = np.max([borne(own, foot, walker.start) for foot in walker.feet], axis=0)
    start, limit, bound, ticks = course.plant.com(), own.effort_limit[own.actuated], np.zeros(len(share)), 0

    def run(seconds: float) -> bool:
        nonlocal bound, ticks
        for _ in range(round(seconds / walker.dt)):
            if not course.run(walker.dt):
                return False
            bound += np.abs(course.tick.command) > 0.999 * limit
            ticks += 1
        return True

    stood = run(SETTLE)
    if stood:
        start = course.plant.com()
        walker.go(speed)
        run(SECONDS)
    moved, lasted = course.plant.com() - start, course.plant.time
    if math.isnan(course.fell):
        walker.stop()
        run(STOP)
    worst, bounds = int(np.argmax(share)), int(np.argmax(bound))
    return {
        **course.figures(), "height": walker.height, "mass": own.mass, "asked": speed,
        "walked": float(moved[0]) / max(lasted - SETTLE, walker.dt), "aside": float(moved[1]), "stood": stood,
        "length": float(np.ptp([x for x, _ in walker.feet[0].corners])),
        "width": float(np.ptp([y for _, y in walker.feet[0].corners])),
        "bears": float(share[worst]), "bearer": own.joint_names[worst],
        "bound": float(bound[bounds]) / max(ticks, 1), "binds": own.joint_names[bounds],
    }  # fmt: skip


def lines(found: Mapping[str, Any]) -> Table:
    """The lines for people."""
    return table(
        "Bipeds by nothing but their own data", HEADER, [_line(n, rows) for n, rows in found["robots"].items()]
    )


def _line(name: str, rows: Sequence[Mapping[str, Any]]) -> tuple[str, ...]:
    """A robot's."""
    one = rows[0]
    fell = [row for row in rows if row["fell"] is not None and math.isfinite(row["fell"])]
    walked = [row["walked"] for row in rows if row not in fell]
    when = "".join(f", {row['fell']:.1f} s" for row in fell)
    most = max(rows, key=lambda row: float(row["bound"]))
    return (
        name,
        f"{one['mass']:.0f}",
        f"{one['height']:.2f}",
        f"{1e3 * one['length']:.0f} x {1e3 * one['width']:.0f}",
        f"{one['asked']:.2f}",
        f"{np.median(walked):.2f}" if walked else "",
        f"{len(fell)} of {len(rows)}{when}",
        f"{one['bearer']} {100.0 * one['bears']:.0f} %",
        f"{most['binds']} {100.0 * most['bound']:.1f} %" if most["bound"] > 0.0 else "",
        f"{100.0 * min(row['optimal'] for row in rows):.2f} %",
    )


HEADER = (
    "robot", "mass [kg]", "CoM [m]", "sole [mm]", "asked [m/s]", "walked", "falls",
    "bears most on one foot", "longest at its limit", "OPTIMAL",
)  # fmt: skip
