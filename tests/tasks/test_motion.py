"""Elements on velocities: their rows, and their effect in a loop."""

from __future__ import annotations

from typing import Any

import numpy as np
import pinocchio as pin
import pytest

import hqp
import hqp.tasks as t
from hqp import Level, P, Stack
from hqp.errors import DeclarationError, JointNotFound


@pytest.fixture(scope="module")
def cbi() -> Any:
    return hqp.robots.load("cbi")


def test_momentum_is_that_of_pinocchio(cbi: Any) -> None:
    rng = np.random.default_rng(1)
    for _ in range(3):
        state = cbi.state(cbi.random_configuration(rng), rng.normal(size=cbi.nv))
        found = t.Momentum().jacobian(state) @ state.v
        data = cbi.model.createData()
        assert np.allclose(found, pin.computeCentroidalMomentum(cbi.model, data, state.q, state.v).vector, atol=1e-10)
        assert np.allclose(found[:3], cbi.mass * state.com_velocity(), atol=1e-10)
        assert np.allclose(t.Momentum(linear="", angular="zx").jacobian(state) @ state.v, found[[5, 3]])


def test_what_else_was_asked_for_stays_right(cbi: Any) -> None:
    """Momentum and the rate of inertia share Pinocchio's arrays with other quantities."""
    rng = np.random.default_rng(2)
    q, v = cbi.random_configuration(rng), rng.normal(size=cbi.nv)

    def read(state: Any) -> list[Any]:
        return [
            np.array(x)
            for x in (
                state.com(),
                state.com_jacobian(),
                state.com_drift(),
                state.com(3),
                state.drift("r_palm"),
                state.velocity("r_palm"),
                state.jacobian("r_palm"),
                state.mass_matrix(),
                state.bias_force(),
                state.gravity_force(),
                state.position("l_palm"),
            )
        ]

    alone = read(cbi.state(q, v))
    for first in ("momentum_map", "inertia_rate"):
        state = cbi.state(q, v)
        getattr(state, first)()
        found = read(state)
        getattr(state, first)()
        for one, two, three in zip(alone, found, read(state), strict=True):
            assert np.allclose(one, two, atol=1e-12)
            assert np.allclose(one, three, atol=1e-12)


def test_kinetic_energy_is_what_damping_sees(cbi: Any) -> None:
    rng = np.random.default_rng(3)
    state = cbi.state(cbi.random_configuration(rng), rng.normal(size=cbi.nv))
    J = t.Damping(kinetic_energy=True).jacobian(state)
    assert np.allclose(J.T @ J, state.mass_matrix(), atol=1e-10)


def test_angular_momentum_is_kept_at_zero(cbi: Any) -> None:
    """Swing an arm fast in the air: without the task the body's momentum follows the arm."""
    hand = t.Position(frame="r_palm", relative_to="pelvis", law=P(5.0))
    goal = cbi.state().position("r_palm") - cbi.state().position("pelvis") + [0.1, 0.1, 0.2]
    found = []
    for levels in ([Level(hand)], [Level(t.Momentum(linear="")), Level(hand)]):
        session = hqp.Controller(Stack(*levels), solver="nullspace").session(cbi, 0.002)
        q, v, most = cbi.home, np.zeros(cbi.nv), 0.0
        for _ in range(100):
            tick = session.step(cbi.state(q, v), hand.at(goal))
            q, v = tick.advance()
            most = max(most, float(np.abs(t.Momentum(linear="").jacobian(cbi.state(q, v)) @ v).max()))
        found.append(most)
    assert found[0] > 0.5
    assert found[1] < 0.02


def test_low_acceleration_goes_on_as_it_was(cbi: Any) -> None:
    """x is the last commanded velocity; as an acceleration x is zero."""
    stack = Stack(Level(t.LowAcceleration()))
    session = hqp.Controller(stack, solver="nullspace").session(cbi, 0.002)
    v = np.random.default_rng(4).normal(size=cbi.nv)
    for _ in range(3):
        tick = session.step(cbi.state(cbi.home, v))
        assert np.allclose(tick.x, v)
    session = hqp.Controller(stack, hqp.Acceleration(), solver="nullspace").session(cbi, 0.002)
    assert np.allclose(session.step(cbi.state(cbi.home, v)).x, 0.0)


@pytest.mark.parametrize("formulation", [hqp.Velocity(), hqp.Acceleration()], ids=["velocity", "acceleration"])
def test_the_base_is_no_faster_than_allowed(cbi: Any, formulation: Any) -> None:
    hand = t.Position(frame="r_palm", law=P(10.0) if formulation.order == 1 else None)
    stack = Stack(Level(hand), subject_to=[t.BaseVelocityLimits(linear=0.05, angular=0.1)])
    session = hqp.Controller(stack, formulation).session(cbi, 0.002)
    q, v, fastest = cbi.home, np.zeros(cbi.nv), np.zeros(6)
    goal = cbi.state().position("r_palm") + [0.4, 0.0, 0.3]
    for _ in range(300):
        q, v = session.step(cbi.state(q, v), hand.at(goal)).advance()
        fastest = np.maximum(fastest, np.abs(v[:6]))
    assert 0.049 < fastest[:3].max() < 0.0501
    assert fastest[3:].max() < 0.1001


def test_joint_velocities_are_followed(cbi: Any) -> None:
    spin = t.JointVelocity(joints=["R_EB", "L_EB"])
    stack = Stack(Level(spin), Level(t.Damping()))
    for formulation in (hqp.Velocity(), hqp.Acceleration(law=hqp.PD(100.0, 20.0))):
        session = hqp.Controller(stack, formulation).session(cbi, 0.002)
        q, v = cbi.home, np.zeros(cbi.nv)
        for _ in range(250):
            q, v = session.step(cbi.state(q, v), spin.at(velocity=[0.2, -0.1])).advance()
        columns = spin.selection(cbi)
        assert np.allclose(v[columns], [0.2, -0.1], atol=1e-3)
        assert np.abs(np.delete(v, columns)).max() < 1e-6


def test_what_is_refused(cbi: Any) -> None:
    for task, reference in ((t.JointVelocity(), {"value": [1.0]}), (t.Momentum(), {"velocity": [[1.0]]})):
        with pytest.raises(DeclarationError, match=task.name):
            task.at(**reference)
    with pytest.raises(DeclarationError, match="free base"):
        t.BaseVelocityLimits().rows(hqp.robots.load("panda"))
    with pytest.raises(JointNotFound):
        t.JointVelocity(joints="R_EBB").rows(cbi)
    with pytest.raises(DeclarationError, match="axes"):
        t.Momentum(linear="", angular="")
    session = hqp.Controller(Stack(Level(t.Momentum())), solver="nullspace").session(cbi, 0.002)
    with pytest.raises(DeclarationError, match="momentum"):
        session.step(cbi.state(), t.Momentum().at(velocity=[1.0, 2.0]))


def test_low_acceleration_of_a_whole_floating_robot_in_the_native_loop() -> None:
    """Once nv zeros of a hold value were written over the heap: no place was reserved for them."""
    robot = hqp.robots.load("cbi")
    session = hqp.Controller(hqp.Stack(hqp.Level(t.LowAcceleration()))).session(robot, 0.002)
    for _ in range(5):
        assert session.step(robot.state()).status.solved
    session.line.native.keep_hold("low_acceleration", np.zeros(robot.nv + 3))
    assert session.step(robot.state()).status.solved
