"""Controller(calm=False): one argument for everything that slows commands."""

import numpy as np
import pytest

import hqp
from hqp import Controller, Level, Stack
from hqp.errors import DeclarationError
from hqp.programs.formulation import Formulation, Velocity
from hqp.tasks import JointLimits, Position, Posture, TorqueLimits


def commands(formulation: Formulation, *, limits: JointLimits, **options: object) -> np.ndarray:
    """Commands of 100 ticks of a UR5 with a hand target one metre out of reach."""
    robot = hqp.robots.load("ur5")
    hand = Position(frame="tool0")
    torque = [TorqueLimits()] if isinstance(formulation, hqp.Torque) else []
    stack = Stack(Level(hand), Level(Posture()), subject_to=[*torque, limits])
    session = Controller(stack, formulation, deadline=np.inf, **options).session(robot, 0.002)  # type: ignore[arg-type]
    q, v, sent = robot.home, np.zeros(robot.nv), []
    aim = robot.state(q).position("tool0") + [0.5, 0.5, 1.0]
    for _ in range(100):
        tick = session.step(robot.state(q, v), hand.at(aim))
        sent.append(tick.command)
        q, v = tick.advance()
    return np.array(sent)


@pytest.mark.parametrize("formulation", [Velocity(), hqp.Torque()])
def test_calm_false_is_the_explicit_arguments_together(formulation: Formulation) -> None:
    off = JointLimits(acceleration=0, braking=0)
    lively = commands(formulation, limits=JointLimits(), calm=False)
    np.testing.assert_array_equal(lively, commands(formulation, limits=off, price=0))
    assert np.abs(lively - commands(formulation, limits=JointLimits())).max() > 0.1
    assert np.abs(lively - commands(formulation, limits=JointLimits(), price=0)).max() > 0.1


def test_declared_numbers_stay() -> None:
    own = JointLimits(acceleration=20.0, braking=3.0)
    np.testing.assert_array_equal(
        commands(Velocity(), limits=own, calm=False), commands(Velocity(), limits=own, price=0)
    )


def test_it_excludes_a_price() -> None:
    with pytest.raises(DeclarationError, match="calm"):
        Controller(Stack(Level(Posture())), calm=False, price=hqp.Price(tau=0.1))
