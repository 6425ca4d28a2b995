"""Promise of the library in the loop: the reference of a lower level never changes a higher residual."""

from __future__ import annotations

import math

import numpy as np
import pytest
from hypothesis import HealthCheck, given, settings
from hypothesis import strategies as st

import hqp
from hqp import Level, P, Stack, Status
from hqp.problem import ETA
from hqp.robots import Robot
from hqp.tasks import Com, FixedContact, JointLimits, Orientation, Position, Posture

ROBOTS = ("cbi", "talos", "g1")


def stack(robot: Robot) -> Stack:
    left, right = robot.landmarks["soles"]
    return Stack(
        Level(FixedContact(frame=left), FixedContact(frame=right), Com(axes="xy", name="com_xy"), name="balance"),
        Level(Position(frame=robot.landmarks["palms"][1], name="hand", law=P(5.0)), name="hand"),
        Level(Orientation(frame=robot.landmarks["base"][0], axes=("roll", "pitch"), name="trunk"), name="trunk"),
        Level(Posture(), name="posture"),
        subject_to=[JointLimits()],
    )


@pytest.fixture(scope="module")
def robots() -> dict[str, Robot]:
    missing = [name for name in ROBOTS if name not in hqp.robots.names()]
    if missing:
        pytest.skip(f"needs example-robot-data for {missing}")
    return {name: hqp.robots.load(name) for name in ROBOTS}


def residuals(robot: Robot, solver: str, q: np.ndarray, hand: np.ndarray, tilt: np.ndarray) -> list[float]:
    controller = hqp.Controller(stack(robot), solver=solver, deadline=math.inf)
    session = controller.session(robot, 0.002)
    session.step(robot.state())  # hold values at home
    task, trunk = session.stack.find("hand", Position), session.stack.find("trunk", Orientation)
    tick = session.step(robot.state(q), task.at(hand), trunk.at(tilt))
    assert tick.status in (Status.OPTIMAL, Status.RANK_UNCERTAIN), tick.notes
    assert tick.solution is not None
    return tick.solution.norms.tolist()


SEEDS, REACHES = st.integers(0, 2**16), st.floats(0.0, 3.0)


@pytest.mark.long
@pytest.mark.parametrize("robot_name", ROBOTS)
@settings(max_examples=15, suppress_health_check=[HealthCheck.function_scoped_fixture])
@given(seed=SEEDS, reach=REACHES)
def test_lower_references_never_move_higher_residuals(
    robots: dict[str, Robot], robot_name: str, seed: int, reach: float
) -> None:
    keeps(robots[robot_name], "lexicographic", seed, reach)


@settings(max_examples=4, suppress_health_check=[HealthCheck.function_scoped_fixture])
@given(seed=SEEDS, reach=REACHES)
def test_nor_with_a_cascade(robots: dict[str, Robot], seed: int, reach: float) -> None:
    """Every level is exact there: few examples, on the smallest robot."""
    keeps(robots["g1"], "cascade:proxqp", seed, reach)


def keeps(robot: Robot, solver: str, seed: int, reach: float) -> None:
    """Another target of the hand or another tilt changes no residual above it."""
    rng = np.random.default_rng(seed)
    q = robot.integrate(robot.home, 0.05 * rng.standard_normal(robot.nv), 1.0)
    palm = robot.state(q).position(robot.landmarks["palms"][1])
    goals = [palm + reach * rng.uniform(-1.0, 1.0, 3) for _ in range(2)]
    tilts = [rng.uniform(-1.0, 1.0, 2) for _ in range(2)]
    same_hand = [residuals(robot, solver, q, goals[0], tilt) for tilt in tilts]
    other_hand = residuals(robot, solver, q, goals[1], tilts[0])
    scale = 1.0 + 5.0 * reach
    # limits and balance for any hand target; limits, balance and hand for any trunk target: equal to rounding, or up to
    # the gain of the levels below: ||A (x - x_a)||^2 / (2 eta omega) is at most that
    room = 1e-8 * scale + np.sqrt(2.0 * ETA * scale * np.minimum(*np.array(same_hand)))
    assert np.all(np.abs(np.subtract(same_hand[0], other_hand))[:2] < 1e-8 * scale)
    assert np.all(np.abs(np.subtract(*same_hand))[:3] < room[:3])
