"""Cells of the walking statistics: a robot, a speed, a disturbance."""

from __future__ import annotations

import math
from collections.abc import Mapping
from dataclasses import dataclass
from typing import Any

import numpy as np

from benchmarks.walking.course import DT, FRICTION, MASSES, SETTLE, STOP, Course
from hqp.robots.on_mujoco import Plane, Ramp, Servo, Step, Tiles


@dataclass(frozen=True, kw_only=True)
class Cell:
    """Walk of ``seconds`` at a velocity; a stand of 20 s if ``seconds`` is 0.

    push: impulse over mass, sideways, at an instant of a step that differs from run to run [m/s].  ground: flat, ramp
    (10 degrees), step (30 mm) or tiles (+-20 mm).  friction: mu.  masses: share above or below the
    model's.  servo: kp of position servos in place of torque motors [N m/rad], 0 for torques.
    feels: true if the feet have force sensors.  falls: most falls of 20 runs; None without a limit.
    """

    robot: str
    forward: float = 0.0
    left: float = 0.0
    turn: float = 0.0
    seconds: float = 10.0
    push: float = 0.0
    ground: str = "flat"
    friction: float = FRICTION
    masses: float = MASSES
    servo: float = 0.0
    feels: bool = True
    falls: int | None = None


PUSHED = 0.1
"""Duration of a push [s]."""

SPEEDS = {"talos": (0.3, 0.6), "g1": (0.2, 0.5), "cbi": (0.15, 0.25)}
"""Speeds with a limit of falls and without one [m/s]."""

PUSHES = {"talos": 0.2, "g1": 0.13, "cbi": 0.13}
HALVES = {"talos": 0.3, "g1": 0.25}
"""Speeds at which grounds, masses and turns are tried [m/s]."""

SERVOS = 100.0, 500.0
OTHERS = {"icub": 0.1, "romeo": 0.15, "talos_full_v2": 0.3, "g1_29dof_with_hand_rev_1_0": 0.2}


def cells() -> Mapping[str, Cell]:
    """Every cell by name."""
    found: dict[str, Cell] = {}
    for robot, (asked, more) in SPEEDS.items():
        found[f"{robot}, stands 20 s"] = Cell(robot=robot, seconds=0.0, falls=0)
        found[f"{robot}, {asked:g} m/s"] = Cell(robot=robot, forward=asked, falls=1)
        found[f"{robot}, {more:g} m/s"] = Cell(robot=robot, forward=more)
        push = PUSHES[robot]
        found[f"{robot}, 0.1 m/s, pushed {push:g} m/s"] = Cell(robot=robot, forward=0.1, push=push, falls=1)
        found[f"{robot}, back, aside and turning"] = Cell(robot=robot, forward=-0.1, left=0.05, turn=0.1)
        found[f"{robot}, 0.1 m/s up 10 degrees"] = Cell(robot=robot, forward=0.1, ground="ramp", falls=2)
        found[f"{robot}, 0.1 m/s, tiles +-20 mm"] = Cell(robot=robot, forward=0.1, ground="tiles", falls=2)
    for robot, half in HALVES.items():
        found[f"{robot}, {half:g} m/s, two circles"] = Cell(robot=robot, forward=half, turn=0.3, seconds=42.0, falls=1)
        found[f"{robot}, {half:g} m/s, mu 0.3"] = Cell(robot=robot, forward=half, friction=0.3, falls=1)
        found[f"{robot}, {half:g} m/s, a step of 30 mm"] = Cell(robot=robot, forward=half, ground="step", falls=1)
        found[f"{robot}, {half:g} m/s, masses +-20 %"] = Cell(robot=robot, forward=half, masses=0.2, falls=1)
    found["g1 without force sensors, 0.2 m/s"] = Cell(robot="g1", forward=0.2, feels=False)
    for stiff in SERVOS:
        found[f"g1 on servos of {stiff:g} N m/rad, 0.2 m/s"] = Cell(robot="g1", forward=0.2, servo=stiff)
    for robot, speed in OTHERS.items():
        found[f"{robot}, {speed:g} m/s"] = Cell(robot=robot, forward=speed)
    return found


def one_run(cell: str, seed: int) -> dict[str, Any]:
    """Figures of one run; a case of a sweep."""
    declared = cells()[cell]
    ground: Any = None
    if declared.ground == "ramp":
        ground = Ramp(friction=declared.friction, angle=math.radians(10.0))
    elif declared.ground == "step":
        ground = Step(friction=declared.friction, rise=0.03)
    elif declared.ground == "tiles":
        ground = Tiles(friction=declared.friction, seed=seed)
    else:
        ground = Plane(friction=declared.friction)
    servo = Servo(other=declared.servo, damping_time=0.03) if declared.servo else None
    height = 0.02 if declared.ground == "tiles" else 0.0
    kept = {"terrain": ground, "height": height, "servo": servo, "feels": declared.feels}
    course = Course(declared.robot, seed, masses=declared.masses, **kept)
    start = course.plant.com()
    if declared.seconds == 0.0:
        course.run(20.0)
        return {**course.figures(), "walked": 0.0, "aside": 0.0}
    if course.run(SETTLE):
        start = course.plant.com()
        course.walker.go(declared.forward, declared.left, declared.turn)
        before = 3.0 + 1.5 * np.random.default_rng(seed).uniform() if declared.push else 0.0
        course.run(before)
        if declared.push:
            force = declared.push * course.mass / PUSHED * (1 - 2 * (seed // 2 % 2))
            course.run(PUSHED, push=[0.0, force, 0.0])
        course.run(declared.seconds - before)
    moved = course.plant.com() - start
    if math.isnan(course.fell):
        course.walker.stop()
        course.run(STOP)
    lasted = course.plant.time - SETTLE - DT
    return {**course.figures(), "walked": float(moved[0]), "aside": float(moved[1]), "lasted": lasted}
