"""Variants of the way up the slope: other normals, speeds, rates and ground; and misreadings of the paper."""

from __future__ import annotations

import math
from collections.abc import Mapping
from dataclasses import replace

import hqp
from benchmarks.lab.outcome import Figure, Table, holds, number, table
from benchmarks.sentis2012.experiments.cases import Case
from benchmarks.sentis2012.experiments.compliance import Compliance, stack
from benchmarks.sentis2012.experiments.human import Walk
from benchmarks.sentis2012.experiments.measures import Measures
from benchmarks.sentis2012.experiments.scene import Scene
from hqp.errors import DeclarationError
from tests.scenes.sentis2012 import EXACT

NAMES = {"dreamer": "ball wheels", "dreamer_rollers": "rollers"}

PULL = Walk(speed=0.33, distance=0.95)
"""Walk of the human; the robot, on a spring, reaches 0.35 m/s."""

IMU_ONLY = Compliance(normals="base", carried=(0.4, 40.0), com_acceleration=3.0, wrench="observed", assist=0.2)
"""Gravity compensation of a share of the weight by the tilt.  A momentum observer estimates the human's pull, and the
wheels add a fifth of it, which reduces its peak while the front wheel alone is on the slope."""

IMU_WALK = Walk(speed=0.30, distance=1.1)
"""Longer walk, because the spring stretches under its share of the robot's weight."""

TOO_MUCH = replace(IMU_ONLY, carried=(0.0, 0.0), wrench="none", assist=0.0)
"""Full gravity compensation by the tilt alone."""

MAPPED = Compliance(normals="map")
"""Full gravity compensation with normals from the robot's own map: IMU and wheel encoders, no force sensor."""

FELT = Compliance(normals="felt")
"""Full gravity compensation by the tilt and by the ground's push, from a momentum observer: no force sensor, no map."""

ONE = replace(
    FELT, limits=True, com_acceleration=math.inf, least_load=90.0, torso=1.0, payload="observed", bandwidth=100.0,
    felt=(0.01, 200.0, 1.0), released=20.0, own_weight=True,
)  # fmt: skip
"""One controller for every duty, on the robot's own sensing: felt ground; torque limits, joint range and friction
cones in place of the cap; least loads of the wheels; a torso that turns towards the pull; an estimated payload.

On 10 degrees the estimate of the ground's push must follow within 20 ms: compensation for a slope that the rear wheels
have left pushes the base back by 130 N, and the front wheel leaves the ground.  The estimate must also last while that
wheel is unloaded."""

SENSED = Case(
    name="own map of heights, rollers", scene=Scene(plant="dreamer_rollers", walk=PULL), choice=MAPPED
)  # fmt: skip
"""Main case: rollers, on the robot's own sensing."""


def variants(full: bool) -> list[Case]:
    """IMU only; in full, also the own map in other scenes, other speeds, control rate, flat ground and plateau."""
    rollers = Scene(plant="dreamer_rollers", walk=PULL)
    imu = [
        Case(
            name="IMU only, rollers",
            scene=replace(rollers, walk=IMU_WALK, seconds=None),
            choice=IMU_ONLY,
        ),
    ]
    if not full:
        return imu
    return [
        *imu,
        Case(name="IMU only, ball wheels", scene=Scene(walk=IMU_WALK), choice=IMU_ONLY),
        Case(name="IMU only, full compensation, rollers", scene=rollers, choice=TOO_MUCH),
        Case(name="own map of heights, ball wheels", scene=Scene(walk=PULL), choice=MAPPED),
        Case(
            name="own map of heights, onto a plateau, rollers",
            scene=replace(rollers, top=0.06, walk=replace(PULL, distance=1.5)),
            choice=MAPPED,
        ),
        Case(name="0.2 m/s, ball wheels", scene=Scene(walk=replace(PULL, speed=0.19))),
        Case(name="0.2 m/s, rollers", scene=replace(rollers, walk=replace(PULL, speed=0.19))),
        Case(name="0.12 m/s, ball wheels", scene=Scene(walk=replace(PULL, speed=0.115))),
        Case(name="1 kHz, ball wheels", scene=Scene(walk=PULL), choice=Compliance(period=0.001)),
        Case(name="1 kHz, rollers", scene=rollers, choice=Compliance(period=0.001)),
        Case(name="flat, ball wheels", scene=Scene(slope=0.0, walk=PULL)),
        Case(name="flat, rollers", scene=replace(rollers, slope=0.0)),
        Case(name="onto a plateau, rollers", scene=replace(rollers, top=0.06, walk=replace(PULL, distance=1.5))),
        Case(name="projector, rollers", scene=rollers, solver="nullspace"),
    ]


def variant_figures(m: Mapping[str, Measures], full: bool) -> list[Figure]:
    """Figures of the variants with their limits."""
    figures = []
    for name, r in m.items():
        reduced, mapped = name.startswith("IMU only") and "full" not in name, name.startswith("own map")
        if not reduced and not mapped:
            continue
        up, back, travel, pull = ("8.2", "7.5", "0.956", "54") if reduced else ("", "", "", "")
        figures += [
            Figure(f"{name}: CoM error, way up", r.com_up, "mm", high=10.0, before=up),
            Figure(f"{name}: CoM error, way back", r.com_back, "mm", high=10.0, before=back),
            Figure(f"{name}: travel", r.travel, "m", low=0.9, before=travel),
            Figure(f"{name}: pull, max", r.pull, "N", high=60.0, before=pull),
        ]
    if not full:
        return figures
    fell = m["IMU only, full compensation, rollers"].fell
    figures.append(holds("IMU only with full gravity compensation falls on the way back", fell > PULL.turn))
    for plant in NAMES.values():
        slow, fast = m[f"0.2 m/s, {plant}"], m[f"1 kHz, {plant}"]
        before = "2.1" if plant == "rollers" else "1.9"
        figures += [
            Figure(f"0.2 m/s, {plant}: speed", slow.speed, "m/s", 0.18, 0.22),
            Figure(f"0.2 m/s, {plant}: CoM error", slow.com, "mm", high=2.5, before=before),
            Figure(f"1 kHz, {plant}: CoM error", fast.com, "mm", high=6.0, before="4.8"),
        ]
    careful = m["0.12 m/s, ball wheels"]
    figures += [
        Figure("0.12 m/s: speed", careful.speed, "m/s", 0.11, 0.13),
        Figure("0.12 m/s: CoM error", careful.com, "mm", before="1.2"),
        Figure(
            f"0.12 m/s: joint speed over its limit, max ({careful.rate_joint})",
            careful.rate_ratio,
            high=1.0,
            before="0.78",
        ),
        Figure("0.12 m/s: torque over its limit, max", careful.torque_ratio, high=1.0),
    ]
    return figures


def negatives(full: bool) -> list[Case]:
    """Cases of misreadings of the paper."""
    short = replace(PULL, back=False)
    scene = Scene(walk=short)
    cases = [Case(name="absolute Jacobians", scene=scene, choice=Compliance(absolute_jacobians=True))]
    if not full:
        return cases
    start = Scene(out_of_place=1.0, walk=replace(short, distance=0.3))
    uncapped = Compliance(com_acceleration=math.inf)
    return [
        *cases,
        Case(name="absolute damping", scene=scene, choice=Compliance(absolute_damping=True)),
        Case(name="CoM goal at the axles' height", scene=scene, choice=Compliance(goal_at_axles=True)),
        Case(name="no gyro", scene=scene, choice=Compliance(gyro=False)),
        Case(name="vertical normals", scene=scene, choice=Compliance(normals="vertical")),
        Case(name="contact normals in all rows", scene=scene, choice=Compliance(normals="contact in all")),
        Case(name="no CoM offset", scene=scene, choice=Compliance(com_goal=(0.0, 0.0))),
        Case(name="start out of place, CoM task unsaturated", scene=start, choice=uncapped),
        Case(name="start out of place, CoM task saturated", scene=start),
    ]


def refusal(choice: Compliance) -> str:
    """Error text of a stack that the library refuses to compile, empty if it compiles."""
    try:
        hqp.Controller(stack(choice), hqp.Torque(loop_law=EXACT), price=0).session(
            hqp.robots.load("dreamer"), choice.period
        )
    except DeclarationError as error:
        return str(error)
    return ""


def negative_figures(m: Mapping[str, Measures]) -> list[Figure]:
    """Figures of the mistakes: each fails in its own way."""
    figures = [holds("absolute Jacobians: falls", math.isfinite(m["absolute Jacobians"].fell), before="0.7 s of pull")]
    if len(m) == 1:
        return figures
    figures += [
        Figure("absolute damping: CoM error", m["absolute damping"].com_up, "mm", low=25.0, before="39"),
        Figure("goal at the axles: CoM error", m["CoM goal at the axles' height"].com_up, "mm", 11.0, 18.0, "14.4"),
        Figure("no gyro: CoM error", m["no gyro"].com_up, "mm", low=10.0, before="14.3"),
        Figure("vertical normals: gets no further than", m["vertical normals"].travel, "m", high=0.8, before="0.52"),
        holds("contact normals in all rows: falls", math.isfinite(m["contact normals in all rows"].fell)),
        Figure("no CoM offset: CoM error", m["no CoM offset"].com_up, "mm", low=25.0, before="38"),
        Figure("no CoM offset: posture error", m["no CoM offset"].posture, "deg", low=40.0, before="70"),
        holds(
            "start out of place, CoM task unsaturated: falls",
            math.isfinite(m["start out of place, CoM task unsaturated"].fell),
            before="0.6 s",
        ),
        holds(
            "start out of place, CoM task saturated: falls",
            math.isfinite(m["start out of place, CoM task saturated"].fell),
            wanted=False,
        ),
    ]
    return figures


def variant_table(m: Mapping[str, Measures]) -> Table:
    header = ("run", "outcome", "CoM up / back [mm]", "travel [m]", "speed [m/s]", "pull [N]", "hand [mm]", "tick [us]")
    rows = [
        (
            name,
            "stands" if math.isnan(r.fell) else f"falls at {r.fell:.1f} s",
            f"{number(r.com_up)} / {number(r.com_back)}",
            number(r.travel),
            number(r.speed),
            number(r.pull),
            number(r.hand_pulled),
            f"{r.tick_us:.0f}",
        )
        for name, r in m.items()
    ]
    return table("Variants", header, rows)
