"""Mistry, Nakanishi, Cheng, Schaal 2008: a humanoid draws a figure 8 while it balances, eqs. (12) to (17)."""

import numpy as np

import hqp
from hqp import Level, P, Stack
from hqp.tasks import Com, FixedContact, JointLimits, Orientation, Position, Posture

robot = hqp.robots.load("cbi")
hand = Position(frame="r_palm", law=P(5.0))
stack = Stack(
    Level(FixedContact(frame="l_sole"), FixedContact(frame="r_sole"), Com(axes="xy", law=P(2.0)), name="critical"),
    Level(hand, name="functional"),
    Level(Orientation(frame="pelvis", law=P(2.0)), Com(axes="z", law=P(2.0), name="com_z"), name="extraneous"),
    Level(Posture(law=P(1.0)), name="posture"),
    subject_to=[JointLimits()],
)
session = hqp.Controller(stack).session(robot, dt=0.002)
q, v = robot.home, np.zeros(robot.nv)
centre, worst = robot.state(q).position("r_palm"), 0.0
for k in range(1500):
    t, w = 0.002 * k, 2.0 * np.pi / 3.0
    goal = centre + [0.0, 0.08 * np.sin(w * t), 0.04 * np.sin(2 * w * t)]
    rate = [0.0, 0.08 * w * np.cos(w * t), 0.08 * w * np.cos(2 * w * t)]
    tick = session.step(robot.state(q, v), hand.at(goal, velocity=rate))
    q, v = tick.advance()
    if t > 1.0:
        worst = max(worst, float(np.linalg.norm(robot.state(q).position("r_palm") - goal)))
print(f"{stack}\nhand at most {1e3 * worst:.2f} mm off")
assert worst < 2e-3
