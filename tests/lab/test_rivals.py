"""Comparison with rivals, without their packages: robot, job, loop, figures."""

from __future__ import annotations

import importlib.util
import json
import sys
from pathlib import Path
from types import ModuleType
from typing import Any

import numpy as np
import pinocchio as pin
import pytest

import hqp
from hqp import Level, P, Stack
from hqp.errors import DeclarationError, UnsupportedProblem
from hqp.lab.rivals import RivalTable, compare, environments
from hqp.lab.rivals.job import plain, write
from hqp.lab.rivals.scenes import SCENES, scene
from hqp.lab.rivals.urdf import urdf
from hqp.tasks import Com, FixedContact, JointLimits, Orientation, Position, Posture

SIDE = Path(compare.__file__).parent / "workers" / "side.py"
HAND = Position(frame="r_palm", law=P(5.0), name="hand")
STACK = Stack(
    Level(FixedContact(frame="l_sole"), FixedContact(frame="r_sole"), Com(axes="xy", law=P(2.0)), name="balance"),
    Level(HAND, name="hand"),
    Level(Orientation(frame="pelvis"), Posture(law=P(1.0)), name="rest"),
    subject_to=[JointLimits()],
)


@pytest.mark.parametrize("name", ["cbi", "ur5", "g1"])
def test_the_robot_that_rivals_read_is_ours(name: str) -> None:
    robot = hqp.robots.load(name)
    frame = robot.frame_names[-1]
    root = pin.JointModelFreeFlyer() if robot.floating else None
    text = urdf(robot, [frame])
    model = pin.buildModelFromXML(text, root) if root else pin.buildModelFromXML(text)
    data, q = model.createData(), pin.neutral(model)
    rng = np.random.default_rng(0)
    step = np.zeros(robot.nv)
    columns = [int(c) for c in robot.joints(None)]
    step[columns] = rng.uniform(-0.3, 0.3, len(columns))
    own = robot.integrate(robot.home, step, 1.0)
    angles = robot.state(own).angles
    if robot.floating:
        q[:7] = own[:7]
    for c in columns:
        q[model.joints[model.getJointId(robot.joint_name(c))].idx_q] = angles[c]
    pin.framesForwardKinematics(model, data, q)
    state = robot.state(own)
    assert np.allclose(data.oMf[model.getFrameId(frame)].translation, state.position(frame), atol=1e-12)
    assert np.allclose(pin.centerOfMass(model, data, q), state.com(), atol=1e-9)
    assert model.lowerPositionLimit[-1] == pytest.approx(max(robot.lower[columns[-1]], -1e3))


def test_a_stack_in_plain_numbers() -> None:
    tasks = {t.name: t for t in plain(STACK)}
    assert [tasks[n].level for n in ("l_sole", "com", "hand", "pelvis", "posture")] == [-1, 0, 1, 2, 2]
    assert (tasks["hand"].kind, tasks["hand"].gain, tasks["l_sole"].gain) == ("position", 5.0, 20.0)
    relative = Stack(Level(Position(frame="r_palm", relative_to="pelvis")))
    with pytest.raises(UnsupportedProblem, match="relative_to"):
        plain(relative)


def test_scenes_are_what_they_say() -> None:
    robot = hqp.robots.load("cbi")
    outside = scene("outside", robot, STACK).robot
    angles = outside.state(outside.home).angles
    assert np.max((angles - outside.upper)[robot.joints(None)]) == pytest.approx(0.1)
    narrow = scene("limit", robot, STACK).robot
    assert np.max((narrow.upper - narrow.lower)[robot.joints(None)]) <= 0.1 + 1e-12
    assert np.max((robot.upper - robot.lower)[robot.joints(None)]) > 1.0  # the original is unchanged
    held = scene("infeasible", robot, STACK).held
    assert np.linalg.norm(held["held here"] - held["held there"]) == pytest.approx(0.02)
    assert "l_sole again" in scene("redundant", robot, STACK).stack


class _Slow:
    """A library that moves one joint, raises in its third tick and answers NaN in its fifth."""

    def __init__(self, told: dict[str, Any], dt: float, targets: dict[str, Any]) -> None:
        self.q, self.v, self.dt, self.count = np.array(told["angles"]), np.zeros(len(told["angles"])), dt, 0
        self.place, self.centre = np.array(told["base"]), np.array(told["com"])

    def aim(self, name: str, values: Any) -> None:
        self.count += 0

    def prepare(self) -> None:
        pass

    def solve(self) -> None:
        self.count += 1
        self.v = np.zeros(self.q.size)
        self.v[0] = 0.1
        if self.count == 50 + 3:
            raise ValueError("no answer")
        if self.count == 50 + 5:
            self.v[:] = np.nan

    def stop(self) -> None:
        self.v = np.zeros(self.q.size)

    def advance(self) -> None:
        self.q = self.q + self.dt * self.v

    def base(self) -> Any:
        return self.place

    def angles(self) -> Any:
        return self.q

    def speeds(self) -> Any:
        return self.v

    def com(self) -> Any:
        return self.centre


def _side() -> ModuleType:
    spec = importlib.util.spec_from_file_location("side", SIDE)
    assert spec is not None
    assert spec.loader is not None
    module = importlib.util.module_from_spec(spec)
    spec.loader.exec_module(module)
    return module


@pytest.mark.long
def test_failures_of_a_rival_are_counted(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    robot = hqp.robots.load("cbi")
    made = [scene("nominal", robot, STACK)]
    side = _side()

    def call(command: list[str], **options: Any) -> Any:
        monkeypatch.setattr(sys, "argv", command[1:])
        side.main(_Slow)
        return type("Done", (), {"returncode": 0, "stdout": "", "stderr": ""})

    monkeypatch.setattr(compare.subprocess, "run", call)
    monkeypatch.setattr(side.logging, "disable", lambda level: None)
    write(tmp_path, robot, made, 0.04, 0.002)
    (one,) = compare._theirs("pink", Path("python"), tmp_path, made, 0.04, 0.002)
    assert (one.failed, one.ticks, one.said) == (2, 20, "ValueError: no answer")
    assert one.jump == pytest.approx(0.1)
    assert one.p50_us > 0.0
    job = json.loads((tmp_path / "job.json").read_text())
    job["scenes"][0]["com"][0] += 0.01
    (tmp_path / "job.json").write_text(json.dumps(job))
    with pytest.raises(hqp.HqpError, match="another robot"):
        compare._theirs("pink", Path("python"), tmp_path, made, 0.04, 0.002)


@pytest.mark.long
def test_ours_in_the_same_table() -> None:
    robot = hqp.robots.load("cbi")
    made = [scene(name, robot, STACK) for name in ("nominal", "nan")]
    lines = compare._ours(made, 0.3, 0.002, "hqp")
    found = RivalTable({"rivals": {}}, tuple(lines))
    assert found["hqp", "nan"].said == "INVALID_REFERENCE"
    assert found["hqp", "nominal"].over < 1e-12
    assert found["hqp", "nominal"].off > 1e-4  # no velocity is given: it lags
    assert "nominal" in str(found)
    assert len(SCENES) == 8


def test_an_unknown_rival() -> None:
    with pytest.raises(DeclarationError, match="placo"):
        environments.environment("plaxo")


@pytest.mark.slow
def test_our_torques_out_of_reach_are_calm_and_within_the_motors() -> None:
    """Without torque limits a straight leg took 1e10 N m, and hands out of reach reversed 87 times a second."""
    robot = hqp.robots.load("talos")
    feet = [FixedContact(frame=sole) for sole in robot.landmarks["soles"]]
    hand = Position(frame=robot.landmarks["palms"][1], law=P(5.0), name="hand")
    stack = Stack(
        Level(*feet, Com(axes="xy", law=P(2.0)), name="balance"),
        Level(hand, name="hand"),
        Level(Orientation(frame=robot.landmarks["base"][0]), Posture(law=P(1.0)), name="rest"),
        subject_to=[JointLimits()],
    )
    (line,) = compare._ours([scene("unreachable", robot, stack)], 1.4, 0.002, compare.TORQUE)
    assert line.said == ""
    assert line.reversals <= 10.0
