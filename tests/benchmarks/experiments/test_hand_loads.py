"""Loads at a hand: found by the momentum observer, entered into the dynamics, and their effect."""

from __future__ import annotations

import math
from dataclasses import replace

import numpy as np
import pinocchio as pin
import pytest

import hqp
from benchmarks.sentis2012.experiments.compliance import Compliance
from benchmarks.sentis2012.experiments.dreamer_run import Outing
from benchmarks.sentis2012.experiments.human import Walk
from benchmarks.sentis2012.experiments.measures import measure
from benchmarks.sentis2012.experiments.scene import Scene
from hqp.errors import DeclarationError
from hqp.estimation import MomentumObserver
from hqp.tasks import ExternalWrench
from tests.scenes.sentis2012 import paper_stack

PUSHED = Scene(slope=0.0, push=(0.0, 60.0, 0.0), seconds=2.6)
HARD = Compliance(limits=True, com_acceleration=math.inf, least_load=60.0)


def test_the_observer_finds_a_force_on_a_moving_arm() -> None:
    """A floating robot under random torques and ground forces: Pinocchio's dynamics, integrated at 0.2 ms."""
    robot = hqp.robots.load("dreamer")
    dt, actuated = 2e-4, robot.actuated
    observer = MomentumObserver(robot, "hand_point", "upper_body", dt, bandwidth=200.0)
    force = np.array([12.0, -7.0, 5.0])
    q, v = robot.home.copy(), np.zeros(robot.nv)
    data, rng = robot.model.createData(), np.random.default_rng(0)
    for k in range(1000):
        state = robot.state(q, v)
        tau = state.gravity_force()
        tau[actuated] += rng.normal(size=actuated.size)
        tau[:6] += 20.0 * rng.normal(size=6)  # forces of the ground do not concern the limb
        found = observer.update(state, tau[actuated])
        if k in (499, 999):
            np.testing.assert_allclose(found, force, atol=0.6)
        if k == 499:
            force = -force
        tau += state.jacobian("hand_point")[:3].T @ force
        v = v + dt * pin.aba(robot.model, data, q, v, tau)
        q = robot.integrate(q, v, dt)
    assert np.abs(v).max() > 1.0  # it moves


def test_what_an_observer_refuses_and_survives() -> None:
    robot = hqp.robots.load("dreamer")
    with pytest.raises(DeclarationError, match="bandwidth"):
        MomentumObserver(robot, "hand_point", "upper_body", 0.002, bandwidth=0.0)
    with pytest.raises(DeclarationError, match="too few"):
        MomentumObserver(robot, "hand_point", ("arm_j0",), 0.002)
    observer = MomentumObserver(robot, "hand_point", "upper_body", 0.002)
    torque = np.zeros(robot.actuated.size)
    observer.update(robot.state(), torque)
    observer.update(robot.state(), torque * np.nan)
    assert np.isfinite(observer.residual).all()


@pytest.mark.slow
def test_the_observer_follows_a_push_in_physics() -> None:
    run = Outing(
        replace(PUSHED, push=(0.0, 30.0, 0.0)), Compliance(payload="none", wrench="observed"), "nullspace"
    ).run()
    t, off = run.log["t"], run.log["felt"] - run.log["pull"]
    settled = (t > 1.3) & (t < 2.5)
    assert np.abs(off[settled]).max() < 1.5
    assert run.log["felt"][settled][:, 1].min() > 28.0


@pytest.mark.slow
def test_sixty_newtons_aside_with_the_force_known() -> None:
    unknown = Outing(PUSHED, Compliance(), "lexicographic").run()
    assert measure(unknown).com > 30.0
    measured = Outing(PUSHED, replace(HARD, wrench="measured"), "lexicographic").run()
    observed = Outing(PUSHED, replace(HARD, wrench="observed", bandwidth=100.0), "lexicographic").run()
    for run in (measured, observed):
        assert measure(run).com < 5.0
        assert measure(run).unloaded < 0.1  # the worst of five runs each is 68 ms


@pytest.mark.slow
def test_a_kilogram_in_the_hand_known_and_found_out() -> None:
    scene = Scene(slope=0.0, payload=1.0, seconds=4.0, walk=Walk(start=9.0))
    plain = measure(Outing(scene, Compliance(), "nullspace").run(), since=3.0).com_up
    known = Outing(scene, Compliance(payload="known", wrench="observed"), "nullspace").run()
    found = Outing(scene, Compliance(payload="observed", wrench="observed"), "nullspace").run()
    assert plain > 10.0
    assert measure(known, since=3.0).com_up < 1.0
    assert measure(found, since=3.0).com_up < 2.0
    assert found.log["carried"][-1] == pytest.approx(1.0, abs=0.1)


def test_a_wrench_that_is_not_resisted_moves_the_robot() -> None:
    """Gravity compensation resists one wrench and not the other."""
    robot = hqp.robots.load("dreamer")
    pulled = np.array([20.0, 0.0, 0.0, 0.0, 0.0, 0.0])
    moved = {}
    for resisted in (True, False):
        wrench = ExternalWrench(frame="hand_point", resisted=resisted)
        stack = paper_stack([wrench])
        session = hqp.Controller(stack, hqp.Torque(gravity_compensation=True), price=0).session(robot, 0.002)
        tick = session.step(robot.state(), wrench.at(pulled))
        moved[resisted] = float(session.program.acceleration(tick.x)[0])
    assert moved[True] == pytest.approx(0.0, abs=1e-6)
    assert moved[False] > 0.1


def test_the_force_between_coupled_joints_drops_out_of_an_estimate() -> None:
    robot = hqp.robots.load("ur5")
    moved = [name for name in robot.joint_names if name != "elbow_joint"]
    coupled = {"elbow_joint": ("shoulder_lift_joint", -0.5)}
    observer = MomentumObserver(robot, "tool0", moved, 0.002, coupled=coupled)
    state, force = robot.state(robot.home + 0.3), np.array([3.0, -5.0, 20.0])
    between = np.zeros(robot.nv)
    between[robot.joints(("elbow_joint",))] = 7.0
    between[robot.joints(("shoulder_lift_joint",))] = 3.5
    observer.residual = state.jacobian("tool0")[:3].T @ force + between
    np.testing.assert_allclose(observer.force(state), force, atol=1e-9)
