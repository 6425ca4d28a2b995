"""Every robot file of the wheels from ``make corpus`` loads, and moves as in MuJoCo or Pinocchio."""

from __future__ import annotations

import os
import warnings
from collections import Counter
from pathlib import Path
from typing import Any

import mujoco
import numpy as np
import pinocchio as pin
import pytest

import hqp.robots
from hqp import PD, Level, P, Stack
from hqp.errors import HqpError, ModelError
from hqp.robots import file_kind
from hqp.robots.model_map import ModelMap
from hqp.robots.mujoco_extra import full_inertia
from hqp.tasks import JointLimits, Posture

FOLDER = Path(os.environ.get("HQP_CORPUS", "build/corpus"))
pytestmark = pytest.mark.corpus


def robot_files() -> list[Path]:
    """Files with joints that MuJoCo compiles, or with a URDF robot as root; parts of other files are left out."""
    found = []
    for path in sorted(p for p in FOLDER.rglob("*") if p.suffix.lower() in (".xml", ".urdf", ".mjcf")):
        try:
            if file_kind.of(path) == "urdf" or mujoco.MjModel.from_xml_path(str(path)).nv:
                found.append(path)
        except (ValueError, ModelError):
            continue
    return found


def load(path: Path) -> Any:
    with warnings.catch_warnings():
        warnings.simplefilter("ignore")
        return hqp.robots.load(path)


class Judge:
    """Positions, inertia and bias forces of the file by its own engine: MuJoCo, or Pinocchio's reader for a URDF."""

    def __init__(self, robot: Any) -> None:
        self.robot, self.simulated = robot, robot.description.simulated
        if self.simulated is None:
            self.model = pin.buildModelFromUrdf(str(robot.source))
            self.data = self.model.createData()
        else:
            self.map, self.data = ModelMap(self.simulated, robot), mujoco.MjData(self.simulated)

    def at(self, q: Any, v: Any) -> tuple[Any, Any]:
        """M ``(nv, nv)`` and h ``(nv,)`` in the robot's coordinates."""
        if self.simulated is None:
            pin.crba(self.model, self.data, q)
            M = np.triu(self.data.M) + np.triu(self.data.M, 1).T
            pin.forwardKinematics(self.model, self.data, q)
            pin.updateFramePlacements(self.model, self.data)
            return M, pin.nonLinearEffects(self.model, self.data, q, v).copy()
        simulated, data, state_map = self.simulated, self.data, self.map
        data.qpos[:], data.qvel[:] = state_map.to_mujoco(q, v)
        mujoco.mj_forward(simulated, data)
        B, full, h = state_map.tangent(data.qpos), full_inertia(simulated, data), 1e-6
        ahead, behind = (
            state_map.tangent(state_map.to_mujoco(self.robot.integrate(q, v, s), v)[0]) @ v for s in (h, -h)
        )
        return B.T @ full @ B, B.T @ (data.qfrc_bias + full @ (ahead - behind) / (2 * h))

    def places(self) -> dict[str, Any]:
        """Positions ``(3,)`` of links or bodies by name at the latest ``at``."""
        if self.simulated is None:
            bodies = [(f.name, i) for i, f in enumerate(self.model.frames) if f.type == pin.FrameType.BODY]
            return {name: self.data.oMf[i].translation for name, i in bodies}
        names = [self.simulated.body(b).name for b in range(self.simulated.nbody)]
        return {name: self.data.xpos[b] for b, name in enumerate(names) if name in self.robot.frame_names}


def stepped(robot: Any, judge: Judge, formulation: Any) -> None:
    """Run some ticks towards a drawn posture: check positions, limits, couplings, and the equation of motion."""
    level = type(formulation).__name__
    law = P(5.0) if level == "Velocity" else PD(25.0, 10.0)
    posture = Posture(joints=robot.joint_names, law=law)
    stack = Stack(Level(posture), subject_to=[JointLimits()])
    session = hqp.Controller(stack, formulation, deadline=np.inf).session(robot, 0.002, stuck=False)
    rng, q, v = np.random.default_rng(0), robot.home, np.zeros(robot.nv)
    home = posture.value(robot.state(q))
    low, high = robot.lower[robot.actuated], robot.upper[robot.actuated]
    goal = np.clip(home + rng.uniform(-0.3, 0.3, home.size), low, high)
    for _ in range(25):
        with warnings.catch_warnings():
            warnings.simplefilter("ignore")
            tick = session.step(robot.state(q, v), posture.at(goal))
        assert tick.status.usable, (level, str(tick.status), tick.notes)
        assert np.isfinite(tick.x).all()
        M, h = judge.at(q, v)
        state = robot.state(q, v)
        for name, place in judge.places().items():
            assert np.abs(state.position(name) - place).max() < 1e-7 * max(1.0, np.abs(place).max()), name
        next_q, next_v = tick.advance()
        if level == "Torque":
            acceleration = (next_v - v) / 0.002
            rows = [c.jacobian(state) for c in robot.couplings]
            J = np.vstack(rows) if rows else np.zeros((0, robot.nv))
            force = M @ acceleration + h - robot.actuation.T @ tick.command
            force = force - J.T @ np.linalg.lstsq(J.T, force, rcond=None)[0]
            scale = max(1.0, np.abs(h).max(), np.abs(M @ acceleration).max())
            assert np.abs(force).max() < 1e-5 * scale, (np.abs(force).max(), scale)
        q, v = next_q, next_v
    state = robot.state(q)
    off = [c.error(state, c.hold(state).value) for c in robot.couplings]
    assert max((float(np.abs(e).max()) for e in off), default=0.0) < 1e-3
    if any("no position of" in note for note in robot.notes):
        return  # limits and couplings of the file conflict
    angles = state.angles[robot.actuated]
    assert (angles >= low - 1e-6).all()
    assert (angles <= high + 1e-6).all()


@pytest.mark.filterwarnings("ignore")
def test_every_robot_file_loads_and_moves() -> None:
    files = robot_files()
    if not files:
        pytest.skip("no corpus here: make corpus")
    told: Counter[str] = Counter()
    wrong = []
    for path in files:
        at = str(path.relative_to(FOLDER))
        try:
            robot = load(path)
        except ModelError as error:
            told["refused"] += 1
            print(f"{at}: {str(error)[-160:]}")
            if path.name not in str(error):
                wrong.append(f"{at}: refused without its name: {error}")
            continue
        told["loaded"] += 1
        judge = Judge(robot)
        for formulation in (hqp.Velocity(), hqp.Acceleration(), hqp.Torque()):
            level = type(formulation).__name__
            try:
                stepped(robot, judge, formulation)
                told[level] += 1
            except HqpError as error:
                told[f"{level} refused"] += 1
                print(f"{at}: {level}: {str(error)[:200]}")
            except Exception as error:
                wrong.append(f"{at}: {level}: {type(error).__name__}: {str(error)[:200]}")
    print(dict(told), f"of {len(files)} files")
    print("\n".join(wrong))
    assert not wrong
    assert told["loaded"] >= 0.9 * len(files)
    assert min(told["Velocity"], told["Acceleration"]) >= 0.95 * told["loaded"]
