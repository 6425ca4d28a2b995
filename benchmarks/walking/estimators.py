"""Errors of FeetEstimator and of an invariant filter on equal readings of a walk."""

from __future__ import annotations

import math
from typing import Any

import numpy as np

from benchmarks.walking.course import SETTLE, Course, heading
from benchmarks.walking.invariant import InvariantFilter
from hqp.walking.course import LEAST

SLIPPERY = 0.2
"""mu under the right foot of slippery walks."""


def slippery(walker_soles: tuple[str, ...], robot: Any, friction: float = SLIPPERY) -> Any:
    """An edit of the plant: mu under the last of these soles."""
    joint = robot.model.names[robot.model.frames[robot.frame(walker_soles[-1])].parentJoint]

    def edit(spec: Any) -> None:
        body = next(b for b in spec.bodies if any(j.name == joint for j in b.joints))
        for geom in body.find_all("geom"):
            geom.friction, geom.priority = [friction, 0.005, 1e-4], 2

    return edit


def one_walk(robot: str, speed: float, slips: bool, seed: int, seconds: float = 8.0) -> dict[str, float]:
    """Errors of both: largest of place [mm] and heading [deg], root mean square of velocity [mm/s]."""
    import hqp.robots

    about = hqp.robots.load(robot, rotors=True)
    edit = slippery(about.landmarks["soles"], about) if slips else None
    course = Course(robot, seed, edit=edit, robot=about)
    walker, inner = course.walker, course.course
    soles = [foot.frame for foot in walker.feet]
    other = InvariantFilter(about, soles, walker.dt, walker.start, least_load=LEAST * about.mass)
    estimator = inner.estimator
    assert estimator is not None
    usual, off = estimator.update, {"feet": [], "invariant": []}  # type: ignore[var-annotated]
    told = 0

    def both(*reading: Any) -> Any:
        nonlocal told
        q, v = course.plant.state()
        found = usual(*reading)
        told += any(estimator.slipping)
        for name, (at, rate) in (("feet", found), ("invariant", other.update(*reading))):
            turned = math.remainder(heading(at) - heading(q), math.tau)
            off[name].append([*(at[:3] - q[:3]), *(rate[:3] - v[:3]), turned])
        return found

    estimator.update = both  # type: ignore[method-assign]
    course.run(SETTLE)
    walker.go(speed)
    course.run(seconds)
    figures = {"fell": course.fell, "told": told * walker.dt}
    for name, rows in off.items():
        e = np.array(rows)
        figures |= {
            f"{name}_mm": 1e3 * float(np.linalg.norm(e[:, :3], axis=1).max()),
            f"{name}_mm_s": 1e3 * float(np.sqrt(np.mean(np.sum(e[:, 3:6] ** 2, axis=1)))),
            f"{name}_deg": math.degrees(float(np.abs(e[:, 6]).max())),
        }
    return figures


if __name__ == "__main__":
    for slips in (False, True):
        print("mu 0.2 under the right foot" if slips else "mu 0.5", one_walk("g1", 0.2, slips, 0))
