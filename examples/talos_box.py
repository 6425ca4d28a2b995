"""Talos lifts a box with both hands beside a wall, keeps its balance over the soles and looks at the box."""

import numpy as np

import hqp
from hqp import Level, P, Stack
from hqp.tasks import Cone, FixedContact, JointLimits, LookAt, Momentum, Position, Posture, SupportPolygon, Weld, Within

robot = hqp.robots.load("talos")
left, right = robot.landmarks["palms"]
feet = [FixedContact(frame=sole) for sole in robot.landmarks["soles"]]
box = Weld(frame=left, relative_to=right, name="box")  # both hands are fixed to the box
balance = SupportPolygon(sole=(-0.1, 0.1, -0.05, 0.05), margin=0.02)
gaze = Cone(LookAt(frame="rgbd_optical_frame", axis=(0.0, 0.0, 1.0)), angle=0.35, name="gaze", recovery=1.0)
start = robot.state().position(left)
wall = Within(Position(frame=left, axes="y"), upper=float(start[1]) + 0.08, name="wall")
hand = Position(frame=left, law=P(4.0, max_velocity=0.3), name="hand")
spin = Momentum(linear="", angular="z", name="spin")  # no turn about the vertical
stack = Stack(
    Level(hand, name="lift"),
    Level(spin),
    Level(Posture(law=P(1.0))),
    subject_to=[*feet, JointLimits(), box, balance, gaze, wall],
)
session = hqp.Controller(stack).session(robot, dt=0.002)

q, v = robot.home, np.zeros(robot.nv)
between = box.value(robot.state(q)).copy()
goal = start + [0.15, 0.2, 0.2]  # 12 cm of it behind the wall
for _ in range(2000):
    state = robot.state(q, v)
    middle = 0.5 * (state.position(left) + state.position(right))
    tick = session.step(state, hand.at(goal), gaze.at(middle))
    q, v = tick.advance()
print(session.explain(tick))

state = robot.state(q)
ways = balance.among(list(stack)).bounds(state)[1]
angle = np.linalg.norm(gaze.task.error(state, 0.5 * (state.position(left) + state.position(right))))
print(f"wall: {100 * (state.position(left)[1] - start[1]):.2f} cm of 8; balance: {100 * ways.min():.1f} cm to spare")
print(f"gaze: {angle:.3f} rad of 0.35; the hands moved {np.abs(box.value(state) - between).max():.1e} m apart")
assert state.position(left)[1] - start[1] < 0.0801
assert ways.min() > -1e-4
assert angle < 0.352
assert np.abs(box.value(state) - between).max() < 1e-4
