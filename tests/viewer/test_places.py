"""Handles appear at the references: on drawn states, for every task with a target in the scene."""

from __future__ import annotations

from typing import Any

import numpy as np
import pytest

import hqp
from hqp import Level, Stack
from hqp.declare.element import Task
from hqp.tasks import AlignAxis, Com, FixedContact, LookAt, Orientation, Pose, Position
from hqp.viewer.description import describe_stack
from hqp.viewer.places import KINDS, angle, length

TASKS: dict[str, Task] = {
    "position": Position(frame="r_palm"),
    "offset": Position(frame="r_palm", axes="zx", offset=(0.1, 0.0, 0.2)),
    "relative": Position(frame="r_palm", relative_to="l_palm"),
    "heading": Position(frame="r_palm", relative_to="pelvis", heading=True, axes="xy"),
    "com": Com(axes="xy"),
    "arm": Com(subtree="R_SFE", relative_to="l_palm"),
    "pose": Pose(frame="r_palm", relative_to="l_palm"),
    "rotation": Orientation(frame="r_palm", relative_to="l_palm"),
    "angles": Orientation(frame="r_palm", axes=("yaw", "pitch")),
    "gaze": LookAt(frame="r_palm", axis=(0.0, 2.0, 0.0)),
    "direction": AlignAxis(frame="r_palm", axis=(0.0, 0.0, 1.0)),
}


def draw(robot: Any, rng: np.random.Generator) -> Any:
    v = rng.normal(size=robot.nv)
    return robot.state(robot.integrate(robot.home, v, 0.5))


@pytest.mark.parametrize("name", TASKS)
def test_a_handle_is_where_the_reference_is(name: str) -> None:
    robot, rng = hqp.robots.load("cbi"), np.random.default_rng(3)
    task = TASKS[name]
    session = hqp.Controller(Stack(Level(FixedContact(frame="l_sole")), Level(task))).session(robot, 0.002)
    (target,) = describe_stack(session.line, session.controller.formulation, 1).targets
    place = KINDS[target.kind](target, robot)
    for _ in range(10):
        wanted = np.asarray(task.value(draw(robot, rng)))
        state = draw(robot, rng)
        assert target.shape == wanted.shape
        p, R = place.there(state, wanted.ravel())
        assert np.allclose(R @ R.T, np.eye(3))
        assert np.allclose(place.value(state, p, R), wanted.ravel(), atol=1e-9), "dragged there it is another one"
        error = np.linalg.norm(task.error(state, wanted))
        if name != "pose" and name != "angles":
            assert place.distance(state, wanted.ravel())[0] == pytest.approx(error, abs=1e-9)
        else:
            assert (place.distance(state, wanted.ravel())[0] > 1e-3) == (error > 1e-3)
        own = np.ravel(task.value(state))
        assert place.distance(state, own)[0] < 1e-7


def test_more_targets_than_the_page_has_room_for() -> None:
    robot = hqp.robots.load("cbi")
    many = Level(*(Position(frame="r_palm", name=f"hand{i}") for i in range(30)))
    session = hqp.Controller(Stack(Level(FixedContact(frame="l_sole")), many)).session(robot, 0.002)
    assert len(describe_stack(session.line, session.controller.formulation, 1).targets) == 30
    assert len(describe_stack(session.line, session.controller.formulation, 1, 24).targets) == 24


def test_words() -> None:
    assert [length(x) for x in (1.234, 0.1234, 0.00123)] == ["1.23 m", "12.3 cm", "1.2 mm"]
    assert [angle(x) for x in (1.0, 0.01)] == ["57°", "0.6°"]
