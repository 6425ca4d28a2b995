"""pink and mink on the same stack in the same run, where installed (pip install pin-pink mink): one weighted QP a tick.

Both weigh levels instead of ordering them: the feet are their equality constraints, CoM 100, hand 10, base and CoM
height 1, posture 0.1.  Gains are ours times the period; neither takes a velocity feedforward.
"""

from __future__ import annotations

import gc
import importlib.metadata
import importlib.util
import logging
import math
import xml.etree.ElementTree as ElementTree
from collections.abc import Callable
from pathlib import Path
from time import perf_counter_ns, process_time_ns
from typing import Any

import numpy as np

from benchmarks.mistry2008 import loop
from benchmarks.mistry2008.stack import GAINS, HZ, roles
from benchmarks.speed import ticks
from hqp.arrays import Vec
from hqp.robots import Robot

QP = "daqp"
"""The back end given to both, the fastest of those they take here."""

COM_COST, HAND_COST, BASE_COST, POSTURE_COST = 100.0, 10.0, 1.0, 0.1

Step = Callable[[Vec, Vec], Any]
"""One tick for a CoM and a hand target: what is timed."""


def measure(robot: Robot, count: int) -> list[dict[str, object]]:
    """A record for each rival that is installed and can take the robot."""
    makers = {"pink": ("pink", _pink), "mink": ("mink", _mink)}
    found = []
    for name, (module, maker) in makers.items():
        if importlib.util.find_spec(module) is not None:
            found.append(_run(robot, f"{name} (weighted, {QP})", maker(robot), count))
    return found


def _run(robot: Robot, name: str, rival: tuple[Step, Callable[[Any], Vec], Vec, Vec], count: int) -> dict[str, object]:
    step, advance, com_0, hand_0 = rival
    wall, cpu, floor = np.zeros(count), np.zeros(count), np.zeros(count)
    calls, square = ticks.bare_calls(robot), 0.0
    logging.disable(logging.WARNING)  # their log lines are no part of a tick
    gc.collect()
    gc.disable()
    try:
        for i in range(-ticks.WARM_UP, count):
            t = max(i, 0) / HZ
            goal, aim = com_0.copy(), hand_0 + loop.figure_eight(t)
            goal[:2] += loop.side_to_side(t)
            cpu_start, start = process_time_ns(), perf_counter_ns()
            answer = step(goal, aim)
            end, cpu_end = perf_counter_ns(), process_time_ns()
            hand = advance(answer)
            floor_start = perf_counter_ns()
            calls(robot.home)
            floor_end = perf_counter_ns()
            if i >= 0:
                wall[i], cpu[i], floor[i] = end - start, cpu_end - cpu_start, floor_end - floor_start
                square += float(np.sum((hand - aim) ** 2))
    finally:
        gc.enable()
        logging.disable(logging.NOTSET)
    wall, cpu, floor = wall / 1e3, cpu / 1e3, floor / 1e3
    return {
        "robot": robot.name,
        "stack": "feet s.t., com_xy, hand, base + com_z, posture by weight, joint limits",
        "solver": name,
        "ticks": count,
        "wall_us": ticks.spread(wall),
        "cpu_us": ticks.spread(cpu),
        "split_us": {},
        "floor_us": float(np.median(floor)),
        "misses_2ms": int(np.sum(wall > ticks.BUDGET_US)),
        "without_solve_us": math.nan,
        "unsolved": 0,
        "hand_rms_mm": 1e3 * float(np.sqrt(square / count)),
    }


def _pink(robot: Robot) -> tuple[Step, Callable[[Any], Vec], Vec, Vec]:
    import pink
    from pink.tasks import ComTask, FrameTask, PostureTask

    frames, dt = roles(robot), 1.0 / HZ
    configuration = pink.Configuration(robot.model, robot.model.createData(), robot.home)
    feet = [FrameTask(f, 1.0, 1.0, gain=20.0 * dt) for f in (frames.left, frames.right)]
    com = ComTask([COM_COST, COM_COST, BASE_COST], gain=GAINS.cog * dt)
    hand = FrameTask(frames.hand, HAND_COST, 0.0, gain=GAINS.hand * dt)
    base = FrameTask(frames.base, 0.0, BASE_COST, gain=GAINS.extraneous * dt)
    posture = PostureTask(POSTURE_COST, gain=GAINS.posture * dt)
    for task in (*feet, com, hand, base, posture):
        task.set_target_from_configuration(configuration)
    aimed = configuration.get_transform_frame_to_world(frames.hand)
    com_0, hand_0 = com.target_com.copy(), aimed.translation.copy()
    held = {"q": robot.home.copy()}

    def step(goal: Vec, aim: Vec) -> Vec:
        configuration.update(held["q"])
        com.set_target(goal)
        aimed.translation = aim
        hand.set_target(aimed)
        return np.asarray(
            pink.solve_ik(configuration, (com, hand, base, posture), dt, QP, constraints=feet, safety_break=False)
        )

    def advance(v: Vec) -> Vec:
        at = configuration.get_transform_frame_to_world(frames.hand).translation.copy()
        held["q"] = robot.integrate(held["q"], v, dt)
        return at

    return step, advance, com_0, hand_0


def _mink(robot: Robot) -> tuple[Step, Callable[[Any], Vec], Vec, Vec]:
    import mink
    import mujoco

    model, frames, dt = _mujoco_model(robot), roles(robot), 1.0 / HZ
    configuration = mink.Configuration(model)
    configuration.update(_mujoco_q(robot, model))
    held = {"q": configuration.q.copy()}
    kinds = {f: _kind(model, f) for f in (frames.left, frames.right, frames.hand, frames.base)}
    feet = [mink.FrameTask(f, kinds[f], 1.0, 1.0, gain=20.0 * dt) for f in (frames.left, frames.right)]
    com = mink.ComTask([COM_COST, COM_COST, BASE_COST], gain=GAINS.cog * dt)
    hand = mink.FrameTask(frames.hand, kinds[frames.hand], HAND_COST, 0.0, gain=GAINS.hand * dt)
    base = mink.FrameTask(frames.base, kinds[frames.base], 0.0, BASE_COST, gain=GAINS.extraneous * dt)
    posture = mink.PostureTask(model, POSTURE_COST, gain=GAINS.posture * dt)
    for task in (*feet, com, hand, base, posture):
        task.set_target_from_configuration(configuration)
    aimed = configuration.get_transform_frame_to_world(frames.hand, kinds[frames.hand])
    com_0, hand_0 = configuration.data.subtree_com[1].copy(), aimed.translation().copy()
    speeds = {robot.joint_name(int(c)): robot.velocity_limit[c] for c in robot.joints(None)}
    limits = [
        mink.ConfigurationLimit(model),
        mink.VelocityLimit(model, {name: speed for name, speed in speeds.items() if np.isfinite(speed)}),
    ]

    def step(goal: Vec, aim: Vec) -> Vec:
        configuration.update(held["q"])
        com.set_target(goal)
        hand.set_target(mink.SE3.from_rotation_and_translation(aimed.rotation(), aim))
        tasks = (com, hand, base, posture)
        return np.asarray(mink.solve_ik(configuration, tasks, dt, QP, limits=limits, constraints=feet))

    def advance(v: Vec) -> Vec:
        at = configuration.get_transform_frame_to_world(frames.hand, kinds[frames.hand]).translation().copy()
        mujoco.mj_integratePos(model, held["q"], v, dt)
        return at

    return step, advance, com_0, hand_0


def _mujoco_q(robot: Robot, model: Any) -> Vec:
    """Home in MuJoCo's order: quaternion w first, joints by name."""
    q = model.qpos0.copy()
    x, y, z, w = robot.home[3:7]
    q[:3], q[3:7] = robot.home[:3], (w, x, y, z)
    angles = robot.state(robot.home).angles
    for column in robot.joints(None):
        q[model.joint(robot.joint_name(int(column))).qposadr[0]] = angles[column]
    return np.asarray(q, dtype=np.float64)


def _kind(model: Any, name: str) -> str:
    import mujoco

    found = mujoco.mj_name2id(model, mujoco.mjtObj.mjOBJ_SITE, name)
    return "site" if found >= 0 else "body"


def _mujoco_model(robot: Robot) -> Any:
    """CBi from its own MJCF; another robot from the URDF of its catalogue entry, without shapes, with a free joint."""
    import mujoco

    own = Path(__file__).parents[2] / "robots" / robot.name / f"{robot.name}.xml"
    if own.is_file():
        return mujoco.MjModel.from_xml_path(str(own))
    data = importlib.metadata.distribution("example-robot-data")
    path = next(data.locate_file(f) for f in data.files or () if Path(str(f)).name == f"{robot.name}_reduced.urdf")
    root = ElementTree.parse(str(path)).getroot()
    for link in root.iter("link"):
        for shape in [*link.findall("visual"), *link.findall("collision")]:
            link.remove(shape)
    compiler = {"fusestatic": "false", "boundmass": "1e-6", "boundinertia": "1e-9", "balanceinertia": "true"}
    ElementTree.SubElement(ElementTree.SubElement(root, "mujoco"), "compiler", compiler)
    spec = mujoco.MjSpec.from_string(ElementTree.tostring(root, encoding="unicode"))
    spec.worldbody.first_body().add_freejoint()
    return spec.compile()
