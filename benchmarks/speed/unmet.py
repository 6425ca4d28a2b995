"""Times of ticks with unmet levels: hands out of reach beside placo and price 0, large trees, split postures.

All times are CPU times of the thread, which a busy machine does not change; every pair runs turn by turn in one loop.
``python -m benchmarks.speed.unmet`` prints the table of docs/results/solver.md.
"""

from __future__ import annotations

import argparse
import gc
import importlib.util
import math
import tempfile
from collections.abc import Iterator, Sequence
from dataclasses import dataclass
from pathlib import Path
from time import thread_time_ns
from typing import Any

import numpy as np

import hqp
from benchmarks.speed import teleoperation
from hqp import PD, Level, P, Stack, Status
from hqp.arrays import Mat
from hqp.declare.element import Element
from hqp.robots import Robot
from hqp.tasks import (
    CollisionAvoidance,
    Com,
    FixedContact,
    FrictionCone,
    JointLimits,
    LoadShare,
    Orientation,
    Pose,
    Position,
    Posture,
    TorqueLimits,
)
from tests.scenes.mistry2008 import HZ

WARM_UP, FAR = 200, 1.0
"""Ticks before the measurement; distance of a hand's target ahead of its first place [m]."""


@dataclass(frozen=True)
class Line:
    """A line of the table: CPU times [us], cut: ticks that met the deadline, over: median over that of the other."""

    scene: str
    ticks: int
    median: float
    p99: float
    cut: int
    other: str = ""
    over: float = math.nan

    def __str__(self) -> str:
        over = f"{self.over:.2f} {self.other}" if self.other else ""
        return f"| {self.scene} | {self.ticks} | {self.median:.1f} | {self.p99:.0f} | {self.cut} | {over} |"


class Loop:
    """A stack in closed loop on its own robot, its targets fixed; ``spent``: CPU times of the ticks [ns]."""

    def __init__(
        self, robot: Robot, stack: Stack, targets: Sequence[Any] = (), *, dt: float = 1.0 / HZ, **options: Any
    ) -> None:
        self.robot, self.targets, self.spent, self.cut = robot.copy(), targets, list[int](), 0
        self.session = hqp.Controller(stack, **options).session(self.robot, dt)
        self.q, self.v = self.robot.home.copy(), np.zeros(self.robot.nv)

    def step(self) -> None:
        """One tick and its integration."""
        state = self.robot.state(self.q, self.v)
        begin = thread_time_ns()
        tick = self.session.step(state, *self.targets)
        self.spent.append(thread_time_ns() - begin)
        self.cut += tick.status is Status.TIME_LIMIT
        self.q, self.v = tick.advance()


class Placo:
    """The loop's hands through placo's weighted program."""

    def __init__(self, scene: teleoperation.Scene, aims: list[Mat], com: str = "hard") -> None:
        self.aims, self.spent = aims, list[int]()
        self.q, self.v = scene.robot.home.copy(), np.zeros(scene.robot.nv)
        self._step = teleoperation.placo_step(scene, self.q, thread_time_ns, com)

    def step(self) -> None:
        """Run one step of placo's solver."""
        self.q, self.v, _, spent = self._step(self.q, self.v, self.aims)
        self.spent.append(spent)


def run(scene: str, loop: Loop, other: Loop | Placo | None, against: str, ticks: int) -> Line:
    """Measure both loops in turns."""
    gc.collect()
    gc.disable()
    try:
        for _ in range(WARM_UP + ticks):
            loop.step()
            if other is not None:
                other.step()
    finally:
        gc.enable()
    mine = 1e-3 * np.array(loop.spent[WARM_UP:])
    over = math.nan if other is None else float(np.median(mine)) / (1e-3 * float(np.median(other.spent[WARM_UP:])))
    p99 = float(np.percentile(mine, 99.0))
    return Line(scene, ticks, float(np.median(mine)), p99, loop.cut, against if other is not None else "", over)


def ahead(robot: Robot, hands: Sequence[Pose], far: float = FAR) -> list[Mat]:
    """Poses ``far`` ahead of the hands [m]."""
    state, poses = robot.state(robot.home), []
    for hand in hands:
        pose = np.array(hand.value(state))
        pose[0, 3] += far
        poses.append(pose)
    return poses


def out_of_reach(ticks: int) -> Iterator[Line]:
    """Feet > CoM > both hands > posture on Talos and G1, beside placo."""
    for name in ("talos", "g1"):
        scene = teleoperation.scene(name)
        aims = ahead(scene.robot, scene.hands)
        targets = [hand.at(aim) for hand, aim in zip(scene.hands, aims, strict=True)]
        known = importlib.util.find_spec("placo") is not None
        yield run(
            f"{name}: hands {FAR:g} m ahead", Loop(scene.robot, scene.stack, targets),
            Placo(scene, aims) if known else None, "of placo", ticks,
        )  # fmt: skip


def tree(joints: int, path: Path) -> Robot:
    """Four limbs on a floating base, each with ``joints`` joints; the first two are hands, the others stand."""
    text = ['<robot name="tree">', _body("base", 10.0)]
    for limb in range(4):
        parent = "base"
        for j in range(joints):
            body, axis = f"limb{limb}_{j}", ("1 0 0", "0 1 0", "0 0 1")[j % 3]
            place = f"{0.1 - 0.2 * (limb // 2)} {0.1 - 0.2 * (limb % 2)} 0" if j == 0 else "0 0 0"
            way = "1" if limb < 2 else "-1"
            text.append(_body(body, 0.3))
            text.append(
                f'<joint name="j{limb}_{j}" type="revolute"><parent link="{parent}"/><child link="{body}"/>'
                f'<origin xyz="{place if j == 0 else f"0 0 {way}e-2"}" rpy="{0.02 * (j % 5)} 0 0"/>'
                f'<axis xyz="{axis}"/><limit lower="-2" upper="2" velocity="5" effort="100"/></joint>'
            )
            parent = body
    path.write_text("\n".join([*text, "</robot>"]))
    return hqp.robots.load(str(path), floating=True)


def _body(name: str, mass: float) -> str:
    inertia = '<inertia ixx="0.01" iyy="0.01" izz="0.01" ixy="0" ixz="0" iyz="0"/>'
    return f'<link name="{name}"><inertial><mass value="{mass}"/>{inertia}</inertial></link>'


def large(ticks: int) -> Iterator[Line]:
    """Both hands too far on trees of 102 and 198 variables, beside price 0."""
    for joints in (24, 48):
        with tempfile.TemporaryDirectory() as folder:
            robot = tree(joints, Path(folder) / "tree.urdf")
        hands = [Pose(frame=f"limb{i}_{joints - 1}", law=P(5.0)) for i in (0, 1)]
        feet = [FixedContact(frame=f"limb{i}_{joints - 1}") for i in (2, 3)]
        levels = [*(Level(hand) for hand in hands), Level(Posture(law=P(1.0)))]
        targets = [hand.at(aim) for hand, aim in zip(hands, ahead(robot, hands), strict=True)]
        stack = Stack(*levels, subject_to=[*feet, JointLimits()])
        default, exact = (Loop(robot, stack, targets, deadline=math.inf, price=price) for price in (None, 0.0))
        yield run(f"nv {robot.nv}: both hands too far", default, exact, "of price 0", ticks)


def last_levels(ticks: int) -> Iterator[Line]:
    """The posture in two levels beside one: G1 with hands a little ahead, base and postures out of reach."""
    for name in ("talos", "g1"):
        robot = hqp.robots.load(name)
        hard: list[Element] = [*(FixedContact(frame=f) for f in robot.landmarks["soles"]), JointLimits()]
        hands = [Pose(frame=f, law=P(5.0)) for f in robot.landmarks["palms"]]
        halves = [Posture(joints=robot.joint_names[k::2], law=P(1.0), name=f"posture{k}") for k in (0, 1)]
        levels, cut = [Level(Com(law=P(2.0))), *map(Level, hands)], [Level(half) for half in halves]
        here = [hand.at(hand.value(robot.state(robot.home))) for hand in hands]
        stacks = Stack(*levels, *cut, subject_to=hard), Stack(*levels, Level(Posture(law=P(1.0))), subject_to=hard)
        many, one = (Loop(robot, stack, here) for stack in stacks)
        yield run(f"{name}: posture in two levels, within reach", many, one, "of one", ticks)
    near = [hand.at(aim) for hand, aim in zip(hands, ahead(robot, hands, 0.1), strict=True)]
    base = Level(Orientation(frame=robot.landmarks["base"][0], law=P(2.0)))
    never = Loop(robot, Stack(*levels, base, *cut, subject_to=hard), near)
    yield run("g1: base and postures never met", never, None, "", ticks)


def collision(ticks: int) -> Iterator[Line]:
    """G1: one target for both palms in front of the chest, with collision avoidance."""
    robot = hqp.robots.load("g1")
    feet = [FixedContact(frame=frame) for frame in robot.landmarks["soles"]]
    hands = [Position(frame=frame, law=P(5.0)) for frame in robot.landmarks["palms"]]
    state = robot.state(robot.home)
    middle = np.mean([hand.value(state) for hand in hands], axis=0) + np.array([0.1, 0.0, 0.0])
    levels = [Level(Com(law=P(2.0))), Level(*hands), Level(Posture(law=P(1.0)))]
    stacks = [Stack(*levels, subject_to=[*feet, JointLimits(), *more]) for more in ([CollisionAvoidance()], [])]
    avoiding, none = (Loop(robot, stack, [hand.at(middle) for hand in hands]) for stack in stacks)
    yield run("g1: palms pressed together, collisions active", avoiding, none, "of none avoided", ticks)


def walking(ticks: int) -> Iterator[Line]:
    """Talos at torque level: CoM > trunk > posture, 12 forces of two feet least at the end, friction and limits."""
    robot = hqp.robots.load("talos")
    law = PD(100.0, 20.0)
    feet: list[Element] = [FixedContact(frame=frame, law=PD(0.0, 20.0)) for frame in robot.landmarks["soles"]]
    names = tuple(getattr(foot, "name", "") for foot in feet)
    left, right = names
    stack = Stack(
        Level(Com(law=law)),
        Level(Orientation(frame=robot.landmarks["base"][0], law=law)),
        Level(Posture(law=PD(40.0, 13.0))),
        Level(LoadShare(contacts=(left, right))),
        subject_to=[*feet, TorqueLimits(), JointLimits(), *(FrictionCone(contact=name, mu=0.6) for name in names)],
    )
    loop = Loop(robot, stack, dt=1e-3, formulation=hqp.Torque())
    yield run("talos, torque: a walking stack, standing", loop, None, "", ticks)


PARTS = {f.__name__: f for f in (out_of_reach, large, last_levels, collision, walking)}


def main() -> None:
    """Print the table of the named parts, or of all."""
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("parts", nargs="*", metavar="PART", help=", ".join(PARTS))
    parser.add_argument("--ticks", type=int, default=2000)
    given = parser.parse_args()
    print("| scene | ticks | median [us] | p99 [us] | cut | median over |\n|---|---|---|---|---|---|")
    for name in given.parts or PARTS:
        for line in PARTS[name](given.ticks):
            print(line, flush=True)


if __name__ == "__main__":
    main()
