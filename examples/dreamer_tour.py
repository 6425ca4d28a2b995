"""Dreamer shows a guest around: on three omni wheels to the next room, slowly, its finger at a picture all the way."""

import math

import numpy as np

import hqp
from hqp import Level, P, Stack
from hqp.tasks import BaseVelocityLimits, Frozen, JointLimits, LookAt, OmniWheelContact, Orientation, Position, Posture

robot = hqp.robots.load("dreamer")
base = Position(frame="base", axes="xy", law=P(2.0), name="place")
heading = Orientation(frame="base", axes="yaw", law=P(2.0), name="heading")
finger = LookAt(frame="hand", axis=(0.0, 0.0, -1.0), law=P(2.0, max_velocity=0.5), name="finger")
wheels = [OmniWheelContact(wheel=wheel) for wheel in robot.wheels]
slowly = BaseVelocityLimits(linear=0.3, angular=0.4)
stack = Stack(
    Level(base, heading),
    Level(finger),
    Level(Posture(law=P(1.0), joints="arm")),
    subject_to=[*wheels, Frozen(joints="torso"), JointLimits(), slowly],
)
session = hqp.Controller(stack, deadline=math.inf).session(robot, dt=0.002)
q, v = robot.home, np.zeros(robot.nv)
picture, goal, turn = np.array([2.0, 1.5, 1.4]), [1.2, -0.8], 1.2
fast = spin = 0.0
for _ in range(4000):
    tick = session.step(robot.state(q, v), base.at(goal), heading.at(turn), finger.at(picture))
    q, v = tick.advance()
    fast, spin = max(fast, np.abs(v[:3]).max()), max(spin, np.abs(v[3:6]).max())
print(session.explain(tick))
state = robot.state(q)
off, aside = np.linalg.norm(state.position("base")[:2] - goal), np.linalg.norm(finger.error(state, picture))
print(f"there to {1e3 * off:.2f} mm, at {fast:.3f} m/s and {spin:.3f} rad/s; finger {1e3 * aside:.2f} mrad aside")
assert off < 1e-3
assert fast < 0.3001
assert spin < 0.4001
assert aside < 1e-3
