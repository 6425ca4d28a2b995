"""Motors that pull several joints by fixed tendons: rows of the actuation, judged by MuJoCo's own forces."""

from __future__ import annotations

from pathlib import Path
from typing import Any

import mujoco
import numpy as np
import pytest

import hqp
from hqp.arrays import Mat
from hqp.errors import DeclarationError, ModelWarning
from hqp.export.loaded import LoadedSession
from hqp.robots.model_map import ModelMap
from hqp.robots.on_mujoco import Plant, Servo
from hqp.tasks import JointCoupling, JointLimits, Posture, TorqueLimits


def hand(rng: np.random.Generator, joints: int, rows: Mat, on_joint: list[int], equality: str = "") -> str:
    """A chain of ``joints`` finger joints with a branch, motors on some, tendons with coefficients ``rows``."""
    parts, ends = [], 0
    for i in range(joints):
        axis = " ".join(f"{x:.3f}" for x in rng.normal(size=3))
        parts.append(
            f'<body name="b{i}" pos="0 {0.02 * i:.3f} .12"><joint name="j{i}" axis="{axis}"/>'
            f'<geom size=".02 .05" type="capsule" pos="0 0 .06" mass="{rng.uniform(0.1, 0.6):.3f}"/>'
        )
        ends += 1
        if i == 1:  # the rest branches off the first link
            parts.append("</body>")
            ends -= 1
    tendons = "".join(
        f'<fixed name="t{k}">'
        + "".join(f'<joint joint="j{i}" coef="{c}"/>' for i, c in enumerate(row.tolist()) if c)
        + "</fixed>"
        for k, row in enumerate(rows)
    )
    motors = "".join(f'<motor name="m{i}" joint="j{i}" ctrlrange="-50 50"/>' for i in on_joint)
    pulls = "".join(
        f'<motor name="p{k}" tendon="t{k}" gear="{rng.uniform(0.5, 3.0):.3f}" ctrlrange="-40 40"/>'
        for k in range(len(rows))
    )
    return (
        '<mujoco><option timestep=".002"><flag contact="disable"/></option>'
        '<worldbody><body name="palm" pos="0 0 1"><geom size=".03"/>'
        + "".join(parts)
        + "</body>" * ends
        + f"</body></worldbody><tendon>{tendons}</tendon><equality>{equality}</equality>"
        + f"<actuator>{motors}{pulls}</actuator></mujoco>"
    )


def controls(robot: Any, simulated: Any, torque: Any) -> Any:
    """MuJoCo's controls that do the work of a command: its forces on the joints are U^T tau."""
    moments, data = np.zeros((robot.nv, simulated.nu)), mujoco.MjData(simulated)
    for a in range(simulated.nu):
        data.ctrl[:] = np.arange(simulated.nu) == a
        mujoco.mj_forward(simulated, data)
        moments[:, a] = data.qfrc_actuator
    wanted = robot.actuation.T @ torque
    found = np.linalg.lstsq(moments, wanted, rcond=None)[0]
    assert np.abs(moments @ found - wanted).max() < 1e-9 * max(1.0, np.abs(wanted).max())
    return found


def drawn(seed: int, tmp_path: Path) -> tuple[Any, Any, np.random.Generator]:
    """A hand whose motors determine its motion: joints with motors, and tendons across these and others."""
    rng = np.random.default_rng(seed)
    joints = int(rng.integers(2, 6))
    pulls = int(rng.integers(1, joints + 1))
    on_joint = sorted(rng.choice(joints, joints - pulls, replace=False).tolist())
    free = [i for i in range(joints) if i not in on_joint]
    rows = np.where(rng.random((pulls, joints)) < 0.6, rng.uniform(0.3, 2.0, (pulls, joints)), 0.0)
    rows *= rng.choice([-1.0, 1.0], rows.shape)
    rows[np.arange(pulls), free] = rng.uniform(0.5, 2.0, pulls)
    path = tmp_path / "hand.xml"
    path.write_text(hand(rng, joints, rows.round(3), on_joint))
    return hqp.robots.load(path), mujoco.MjModel.from_xml_path(str(path)), rng


def declared(robot: Any, posture: Posture, *constraints: Any) -> Any:
    stack = hqp.Stack(hqp.Level(posture), subject_to=[TorqueLimits(), *constraints])
    return hqp.Controller(stack, hqp.Torque(), deadline=np.inf).session(robot, 0.002, stuck=False)


@pytest.mark.long
@pytest.mark.parametrize("seed", range(6))
def test_hands_on_tendons_move_as_in_mujoco(seed: int, tmp_path: Path) -> None:
    """The acceleration of the program is that of MuJoCo under the tendons' forces; the hand follows, and stops."""
    robot, simulated, rng = drawn(seed, tmp_path)
    assert len(robot.joint_names) == simulated.nu == robot.nv
    posture = Posture(law=hqp.PD(100.0, 20.0))
    session = declared(robot, posture)
    session.export(tmp_path / "hand.hqp")
    loaded = LoadedSession((tmp_path / "hand.hqp").read_bytes())
    convert, data = ModelMap(simulated, robot), mujoco.MjData(simulated)
    goal = rng.uniform(-0.4, 0.4, robot.nv)
    data.qpos[:], data.qvel[:] = convert.to_mujoco(robot.home, np.zeros(robot.nv))
    for k in range(400):
        q, v = convert.to_pinocchio(data.qpos, data.qvel)
        if k == 300:
            session.stop()
        tick = session.step(robot.state(q, v), posture.at(goal))
        data.ctrl[:] = controls(robot, simulated, tick.command)
        mujoco.mj_forward(simulated, data)
        if k < 300:
            assert tick.status.usable, tick.notes
            same = loaded.step(q, v, {posture.name: goal})
            np.testing.assert_array_equal(same.command, tick.command)
            expected = session.program.acceleration(tick.x)  # type: ignore[attr-defined]
            found = convert.to_pinocchio(data.qpos, data.qacc)[1]
            np.testing.assert_allclose(found, expected, atol=1e-6 * max(1.0, np.abs(expected).max()))
        mujoco.mj_step(simulated, data)
    angles = robot.state(*convert.to_pinocchio(data.qpos, data.qvel)).angles
    assert np.abs(angles - goal).max() < 0.01
    assert np.abs(data.qvel).max() < 0.01  # the stop holds it up with the tendons


@pytest.mark.long
@pytest.mark.parametrize("seed", range(6))
def test_fingers_tied_by_the_stack_have_a_torque_level(seed: int, tmp_path: Path) -> None:
    """One tendon through two joints: a declared coupling ties them, an equality of the same law ties them in MuJoCo."""
    rng = np.random.default_rng(seed)
    ratio = float(rng.uniform(0.4, 2.0) * rng.choice([-1, 1]))
    rows = np.append(0.0, rng.uniform(0.5, 2.0, 2))[None]
    path, tied = tmp_path / "finger.xml", tmp_path / "tied.xml"
    path.write_text(hand(np.random.default_rng(seed), 3, rows, [0]))
    hard = f'<joint joint1="j2" joint2="j1" polycoef="0 {ratio} 0 0 0" solref="0.004 1" solimp="0.9999 0.9999 0.01"/>'
    tied.write_text(hand(np.random.default_rng(seed), 3, rows, [0], hard))
    robot, simulated = hqp.robots.load(path), mujoco.MjModel.from_xml_path(str(tied))
    posture = Posture(joints=["j0", "j1"], law=hqp.PD(100.0, 20.0))
    with pytest.raises(DeclarationError, match=r"determines j1, j2.*JointCoupling"):
        declared(robot, posture)
    session = declared(robot, posture, JointCoupling({"j2": 1.0, "j1": -ratio}))
    convert, data = ModelMap(simulated, robot), mujoco.MjData(simulated)
    goal = rng.uniform(-0.4, 0.4, 2)
    for _ in range(600):
        q, v = convert.to_pinocchio(data.qpos, data.qvel)
        tick = session.step(robot.state(q, v), posture.at(goal))
        assert tick.status.usable, tick.notes
        data.ctrl[:] = controls(robot, simulated, tick.command)
        mujoco.mj_forward(simulated, data)
        expected = session.program.acceleration(tick.x)  # type: ignore[attr-defined]
        found = convert.to_pinocchio(data.qpos, data.qacc)[1]
        np.testing.assert_allclose(found, expected, atol=2e-2 * max(1.0, np.abs(expected).max()))
        mujoco.mj_step(simulated, data)
    assert np.abs(robot.state(q, v).angles[:2] - goal).max() < 0.01


def test_a_tendon_that_pulls_as_another_adds_no_motor(tmp_path: Path) -> None:
    path = tmp_path / "hand.xml"
    path.write_text(hand(np.random.default_rng(0), 2, np.array([[1.0, 0.5], [-2.0, -1.0]]), []))
    with pytest.warns(ModelWarning, match=r"motor p1 moves the joints j0, j1 .* ignored: .* alike"):
        assert hqp.robots.load(path).joint_names == ("j0",)


@pytest.mark.parametrize("level", [hqp.Velocity(), hqp.Acceleration()])
def test_hands_on_tendons_keep_their_limits(level: Any, tmp_path: Path) -> None:
    robot, *_ = drawn(3, tmp_path)
    posture = Posture()
    stack = hqp.Stack(hqp.Level(posture), subject_to=[JointLimits()])
    session = hqp.Controller(stack, level, deadline=np.inf).session(robot, 0.002, stuck=False)
    q, v = robot.home, np.zeros(robot.nv)
    for _ in range(50):
        tick = session.step(robot.state(q, v), posture.at(np.full(robot.nv, 0.3)))
        assert tick.status.usable
        np.testing.assert_array_equal(tick.command, tick.x[robot.actuated])
        q, v = tick.advance()


@pytest.mark.parametrize("seed", range(3))
def test_the_plant_pulls_tendons(seed: int, tmp_path: Path) -> None:
    """A plant with torque motors, several of which pull tendons, reaches the posture of the program."""
    robot, _, rng = drawn(seed, tmp_path)
    plant, posture = Plant(robot, timestep=0.002), Posture(law=hqp.PD(100.0, 20.0))
    session, goal = declared(robot, posture), rng.uniform(-0.4, 0.4, robot.nv)
    q, v = plant.reset()
    for _ in range(400):
        plant.step(session.step(robot.state(q, v), posture.at(goal)).command)
        q, v = plant.state()
    assert np.abs(robot.state(q, v).angles - goal).max() < 0.01
    with pytest.raises(DeclarationError, match="no servo for motors of tendons"):
        Plant(robot, actuation="position", servo=Servo())
