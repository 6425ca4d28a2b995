"""Ticks of hands that follow a goal: UR5, Panda and G1, against the two bare Pinocchio calls and placo of the same run.

placo (pip install placo) is measured if it is installed; it pins another version of Pinocchio and needs its own
environment.  Its tick is one weighted QP: hands 1, CoM and feet hard, posture 1e-3, joint limits.
"""

from __future__ import annotations

import gc
import importlib
import importlib.util
import xml.etree.ElementTree as ElementTree
from collections.abc import Callable, Iterator
from dataclasses import dataclass
from time import perf_counter_ns
from typing import Any

import numpy as np
import pinocchio as pin

import hqp
from hqp import Level, P, Stack
from hqp.arrays import Mat, Vec
from hqp.robots import Robot
from hqp.tasks import Com, FixedContact, JointLimits, Pose, Posture
from tests.scenes.mistry2008 import HZ

WARM_UP = 100
"""Ticks before the measurement."""

START = {"ur5": (0.3, -1.0, 1.2, -0.8, 0.6, 0.2)}
"""First joint angles [rad] of robots with a singular home."""

GOALS = {"ur5": (8.0, 9.0, 1.9), "panda": (8.0, 9.0, 1.9), "g1": (25.0, np.inf, 0.7)}
"""Goals of the median tick: time [us], ratio to the two Pinocchio calls, ratio to placo."""


@dataclass(frozen=True)
class Scene:
    """A robot, its stack and the poses that follow a goal."""

    robot: Robot
    stack: Stack
    hands: tuple[Pose, ...]


def scene(name: str) -> Scene:
    """Hand pose > posture on an arm; feet > CoM > both hand poses > posture on G1; under joint limits."""
    robot = hqp.robots.load(name)
    frames = {"ur5": ("tool0",), "panda": ("panda_hand",)}.get(name) or robot.landmarks["palms"]
    hands = tuple(Pose(frame=frame, law=P(5.0)) for frame in frames)
    levels = [Level(*hands, name="hands"), Level(Posture(law=P(1.0)), name="posture")]
    if robot.floating:
        feet = [FixedContact(frame=frame) for frame in robot.landmarks["soles"]]
        levels = [Level(*feet, name="feet"), Level(Com(law=P(2.0)), name="com"), *levels]
    return Scene(robot, Stack(*levels, subject_to=[JointLimits()]), hands)


@dataclass(frozen=True)
class Run:
    """Times ``(T,)`` [us]: ticks from state to command, and the two bare Pinocchio calls in between."""

    robot: str
    name: str
    wall: Vec
    floor: Vec
    unsolved: int
    off: float

    def record(self) -> dict[str, object]:
        """The run as plain numbers; off: error of the hands at the end [m, rad]."""
        median, floor = float(np.median(self.wall)), float(np.median(self.floor))
        return {
            "robot": self.robot,
            "solver": self.name,
            "ticks": int(self.wall.size),
            "median_us": median,
            "p99_us": float(np.percentile(self.wall, 99.0)),
            "floor_us": floor,
            "times_floor": median / floor,
            "unsolved": self.unsolved,
            "off": self.off,
        }


def goals(starts: list[Mat], t: float) -> list[Mat]:
    """Poses that circle in front of the hands' first places."""
    moved = [pose.copy() for pose in starts]
    for pose in moved:
        pose[:3, 3] += 0.05 * np.array([np.sin(t), 1.0 - np.cos(t), 0.5 * np.sin(2.0 * t)])
    return moved


def measure(name: str, count: int) -> Iterator[Run]:
    """Measure hqp, and placo if it is installed, in turns of one loop each."""
    s = scene(name)
    start = s.robot.home.copy()
    if name in START:
        start = s.robot.integrate(start, np.array(START[name]) - s.robot.state().angles, 1.0)
    yield _loop(s, "hqp lexicographic", _ours(s), start, count)
    if importlib.util.find_spec("placo") is not None and s.robot.source:
        yield _loop(s, "placo (weighted)", placo_step(s, start), start, count)


Step = Callable[[Vec, Vec, list[Mat]], tuple[Vec, Vec, bool, int]]
"""One tick: q, v and goals in; the next q and v, true if solved, and its time [ns]."""


def _loop(s: Scene, name: str, step: Step, start: Vec, count: int) -> Run:
    robot, model, data = s.robot, s.robot.model, s.robot.model.createData()
    state = robot.state(start)
    starts = [hand.value(state) for hand in s.hands]
    q, v = start.copy(), np.zeros(robot.nv)
    wall, floor, unsolved, aims = np.zeros(count), np.zeros(count), 0, starts
    gc.collect()
    gc.disable()
    try:
        for i in range(-WARM_UP, count):
            aims = goals(starts, max(i, 0) / HZ)
            q, v, solved, spent = step(q, v, aims)
            begin = perf_counter_ns()
            pin.computeJointJacobians(model, data, q)
            pin.updateFramePlacements(model, data)
            end = perf_counter_ns()
            if i >= 0:
                wall[i], floor[i], unsolved = spent / 1e3, (end - begin) / 1e3, unsolved + int(not solved)
    finally:
        gc.enable()
    state = robot.state(q)
    off = max(float(np.abs(hand.error(state, aim)).max()) for hand, aim in zip(s.hands, aims, strict=True))
    return Run(robot.name, name, wall, floor, unsolved, off)


def _ours(s: Scene) -> Step:
    session = hqp.Controller(s.stack, hqp.Velocity(), solver="lexicographic").session(s.robot, dt=1.0 / HZ)
    robot, hands = s.robot, s.hands

    def step(q: Vec, v: Vec, aims: list[Mat]) -> tuple[Vec, Vec, bool, int]:
        begin = perf_counter_ns()
        tick = session.step(robot.state(q, v), *[hand.at(aim) for hand, aim in zip(hands, aims, strict=True)])
        command = tick.command
        spent = perf_counter_ns() - begin
        assert command.size
        return *tick.advance(), tick.status.solved, spent

    return step


def placo_model(s: Scene, start: Vec) -> tuple[Any, Any]:
    """Module and placo's robot at a start, without meshes: they are no part of a tick."""
    placo: Any = importlib.import_module("placo")
    tree = ElementTree.parse(s.robot.source)
    for link in tree.getroot().iter("link"):
        for shape in [*link.findall("collision"), *link.findall("visual")]:
            link.remove(shape)
    text = ElementTree.tostring(tree.getroot(), encoding="unicode")
    model = placo.RobotWrapper("", placo.Flags.ignore_collisions, text)
    own: Vec = np.array(model.state.q)
    own[:7] = start[:7] if s.robot.floating else own[:7]
    own[7:] = start[7:] if s.robot.floating else start
    model.state.q = own
    model.update_kinematics()
    return placo, model


def placo_sole(s: Scene, model: Any, sole: str) -> str:
    """A sole's frame in placo's robot; the body of its joint if the file lacks the sole."""
    joint = s.robot.model.frames[s.robot.frame(sole)].parentJoint
    return sole if sole in model.frame_names() else str(s.robot.model.names[joint])


def placo_step(s: Scene, start: Vec, clock: Callable[[], int] = perf_counter_ns, com: str = "hard") -> Step:
    """A tick of placo on the scene, from ``start``, timed by the clock [ns]; com: priority of the CoM's task."""
    placo, model = placo_model(s, start)
    solver = placo.KinematicsSolver(model)
    solver.dt = 1.0 / HZ
    if not s.robot.floating:
        solver.mask_fbase(True)
    tasks = []
    for hand in s.hands:
        task = solver.add_frame_task(hand.frame, model.get_T_world_frame(hand.frame))
        task.configure(hand.frame, "soft", 1.0, 1.0)
        tasks.append(task)
    for sole in s.robot.landmarks.get("soles", ()) if s.robot.floating else ():
        frame = placo_sole(s, model, sole)
        solver.add_frame_task(frame, model.get_T_world_frame(frame)).configure(frame, "hard", 1.0, 1.0)
    if s.robot.floating:
        solver.add_com_task(model.com_world()).configure("com", com, 1.0)
    posture = solver.add_joints_task()
    posture.set_joints({name: float(model.get_joint(name)) for name in model.joint_names()})
    posture.configure("posture", "soft", 1e-3)
    solver.enable_joint_limits(True)
    solver.enable_velocity_limits(True)

    def step(q: Vec, v: Vec, aims: list[Mat]) -> tuple[Vec, Vec, bool, int]:
        begin = clock()
        for task, aim in zip(tasks, aims, strict=True):
            task.T_world_frame = aim
        solver.solve(True)
        model.update_kinematics()
        spent = clock() - begin
        found = np.array(model.state.q)
        return (found if s.robot.floating else found[7:]), v, True, spent

    return step


HEADER = ("robot", "solver", "median", "p99", "two Pinocchio calls", "times them", "times placo", "unsolved", "off")


def rows(runs: list[Run]) -> Iterator[tuple[str, ...]]:
    """A line a run, with its ratios."""
    for run in runs:
        r = run.record()
        rival = next((other.record() for other in runs if other.robot == run.robot and "placo" in other.name), None)
        ratio = "" if rival is None else f"{float(str(r['median_us'])) / float(str(rival['median_us'])):.2f}"
        yield (
            run.robot, run.name, f"{r['median_us']:.1f}", f"{r['p99_us']:.1f}", f"{r['floor_us']:.2f}",
            f"{r['times_floor']:.1f}", ratio, str(run.unsolved), f"{run.off:.1e}",
        )  # fmt: skip


def outcomes(runs: list[Run]) -> Iterator[tuple[str, str, str, str]]:
    """Each goal with its measurement and verdict."""
    for run in runs:
        if "placo" in run.name or run.robot not in GOALS:
            continue
        r, (us, floor, placo) = run.record(), GOALS[run.robot]
        rival = next((float(np.median(o.wall)) for o in runs if o.robot == run.robot and "placo" in o.name), None)
        median = float(np.median(run.wall))
        found = [
            ("median tick", us, median, "us"),
            ("over the two calls", floor, float(str(r["times_floor"])), "times"),
        ]
        if rival is not None:
            found.append(("over placo", placo, median / rival, "times"))
        for text, goal, measured, unit in found:
            if goal < np.inf:
                said = "reached" if measured <= goal else "MISSED"
                yield f"{run.robot}: {text}", f"{goal:g} {unit}", f"{measured:.2f} {unit}", said
