"""mink's tasks and solve_ik on hqp: equal rows through the map of coordinates, strict levels beyond."""

from __future__ import annotations

import numpy as np
import pytest

import hqp
from hqp import Level, Stack

mink = pytest.importorskip("mink")
mujoco = pytest.importorskip("mujoco")

from hqp.adapters.mink import MinkTask, solve_ik  # noqa: E402
from hqp.robots.model_map import ModelMap  # noqa: E402

DT = 0.005


@pytest.fixture
def scene():
    from pathlib import Path

    import hqp.robots

    robot = hqp.robots.load("cbi")
    model = mujoco.MjModel.from_xml_path(str(Path(hqp.robots.__file__).parent / "cbi" / "cbi.xml"))
    states = ModelMap(model, robot)
    qpos, _ = states.to_mujoco(robot.home, np.zeros(robot.nv))
    configuration = mink.Configuration(model, q=qpos)
    site = [model.site(i).name for i in range(model.nsite)]
    feet = [mink.FrameTask(name, "site", 1.0, 1.0) for name in ("l_sole", "r_sole") if name in site]
    hand = mink.FrameTask("r_palm", "site", 1.0, 0.0, gain=0.3)
    posture = mink.PostureTask(model, 1e-2)
    for task in (*feet, hand, posture):
        task.set_target_from_configuration(configuration)
    there = configuration.get_transform_frame_to_world("r_palm", "site")
    hand.set_target(mink.SE3.from_translation(there.translation() + [0.05, 0.0, 0.1]))
    return robot, model, configuration, states, feet, hand, posture


def test_rows_are_minks_own(scene) -> None:
    robot, model, configuration, states, _, hand, _ = scene
    element = MinkTask(task=hand, model=model, dt=DT)
    assert element.rows(robot) == 3
    session = hqp.Controller(Stack(Level(element))).session(robot, DT)
    session.step(robot.state())
    rows = session.problem.levels[0]
    J = hand.compute_jacobian(configuration)[:3] @ states.tangent(configuration.q)
    assert np.abs(rows.dense(robot.nv) - J).max() < 1e-12
    assert np.abs(rows.lower + (hand.gain / DT) * hand.compute_error(configuration)[:3]).max() < 1e-10


def test_the_jacobian_is_the_rate_of_the_error(scene) -> None:
    robot, model, _, _, _, hand, _ = scene
    element = MinkTask(task=hand, model=model, dt=DT)
    v, step = np.random.default_rng(0).standard_normal(robot.nv), 1e-6
    ahead = element.value(robot.state(robot.integrate(robot.home, v, step)))
    behind = element.value(robot.state(robot.integrate(robot.home, v, -step)))
    assert (ahead - behind) / (2 * step) == pytest.approx(element.jacobian(robot.state()) @ v, abs=1e-6)


def test_one_level_is_minks_answer(scene) -> None:
    _, _, configuration, _, feet, hand, posture = scene
    tasks = [*feet, hand, posture]
    theirs = mink.solve_ik(configuration, tasks, DT, "daqp", damping=1e-12)
    ours = solve_ik(configuration, tasks, DT)
    # damping fixes the remaining directions in mink, the least displacement in hqp
    for task in tasks:
        J = task.compute_jacobian(configuration)
        assert np.abs(J @ (ours - theirs)).max() < 1e-4 * max(1.0, np.abs(J @ theirs).max())


def test_strict_levels_keep_the_feet(scene) -> None:
    _, _, configuration, _, feet, hand, posture = scene
    hand.set_target(mink.SE3.from_translation(np.array([4.0, 0.0, 1.0])))
    v = solve_ik(configuration, [feet, [hand], [posture]], DT)
    assert max(np.abs(foot.compute_jacobian(configuration) @ v).max() for foot in feet) < 1e-9
