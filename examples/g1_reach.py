"""A humanoid reaches while it balances: feet and centre of mass strictly before the hand."""

import numpy as np

import hqp
from hqp import Level, P, Stack
from hqp.tasks import Com, FixedContact, JointLimits, Orientation, Position, Posture

robot = hqp.robots.load("g1")
hand = Position(frame="right_wrist_yaw_link", law=P(5.0, max_velocity=0.5), name="hand")
feet = [FixedContact(frame=sole) for sole in robot.landmarks["soles"]]
stack = Stack(
    Level(*feet, Com(axes="xy", law=P(2.0)), name="balance"),
    Level(hand, name="hand"),
    Level(Orientation(frame="pelvis", law=P(2.0)), name="base"),
    Level(Posture(law=P(1.0)), name="posture"),
    subject_to=[JointLimits()],
)
session = hqp.Controller(stack).session(robot, dt=0.002)
q, v = robot.home, np.zeros(robot.nv)
home = robot.state(q)
goal, centre = home.position(hand.frame) + [0.12, 0.05, 0.15], home.com()
for _ in range(1500):
    tick = session.step(robot.state(q, v), hand.at(goal))
    q, v = tick.advance()
state = robot.state(q, v)
print(stack)
print(f"hand {1e3 * np.linalg.norm(state.position(hand.frame) - goal):.2f} mm off, "
      f"centre of mass moved {1e3 * np.linalg.norm((state.com() - centre)[:2]):.2f} mm")  # fmt: skip
assert np.linalg.norm((state.com() - centre)[:2]) < 1e-3
