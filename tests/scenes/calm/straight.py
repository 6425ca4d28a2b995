"""Nearly straight arms with a target on their line: only the bend gives the direction to it."""

from __future__ import annotations

import math
import tempfile
from collections.abc import Iterator, Sequence
from functools import cache
from pathlib import Path
from typing import Any

import numpy as np

import hqp
from hqp import PD, Level, P, Stack, markdown
from hqp.arrays import Vec
from hqp.declare.law import Law
from hqp.robots import Robot
from hqp.tasks import JointLimits, Position, Posture, TorqueLimits
from tests.scenes.calm.scenes import FORMULATIONS
from tests.scenes.calm.variants import Variant

AXES = {2: "zz", 3: "zzz", 6: "zyyxyx", 7: "zyxyxyx"}
"""Axes of the joints from the base on; the arm lies along x."""

BENDS = (1e-2, 1e-3, 1e-4)
"""Angle of every joint that turns across the arm, with alternating signs [rad]."""

DISTANCES = (0.6, 0.9)
"""Distance of the target from the base along the arm, in arm lengths; the tip is at 1."""

GAINS = (5.0, 1.0)
"""Gains of hand and posture [1/s]."""

DT, LONGEST, WITHIN = 0.002, 15.0, 1e-3
"""Period [s], time allowed [s], distance that counts as arrived [m]."""

Record = dict[str, Any]


@cache
def arm(joints: int) -> Robot:
    """An arm of one metre, straight along x at zero; links of 1 kg, motors of 200 N m."""
    length = 1.0 / joints
    link = f'<geom type="capsule" fromto="0 0 0 {length} 0 0" size=".03" mass="1"/>'
    body = f'<body name="tip" pos="{length} 0 0"><geom size=".02" mass=".1"/></body>'
    for k, axis in reversed(list(enumerate(AXES[joints]))):
        turn = " ".join(str(int(axis == a)) for a in "xyz")
        joint = f'<joint name="j{k}" axis="{turn}" range="-3 3" armature=".01"/>'
        body = f'<body pos="{length if k else 0.0} 0 0">{joint}{link}{body}</body>'
    motors = "".join(f'<motor joint="j{k}" ctrlrange="-200 200"/>' for k in range(joints))
    text = f'<mujoco><compiler angle="radian"/><worldbody>{body}</worldbody><actuator>{motors}</actuator></mujoco>'
    with tempfile.TemporaryDirectory() as folder:
        path = Path(folder) / "straight.xml"
        path.write_text(text)
        return hqp.robots.load(str(path))


def bent(joints: int, bend: float) -> Vec:
    """Joint angles ``(joints,)``, bent in z or y with alternating signs, the first half as much."""
    across = [axis != "x" for axis in AXES[joints]]
    signs = np.cumprod([-1.0 if a else 1.0 for a in across])
    q = np.where(across, bend * signs, 0.0)
    q[0] *= 0.5
    return q


def arrival(formulation: str, joints: int, bend: float, distance: float, variant: Variant) -> tuple[float, float]:
    """Arrival time of the hand [s], inf for never, and its final distance from the target [m]."""

    def law(gain: float) -> Law:
        return P(gain) if formulation == "velocity" else PD(gain * gain, 2.0 * gain)

    robot, q = arm(joints), bent(joints, bend)
    hand = Position(frame="tip", axes="xyz" if joints > 3 else "xy", law=law(GAINS[0]), name="hand")
    hard = [JointLimits(), *([TorqueLimits()] if formulation == "torque" else [])]
    stack = Stack(Level(hand), Level(Posture(law=law(GAINS[1]))), subject_to=hard)
    session = variant.of(stack, FORMULATIONS[formulation]).session(robot, DT)
    v, goal, off = np.zeros(robot.nv), np.array([distance, 0.0, 0.0][: len(hand.axes)]), math.inf
    for k in range(round(LONGEST / DT)):
        state = robot.state(q, v)
        off = float(np.linalg.norm(state.position("tip")[: goal.size] - goal))
        if off < WITHIN:
            return k * DT, off
        q, v = session.step(state, hand.at(goal)).advance()
    return math.inf, off


def measure(formulation: str, joints: Sequence[int], variant: Variant) -> Iterator[Record]:
    """Arrival times of the hand for each bend and distance."""
    for n in joints:
        for bend in BENDS:
            for distance in DISTANCES:
                time, off = arrival(formulation, n, bend, distance, variant)
                yield {
                    "formulation": formulation, "joints": n, "bend": bend, "distance": distance, "time": time,
                    "off": off,
                }  # fmt: skip


def misses(records: Sequence[Record]) -> Iterator[str]:
    """Arms that do not arrive."""
    for r in records:
        if r["time"] == math.inf:
            where = f"bend {r['bend']:g}, target at {r['distance']:g}: {1e3 * r['off']:.0f} mm off"
            yield f"{r['joints']} joints, {r['formulation']}, {where}"


def table(records: Sequence[Record]) -> str:
    """A row for each arm and formulation, seconds to 1 mm; for an arm that does not arrive, its distance."""

    def cell(r: Record) -> str:
        return f"{r['time']:.2f}" if r["time"] < math.inf else f"**{1e3 * r['off']:.0f} mm off**"

    rows = []
    for key in dict.fromkeys((r["joints"], r["formulation"]) for r in records):
        own = [r for r in records if (r["joints"], r["formulation"]) == key]
        cells = [" / ".join(cell(r) for r in own if r["bend"] == bend) for bend in BENDS]
        rows.append((str(key[0]), key[1], *cells))
    far = " / ".join(f"{d:g}" for d in DISTANCES)
    return markdown.table(("joints", "formulation", *(f"bend {b:g}: {far}" for b in BENDS)), rows) + "\n"
