"""Coupled joints stay coupled through any number of turns; a follower with an error returns.

Positions with turns are the sum of the velocities that a loop integrates, by Pinocchio's integration of q.
"""

from __future__ import annotations

from collections.abc import Iterator
from pathlib import Path

import numpy as np
import pytest

import hqp
from hqp import PD, Level, P, Stack
from hqp.angles import nearest_turns
from hqp.arrays import Mat, Vec
from hqp.declare.robot import State
from hqp.export.loaded import LoadedSession
from hqp.loop.file import text
from hqp.solvers.lexicographic import kernel
from hqp.tasks import JointCoupling, Posture
from tests.scenes.coupled import Coupled, draw

LEVELS = {"velocity": hqp.Velocity, "acceleration": hqp.Acceleration, "torque": hqp.Torque}
SEEDS = range(6)
DT = 0.01


def leading(level: str) -> tuple[hqp.Controller, Posture]:
    law = P(8.0) if level == "velocity" else PD(64.0, 16.0)
    lead = Posture(joints=["j0"], law=law, name="lead")
    return hqp.Controller(Stack(Level(lead)), LEVELS[level](), deadline=np.inf), lead


def turns(robot: hqp.robots.Robot, q: Vec, last: Vec) -> Vec:
    """Positions of the joints at q with turns, nearest to the last ones."""
    at, turning = robot.state(q).angles, robot.continuous
    at[turning] += 2 * np.pi * np.round((last - at)[turning] / (2 * np.pi))
    return at


def loop(coupled: Coupled, level: str, start: float, goal: float, ticks: int, restart: int) -> Iterator[Vec]:
    """Positions with turns after each tick, while j0 moves from start to goal; a new session every ``restart``."""
    robot = coupled.robot
    controller, lead = leading(level)
    at = coupled.angles(start)
    q, v = robot.configuration(at), np.zeros(robot.nv)
    column = int(robot.joints("j0")[0])
    for k in range(ticks):
        if k % restart == 0:
            session = controller.session(robot, DT)
        here = start + (goal - start) * min(1.0, k / (0.7 * ticks))
        aim = here + robot.state(q).angles[column] - at[column]  # turns of the target cancel
        tick = session.step(robot.state(q, v), lead.at([aim]))
        assert tick.status.usable, tick.notes
        q, v = tick.advance()
        at = turns(robot, q, at)
        yield at


@pytest.mark.parametrize("level", LEVELS)
@pytest.mark.parametrize("seed", SEEDS)
def test_followers_follow_through_turns(level: str, seed: int, tmp_path: Path) -> None:
    rng = np.random.default_rng(seed)
    coupled = draw(rng, tmp_path)
    start, goal = rng.uniform(-50, 50), rng.uniform(-50, 50)
    goal = start + float(np.clip(goal - start, -25, 25))
    found = list(loop(coupled, level, start, goal, 400, int(rng.integers(50, 400))))
    assert max(map(coupled.off, found)) < 1e-3
    column = int(coupled.robot.joints("j0")[0])
    assert abs(found[-1][column] - goal) < 0.1


@pytest.mark.parametrize("level", LEVELS)
@pytest.mark.parametrize("kind", ["continuous", "revolute", "prismatic"])
@pytest.mark.parametrize("seed", SEEDS[:3])
def test_a_follower_that_is_off_comes_back(kind: str, level: str, seed: int, tmp_path: Path) -> None:
    rng = np.random.default_rng(seed)
    coupled = draw(rng, tmp_path, kind)
    robot = coupled.robot
    controller, _ = leading(level)
    at = coupled.angles(float(rng.uniform(-1, 1)))
    for f in coupled.followers:
        at[robot.joints(f.joint)] += 0.15 * rng.uniform(-1, 1)
    q, v = robot.configuration(at), np.zeros(robot.nv)
    begun = coupled.off(at)
    session = controller.session(robot, DT)
    for _ in range(500):
        tick = session.step(robot.state(q, v))
        q, v = tick.advance()
        at = turns(robot, q, at)
    assert coupled.off(at) < 1e-3 * max(begun, 1.0)
    assert np.abs(v).max() < 1e-3


@pytest.mark.skipif(not kernel(), reason="no native kernel here")
@pytest.mark.parametrize("level", LEVELS)
def test_session_file_and_batch_count_the_same_turns(level: str, tmp_path: Path) -> None:
    rng = np.random.default_rng(7)
    coupled = draw(rng, tmp_path)
    robot = coupled.robot
    controller, lead = leading(level)
    session = controller.session(robot, DT)
    file = LoadedSession(text(session))
    batch = hqp.Batch(controller, robot, 2, DT, threads=1)
    other = robot.configuration(coupled.angles(-31.0))  # the other world, many turns away
    q, v = robot.configuration(coupled.angles(17.0)), np.zeros(robot.nv)
    for k in range(300):
        aim = np.array([17.0 + 0.05 * k])
        tick, found = session.step(robot.state(q, v), lead.at(aim)), file.step(q, v, {"lead": (aim,)})
        both = batch.step(np.array([other, q]), np.array([np.zeros(robot.nv), v]), {"lead": np.array([aim, aim])})
        np.testing.assert_array_equal(found.x, tick.x, err_msg=f"tick {k}")
        np.testing.assert_array_equal(both.x[1], tick.x, err_msg=f"tick {k}")
        q, v = tick.advance()


class OwnCoupling(JointCoupling):
    """User coupling: its readable functions write the rows."""

    def jacobian(self, state: State) -> Mat:
        """Return the built-in Jacobian."""
        return super().jacobian(state)


@pytest.mark.parametrize("coupling", [JointCoupling, OwnCoupling])
def test_a_differential_of_continuous_joints(coupling: type[JointCoupling], tmp_path: Path) -> None:
    coupled = draw(np.random.default_rng(3), tmp_path)
    robot = coupled.robot
    robot.description.couplings.clear()  # type: ignore[union-attr]
    terms = {"j0": 1.0, "j1": -0.5, "j2": -0.5} if robot.nv > 2 else {"j0": 1.0, "j1": -0.5}
    both = coupling(terms, name="both")
    lead = Posture(joints=["j0"], law=P(8.0), name="lead")
    session = hqp.Controller(Stack(Level(lead), subject_to=[both]), deadline=np.inf).session(robot, DT)
    at = np.zeros(robot.nv)
    q, v = robot.configuration(at), np.zeros(robot.nv)
    for k in range(400):
        tick = session.step(robot.state(q, v), lead.at([0.05 * k]))
        q, v = tick.advance()
        at = turns(robot, q, at)
        assert abs(sum(c * at[robot.joints(n)[0]] for n, c in terms.items())) < 1e-6
    assert abs(at[robot.joints("j0")[0]] - 20.0) < 1.0


def test_turns_are_the_fewest_with_the_least_error() -> None:
    rng = np.random.default_rng(0)
    for _ in range(200):
        n = int(rng.integers(1, 4))
        sizes, turns = rng.choice([-2.0, -0.5, 0.1, 0.25, 1.0, 3.0], n), rng.integers(-4, 5, n)
        rest = rng.uniform(-0.1, 0.1)  # less than half of their smallest step, 0.05 turns
        found = nearest_turns(rest - 2 * np.pi * float(sizes @ turns), sizes)
        assert abs(abs(2 * np.pi * float(sizes @ (found - turns)) + rest) - abs(rest)) < 1e-6
        assert np.abs(found).sum() <= np.abs(turns).sum()
    np.testing.assert_array_equal(nearest_turns(0.3, np.array([1.0, -0.5])), 0.0)


def test_a_coupling_of_one_joint_holds_a_joint_without_a_motor(tmp_path: Path) -> None:
    path = tmp_path / "arm.xml"
    path.write_text(
        '<mujoco><worldbody><body><joint name="arm" axis="0 1 0"/><geom size="0.1" pos="0.3 0 0"/>'
        '<body pos="0.5 0 0"><joint name="spring" axis="0 1 0"/><geom size="0.1" pos="0.2 0 0.1"/>'
        "</body></body></worldbody>"
        '<actuator><motor joint="arm"/></actuator></mujoco>',
        encoding="utf-8",
    )
    robot, lead = hqp.robots.load(path), Posture(joints=["arm"], law=PD(64.0, 16.0))
    with pytest.raises(hqp.errors.DeclarationError, match="a JointCoupling of a single joint holds it at its offset"):
        hqp.Controller(Stack(Level(lead)), hqp.Torque()).session(robot, DT)
    stack = Stack(Level(lead), subject_to=[JointCoupling({"spring": 1.0}, offset=0.3)])
    session = hqp.Controller(stack, hqp.Torque(), deadline=np.inf).session(robot, DT)
    q, v = robot.configuration([0.0, 0.3]), np.zeros(2)
    for _ in range(200):
        q, v = session.step(robot.state(q, v), lead.at([0.5])).advance()
    np.testing.assert_allclose(robot.state(q).angles, [0.5, 0.3], atol=1e-3)
