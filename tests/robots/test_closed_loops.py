"""Mechanisms with closed loops from MJCF move as in MuJoCo."""

from __future__ import annotations

import math
from pathlib import Path
from typing import Any

import mujoco
import numpy as np
import pytest

import hqp
import hqp.tasks as t
from hqp import PD, Level, P, Stack
from hqp.arrays import Vec
from hqp.export.loaded import LoadedSession
from hqp.loop.file import text
from hqp.robots.model_map import ModelMap
from tests.scenes.mechanisms import KINDS, LEADS, draw

DT = 0.002
SEEDS = (0, *(pytest.param(seed, marks=pytest.mark.slow) for seed in range(1, 6)))
LEVELS = {"velocity": hqp.Velocity, "acceleration": hqp.Acceleration, "torque": hqp.Torque}


def load(folder: Path, kind: str, seed: int) -> tuple[Any, Any]:
    path = folder / f"{kind}.xml"
    path.write_text(draw(np.random.default_rng(seed), kind))
    return hqp.robots.load(path), mujoco.MjModel.from_xml_path(str(path))


def session(robot: Any, kind: str, level: str) -> tuple[hqp.Session, t.Posture]:
    lead = t.Posture(joints=LEADS[kind], law=P(8.0) if level == "velocity" else PD(100.0, 20.0), name="lead")
    return hqp.Controller(Stack(Level(lead)), LEVELS[level](), deadline=math.inf).session(robot, DT), lead


def gap(simulated: Any, qpos: Vec) -> float:
    """Largest distance of points that MuJoCo's equalities connect [m]."""
    data = mujoco.MjData(simulated)
    data.qpos[:] = qpos
    mujoco.mj_forward(simulated, data)
    rows = data.efc_type == int(mujoco.mjtConstraint.mjCNSTR_EQUALITY)
    assert rows.any()
    return float(np.abs(data.efc_pos[rows]).max())


@pytest.mark.parametrize("level", LEVELS)
@pytest.mark.parametrize("kind", KINDS)
@pytest.mark.parametrize("seed", SEEDS)
def test_loops_stay_closed(kind: str, level: str, seed: int, tmp_path: Path) -> None:
    robot, simulated = load(tmp_path, kind, seed)
    live, lead = session(robot, kind, level)
    file = LoadedSession(text(live))
    convert = ModelMap(simulated, robot)
    q, v = robot.home, np.zeros(robot.nv)
    columns = robot.joints(LEADS[kind])
    goal = robot.state(q).angles[columns] + np.random.default_rng(seed).uniform(-0.2, 0.2, len(columns))
    for k in range(600):
        tick = live.step(robot.state(q, v), lead.at(goal))
        assert tick.status.usable, tick.notes
        found = file.step(q, v, {"lead": (goal,)})
        np.testing.assert_array_equal(found.x, tick.x, err_msg=f"tick {k}")
        q, v = tick.advance()
        if k % 100 == 99:
            assert gap(simulated, convert.to_mujoco(q, v)[0]) < 1e-3  # integration error with feedback
    assert gap(simulated, convert.to_mujoco(q, v)[0]) < 1e-5
    assert np.abs(robot.state(q).angles[columns] - goal).max() < 1e-2


@pytest.mark.parametrize("kind", KINDS)
@pytest.mark.parametrize("seed", SEEDS)
def test_torques_accelerate_it_as_in_mujoco(kind: str, seed: int, tmp_path: Path) -> None:
    robot, simulated = load(tmp_path, kind, seed)
    (live, lead), (still, there) = session(robot, kind, "torque"), session(robot, kind, "velocity")
    convert, data = ModelMap(simulated, robot), mujoco.MjData(simulated)
    q, columns, rng = robot.home, robot.joints(LEADS[kind]), np.random.default_rng(seed)
    start = robot.state(q).angles[columns]
    for _ in range(3):
        goal = start + rng.uniform(-0.2, 0.2, len(columns))
        for _ in range(1000):  # closed and at rest, then moving in that configuration
            q, _ = still.step(robot.state(q), there.at(goal)).advance()
        v = still.step(robot.state(q), there.at(goal, velocity=rng.uniform(-1, 1, len(columns)))).x
        tick = live.step(robot.state(q, v), lead.at(goal + 0.1))
        data.qpos[:], data.qvel[:] = convert.to_mujoco(q, v)
        data.ctrl[:] = tick.command
        mujoco.mj_forward(simulated, data)
        found = convert.to_pinocchio(data.qpos, data.qacc)[1][columns]
        expected = live.program.acceleration(tick.x)[columns]  # type: ignore[attr-defined]
        np.testing.assert_allclose(found, expected, atol=1e-2 * max(1.0, float(np.abs(expected).max())))


@pytest.mark.long
@pytest.mark.parametrize("kind", KINDS)
def test_a_simulated_mechanism_follows(kind: str, tmp_path: Path) -> None:
    robot, simulated = load(tmp_path, kind, 5)
    live, lead = session(robot, kind, "torque")
    convert, data = ModelMap(simulated, robot), mujoco.MjData(simulated)
    mujoco.mj_forward(simulated, data)
    columns = robot.joints(LEADS[kind])
    start = robot.state(robot.home).angles[columns]
    for k in range(750):
        q, v = convert.to_pinocchio(data.qpos, data.qvel)
        aim = start + 0.15 * math.sin(2.0 * math.pi * k * DT)
        tick = live.step(robot.state(q, v), lead.at(aim))
        assert tick.status.usable, tick.notes
        data.ctrl[:] = tick.command
        mujoco.mj_step(simulated, data, 4)
        assert gap(simulated, data.qpos) < 2e-3
    assert np.abs(robot.state(q).angles[columns] - aim).max() < 0.1


def test_a_parallelogram_bears_the_shank_by_virtual_work(tmp_path: Path) -> None:
    """Crank and rod beside thigh and shank: at rest the crank bears the shank's moment about the knee and its own."""
    path = tmp_path / "leg.xml"
    path.write_text(PARALLELOGRAM)
    robot = hqp.robots.load(path)
    names = ("hip", "knee", "crank", "rod")
    angles = np.zeros(robot.nv)
    for name, angle in zip(names, (0.4, 0.7, 0.7, -0.7), strict=True):  # the rod stays along the thigh
        angles[robot.joints(name)] = angle
    hold = t.Posture(joints=["hip", "crank"], name="hold")
    live = hqp.Controller(Stack(Level(hold)), hqp.Torque(), deadline=math.inf).session(robot, DT)
    q = robot.configuration(angles)
    tick = live.step(robot.state(q))
    assert tick.status.usable
    h = 1e-6

    def energy(crank: float) -> float:
        moved = angles.copy()
        for name, turn in (("knee", crank), ("crank", crank), ("rod", -crank)):
            moved[robot.joints(name)] += turn
        return -float(robot.mass * robot.gravity @ robot.state(robot.configuration(moved)).com())

    work = (energy(h) - energy(-h)) / (2.0 * h)
    assert abs(work) > 1.0
    assert tick.command[robot.joint_names.index("crank")] == pytest.approx(work, abs=1e-3)


PARALLELOGRAM = """
<mujoco model="leg"><compiler angle="radian" autolimits="true"/>
<worldbody><body name="thigh" pos="0 0 1"><joint name="hip" axis="0 1 0"/>
 <inertial pos="0 0 -0.2" mass="3" diaginertia="0.04 0.04 0.004"/>
 <body name="crank"><joint name="crank" axis="0 1 0"/>
  <inertial pos="-0.03 0 0" mass="0.2" diaginertia="4e-4 4e-4 4e-4"/>
  <body name="rod" pos="-0.06 0 0"><joint name="rod" axis="0 1 0"/>
   <inertial pos="0 0 -0.2" mass="0.3" diaginertia="4e-3 4e-3 2e-4"/><site name="end" pos="0 0 -0.4"/></body></body>
 <body name="shank" pos="0 0 -0.4"><joint name="knee" axis="0 1 0"/>
  <inertial pos="0 0 -0.18" mass="2" diaginertia="0.02 0.02 0.002"/><site name="lever" pos="-0.06 0 0"/></body>
</body></worldbody>
<equality><connect name="loop" site1="end" site2="lever"/></equality>
<actuator><motor joint="hip" ctrlrange="-200 200"/><motor joint="crank" ctrlrange="-200 200"/></actuator></mujoco>
"""
