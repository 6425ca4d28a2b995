"""A UR5 in reduced-speed mode: its tool stays below 250 mm/s and 0.5 rad/s after any jump of the goal."""

import numpy as np

import hqp
from hqp import Level, P, Stack
from hqp.tasks import FrameVelocityLimits, JointLimits, Position, Posture

robot, frame, dt = hqp.robots.load("ur5"), "tool0", 0.002
hand = Position(frame=frame, law=P(5.0), name="hand")
slow = FrameVelocityLimits(frame=frame, linear=0.25, angular=0.5)
stack = Stack(Level(hand), Level(Posture()), subject_to=[JointLimits(), slow])
session = hqp.Controller(stack, braking=hqp.Braking(resume="ask")).session(robot, dt)

q, v, fastest = robot.home, np.zeros(robot.nv), 0.0
start = robot.state(q).position(frame).copy()
for k in range(1500):
    before = robot.state(q, v).position(frame).copy()
    tick = session.step(robot.state(q, v), hand.at(start + [-0.2, 0.3, 0.2 if k < 750 else -0.3]))
    q, v = tick.advance()
    fastest = max(fastest, float(np.linalg.norm(robot.state(q).position(frame) - before)) / dt)
print(f"fastest: {1e3 * fastest:.1f} mm/s of 250")
assert 0.24 < fastest < 0.25
