"""Bipeds of the catalogue that walk from their model data alone, and the reasons of those that do not."""

from __future__ import annotations

import math
from collections.abc import Mapping, Sequence
from typing import Any

import numpy as np

from benchmarks.lab.outcome import Table, table
from hqp.errors import DeclarationError, ModelError

SPEED = 0.05
"""Speed of each robot as a share of sqrt(g height), which scales with its size."""

RUNS = 4
"""Runs of each robot: masses 10 % above and below, two offsets of encoders each."""

SECONDS = 8.0
"""Duration of walking before a stop [s]."""


def bipeds() -> tuple[str, ...]:
    """Names of the catalogue with a free base and two soles; the first name of each robot."""
    import hqp.robots
    from hqp.walking.feet import feet_of

    found: dict[Any, str] = {}
    for name in hqp.robots.names():
        robot = hqp.robots.load(name)
        try:
            feet_of(robot)
        except (DeclarationError, ModelError):
            continue
        found.setdefault((robot.nv, round(robot.mass, 6)), name)
    return tuple(found.values())


def stature(name: str) -> dict[str, Any]:
    """Data of a robot's model: size, test speed, joint with the largest share of its torque limit on one foot."""
    import hqp.robots
    from hqp.walking import Walker
    from hqp.walking.stance import Stance, borne

    robot = hqp.robots.load(name, rotors=True)
    walker = Walker(robot)
    stance, bears = Stance(robot, walker.feet), np.zeros(len(robot.joint_names))
    for foot in walker.feet:
        q = stance.on((foot,), 1.0 - walker.height / stance.height)
        if q is not None:
            bears = np.maximum(bears, borne(robot, foot, q))
    low, high = (f(np.array(walker.feet[0].corners), axis=0) for f in (np.min, np.max))
    return {
        "mass": robot.mass, "height": walker.height, "asked": speed_of(walker), "sole": (high - low).tolist(),
        "bears": float(bears.max()), "bearer": robot.joint_names[int(bears.argmax())],
    }  # fmt: skip


def speed_of(walker: Any) -> float:
    """Test speed [m/s]."""
    return SPEED * math.sqrt(9.81 * walker.height)


def one_robot(robot: str, seed: int) -> dict[str, Any]:
    """Figures of one walk, a case of a sweep."""
    from benchmarks.walking.course import SETTLE, STOP, Course

    course = Course(robot, seed)
    walker, own = course.walker, course.robot
    limit = own.effort_limit[own.actuated]
    start, bound, ticks = course.plant.com(), np.zeros(len(limit)), 0

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
        walker.go(speed_of(walker))
        run(SECONDS)
    moved, lasted = course.plant.com() - start, course.plant.time
    if math.isnan(course.fell):
        walker.stop()
        run(STOP)
    longest = int(np.argmax(bound))
    return {
        **course.figures(), "walked": float(moved[0]) / max(lasted - SETTLE, walker.dt), "aside": float(moved[1]),
        "stood": stood, "bound": float(bound[longest]) / max(ticks, 1), "binds": own.joint_names[longest],
    }  # fmt: skip


KEPT = "seed", "fell", "walked", "aside", "bound", "binds", "optimal"


def found(rows: Sequence[Mapping[str, Any]]) -> dict[str, Any]:
    """Data of the table, by robot."""
    names = dict.fromkeys(row["robot"] for row in rows)
    return {n: {**stature(n), "runs": [{k: r[k] for k in KEPT} for r in rows if r["robot"] == n]} for n in names}


def lines(by_robot: Mapping[str, Any]) -> Table:
    """Rows of the table."""
    return table("Bipeds by nothing but their own data", HEADER, [_line(n, one) for n, one in by_robot.items()])


def _line(name: str, one: Mapping[str, Any]) -> tuple[str, ...]:
    """Row of a robot."""
    rows, (length, width) = one["runs"], one["sole"]
    fell = [row for row in rows if row["fell"] is not None and math.isfinite(row["fell"])]
    walked = [row["walked"] for row in rows if row not in fell]
    when = "".join(f", {row['fell']:.1f} s" for row in fell)
    most = max(rows, key=lambda row: float(row["bound"]))
    return (
        name,
        f"{one['mass']:.0f}",
        f"{one['height']:.2f}",
        f"{1e3 * length:.0f} x {1e3 * width:.0f}",
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
