"""An arm moves to a pose and back: position strictly before orientation, under limits."""

import numpy as np

import hqp
from hqp import Level, P, Stack
from hqp.tasks import JointLimits, Orientation, Position

robot = hqp.robots.load("ur5")
where = Position(frame="tool0", name="position", law=P(5.0, max_velocity=0.5))
turned = Orientation(frame="tool0", name="orientation", law=P(5.0, max_velocity=1.0))
stack = Stack(Level(where), Level(turned), subject_to=[JointLimits()])
session = hqp.Controller(stack, braking=hqp.Braking(resume="ask")).session(robot, dt=0.01)

q, v = robot.integrate(robot.home, np.array([0.3, -1.4, 1.5, -1.2, -1.3, 0.2]), 1.0), np.zeros(robot.nv)
start = robot.state(q).position("tool0")
for goal in (start + [0.1, 0.1, -0.1], start):
    for _ in range(300):
        tick = session.step(robot.state(q, v), where.at(goal))
        q, v = tick.advance()
    error = np.linalg.norm(robot.state(q).position("tool0") - goal)
    print(f"{stack}: {1e3 * error:.3f} mm off, {tick.status.name}")
    assert error < 1e-3
