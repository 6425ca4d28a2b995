"""Changes of stack at velocity level keep the acceleration of JointLimits, however low."""

from __future__ import annotations

import numpy as np
import pytest

import hqp
from hqp import Level, P, Stack
from hqp.tasks import JointLimits, Orientation, Position, Posture


@pytest.mark.parametrize("seed", range(6))
@pytest.mark.parametrize(("name", "palm"), [("ur5", "tool0"), ("panda", "panda_hand_tcp")])
def test_no_command_leaves_the_window(name: str, palm: str, seed: int) -> None:
    """Drawn goals beyond reach and drawn changes at once, within drawn times, and before another has ended."""
    robot, rng = hqp.robots.load(name), np.random.default_rng(seed)
    dt = float(rng.choice([0.001, 0.002, 0.005]))
    limits = [JointLimits(acceleration=float(a)) for a in rng.uniform(1.0, 6.0, 2)]
    hand = Position(frame=palm, law=P(float(rng.uniform(5.0, 30.0))), name="hand")
    turn = Orientation(frame=palm, law=P(float(rng.uniform(5.0, 30.0))), name="turn")

    def drawn(limit: JointLimits) -> Stack:
        tasks = [hand, turn][: rng.integers(1, 3)]
        rng.shuffle(tasks)
        return Stack(*map(Level, tasks), Level(Posture(law=P(float(rng.uniform(1.0, 9.0))))), subject_to=[limit])

    widest = max(limit.rates(robot)[0][0] for limit in limits)
    session = hqp.Controller(drawn(limits[0]), hqp.Velocity(), deadline=np.inf).session(robot, dt)
    q, v = robot.home.copy(), np.zeros(robot.nv)
    goal, last, changes = robot.state(q).position(palm), np.zeros(len(robot.joint_names)), 0
    for _ in range(400):
        if rng.random() < 0.02:
            session.change(drawn(limits[rng.integers(2)]), over=float(rng.choice([0.0, 0.05, 0.3])))
            changes += 1
        if rng.random() < 0.02:
            goal = robot.state(robot.home).position(palm) + rng.normal(size=3)
        tick = session.step(robot.state(q, v), hand.at(goal))
        assert np.abs(tick.command - last).max() <= widest * dt + 1e-9
        last, (q, v) = tick.command.copy(), tick.advance()
    assert changes > 2
