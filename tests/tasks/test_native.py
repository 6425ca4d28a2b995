"""The native assembly writes what the writers write."""

from __future__ import annotations

from typing import Any

import numpy as np
import pytest

import hqp
import hqp.assembly
import hqp.tasks as t
from hqp import PD, Level, P, Stack
from hqp.robots import Robot

pytestmark = pytest.mark.skipif(hqp.assembly.native is None, reason="no native assembly here")

STACK = Stack(
    Level(
        t.FixedContact(frame="l_sole"),
        t.PointContact(frame="r_sole"),
        t.Com(axes="yx", weight=2.0),
        t.Position(frame="l_palm", axes="zx", offset=(0.1, 0.2, 0.3), weight=0.5),
    ),
    Level(t.Position(frame="r_palm"), t.Position(frame="r_palm", relative_to="pelvis", name="seen")),
    Level(t.Orientation(frame="pelvis", axes=("yaw", "roll"), weight=3.0), t.Com(axes="z", name="com_z")),
    Level(t.Orientation(frame="head"), t.Pose(frame="l_palm", name="palm"), t.Com(subtree="B_TFE", name="trunk")),
    Level(t.Posture(weight=0.3)),
    subject_to=[t.JointLimits(margin=0.01, acceleration=30.0)],
)


def problems(robot: Robot, formulation: Any, monkeypatch: pytest.MonkeyPatch, native: bool) -> list[Any]:
    if not native:
        monkeypatch.setattr(hqp.assembly, "native", None)
    rng = np.random.default_rng(3)
    session = hqp.Controller(STACK, formulation, solver="cascade:proxqp").session(robot, 0.002)
    program, found = session.program, []
    holds = {e.name: e.hold(robot.state(robot.random_configuration(rng))) for e in STACK}
    for _ in range(20):
        q, v = robot.random_configuration(rng), rng.normal(size=robot.nv)
        goal = t.Position(frame="r_palm").at(rng.normal(size=3), velocity=rng.normal(size=3))
        program.fill(robot.state(q, v), {**holds, "r_palm": goal}, [goal])
        found.append(program.problem.copy())
    monkeypatch.undo()
    return found


@pytest.mark.parametrize(
    "formulation",
    [hqp.Velocity(law=P(3.0), contact_law=P(7.0)), hqp.Acceleration(law=PD(9.0))],
    ids=["velocity", "acceleration"],
)
def test_native_rows_equal_written_rows(formulation: Any, monkeypatch: pytest.MonkeyPatch) -> None:
    robot = hqp.robots.load("cbi")
    fast = problems(robot, formulation, monkeypatch, native=True)
    slow = problems(robot, formulation, monkeypatch, native=False)
    assert hqp.assembly.native is not None
    for one, other in zip(fast, slow, strict=True):
        for a, b in zip(one.levels, other.levels, strict=True):
            assert np.abs(a.dense(one.n) - b.dense(one.n)).max() < 1e-12
            for side in ("lower", "upper"):
                x, y = getattr(a, side), getattr(b, side)
                assert np.allclose(x, y, rtol=1e-10, atol=1e-9)


def test_errors_are_exact_near_half_a_turn() -> None:
    """A rotation by almost pi about any axis is where rotation vectors are lost first."""
    robot = hqp.robots.load("cbi")
    task = t.Orientation(frame="pelvis", law=P(1.0))
    session = hqp.Controller(Stack(Level(task)), solver="nullspace").session(robot, 0.002)
    rng = np.random.default_rng(4)
    for angle in (0.0, 1e-9, 1e-4, 1.0, np.pi - 1e-3, np.pi - 1e-7):
        axis = rng.normal(size=3)
        turn = np.concatenate((axis / np.linalg.norm(axis) * np.sin(angle / 2), [np.cos(angle / 2)]))
        tick = session.step(robot.state(), task.at(turn))
        assert tick.solution is not None
        omega = robot.state().jacobian("pelvis")[3:] @ tick.solution.x
        assert np.allclose(omega, axis / np.linalg.norm(axis) * angle, atol=1e-7)
