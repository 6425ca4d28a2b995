"""A target out of reach: an explanation names the tasks that hold it back, and commands stay calm."""

import numpy as np

import hqp
from hqp import Level, P, Stack
from hqp.tasks import Com, FixedContact, JointLimits, Position, Posture

robot = hqp.robots.load("g1")
hand = Position(frame="right_wrist_yaw_link", law=P(5.0, max_velocity=0.5), name="hand")
feet = [FixedContact(frame=sole) for sole in robot.landmarks["soles"]]
stack = Stack(
    Level(*feet, Com(axes="xy", law=P(2.0)), name="balance"),
    Level(hand, name="hand"),
    Level(Posture(law=P(1.0)), name="posture"),
    subject_to=[JointLimits()],
)
session = hqp.Controller(stack).session(robot, dt=0.002)
q, v = robot.home, np.zeros(robot.nv)
goal = robot.state(q).position(hand.frame) + [1.0, 0.0, 0.3]
last, jump = np.zeros(len(robot.joint_names)), 0.0
for _ in range(1500):
    tick = session.step(robot.state(q, v), hand.at(goal))
    jump, last = max(jump, float(np.abs(tick.command - last).max())), tick.command.copy()
    q, v = tick.advance()
print(tick.explain())
print(f"largest change of a joint's velocity in a tick: {jump:.3f} rad/s")
assert tick.status.usable
