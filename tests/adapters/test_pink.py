"""pink's tasks and solve_ik on hqp: equal rows, equal answers with one level, strict levels beyond."""

from __future__ import annotations

from typing import Any

import numpy as np
import pytest

import hqp
from hqp import Level, Stack
from hqp.errors import DeclarationError

pink = pytest.importorskip("pink")
from pink.tasks import ComTask, FrameTask, PostureTask  # noqa: E402

from hqp.adapters.pink import PinkTask, solve_ik  # noqa: E402
from hqp.solvers.lexicographic import Lexicographic  # noqa: E402

DT = 0.005


@pytest.fixture
def scene():
    robot = hqp.robots.load("g1")
    configuration = pink.Configuration(robot.model, robot.model.createData(), robot.home)
    left, right = robot.landmarks["soles"]
    feet = [FrameTask(left, 1.0, 1.0), FrameTask(right, 1.0, 1.0)]
    hand = FrameTask(robot.landmarks["palms"][1], 1.0, [0.0, 0.0, 0.5], gain=0.3)
    com, posture = ComTask(2.0, gain=0.2), PostureTask(1e-2)
    for task in (*feet, hand, com, posture):
        task.set_target_from_configuration(configuration)
    target = hand.transform_target_to_world.copy()
    target.translation += [0.05, 0.02, 0.1]
    hand.set_target(target)
    return robot, configuration, feet, hand, com, posture


def test_rows_are_pinks_own(scene) -> None:
    robot, configuration, _, hand, *_ = scene
    element = PinkTask(task=hand, dt=DT)
    assert element.rows(robot) == 4  # two of three rotations cost nothing
    session = hqp.Controller(Stack(Level(element))).session(robot, DT)
    session.step(robot.state())
    rows = session.problem.levels[0]
    weight = np.array([1.0, 1.0, 1.0, 0.0, 0.0, 0.5])
    kept = weight > 0.0
    J = (weight[:, None] * hand.compute_jacobian(configuration))[kept]
    b = -(hand.gain / DT) * (weight * hand.compute_error(configuration))[kept]
    assert np.abs(rows.dense(robot.nv) - J).max() < 1e-12
    assert np.abs(rows.lower - b).max() < 1e-11


def test_one_level_is_pinks_answer(scene) -> None:
    _, configuration, feet, hand, com, posture = scene
    tasks = [*feet, hand, com, posture]
    theirs = pink.solve_ik(configuration, tasks, DT, "daqp", damping=1e-12, safety_break=False)
    ours = solve_ik(configuration, tasks, DT, safety_break=False)
    assert np.abs(ours - theirs).max() < 1e-5 * np.abs(theirs).max()


def test_strict_levels_keep_the_feet(scene) -> None:
    _, configuration, feet, hand, com, posture = scene
    far = hand.transform_target_to_world.copy()
    far.translation += [3.0, 0.0, 0.0]
    hand.set_target(far)
    v = solve_ik(configuration, [feet, [com], [hand], [posture]], DT, safety_break=False)
    slip = max(np.abs(foot.compute_jacobian(configuration) @ v).max() for foot in feet)
    assert slip < 1e-9
    weighted = solve_ik(configuration, [*feet, com, hand, posture], DT, safety_break=False)
    assert max(np.abs(foot.compute_jacobian(configuration) @ weighted).max() for foot in feet) > 1e-3
    with pytest.raises(DeclarationError, match="mixed"):
        solve_ik(configuration, [feet, hand], DT, safety_break=False)


def test_limits_and_constraints_hold(scene) -> None:
    robot, configuration, feet, hand, com, _ = scene
    far = hand.transform_target_to_world.copy()
    far.translation += [3.0, 0.0, 0.0]
    hand.set_target(far)
    v = solve_ik(configuration, [[com], [hand]], DT, constraints=feet, safety_break=False)
    assert np.all(np.abs(v[6:]) <= robot.velocity_limit[6:] + 1e-9)
    assert max(np.abs(foot.compute_jacobian(configuration) @ v).max() for foot in feet) < 1e-9


def test_a_later_step_makes_no_solver_anew(monkeypatch: pytest.MonkeyPatch) -> None:
    made = []
    original = Lexicographic.workspace
    monkeypatch.setattr(Lexicographic, "workspace", lambda self, shape: made.append(shape) or original(self, shape))
    configuration, feet, tasks = _g1()
    for _ in range(3):
        v = solve_ik(configuration, [feet, *[[task] for task in tasks]], 0.01, safety_break=False)
        configuration.integrate_inplace(v, 0.01)
    assert len(made) <= 1


def _g1() -> tuple[Any, list[Any], list[Any]]:
    robot = hqp.robots.load("g1")
    configuration = pink.Configuration(robot.model, robot.model.createData(), robot.home)
    feet = [pink.tasks.FrameTask(sole, 1.0, 1.0) for sole in robot.landmarks["soles"]]
    hand = pink.tasks.FrameTask("right_wrist_yaw_link", 1.0, 0.0, gain=0.1)
    tasks = [pink.tasks.ComTask(1.0, gain=0.1), hand, pink.tasks.PostureTask(1.0, gain=0.02)]
    for task in (*feet, *tasks):
        task.set_target_from_configuration(configuration)
    goal = hand.transform_target_to_world.copy()
    goal.translation += np.array([0.1, 0.0, 0.15])
    hand.set_target(goal)
    return configuration, feet, tasks
