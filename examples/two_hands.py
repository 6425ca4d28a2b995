"""One hand before the other: the left one deviates if both targets are incompatible."""

import numpy as np

import hqp
from hqp import Level, P, Stack
from hqp.tasks import Com, FixedContact, JointLimits, Position, Posture

robot = hqp.robots.load("talos")
left, right = (
    Position(frame=palm, law=P(4.0, max_velocity=0.4), name=name)
    for palm, name in zip(robot.landmarks["palms"], ("left", "right"), strict=True)
)
feet = [FixedContact(frame=sole) for sole in robot.landmarks["soles"]]
stack = Stack(
    Level(*feet, Com(axes="xy")), Level(right), Level(left), Level(Posture(law=P(1.0))), subject_to=[JointLimits()]
)
session = hqp.Controller(stack).session(robot, dt=0.002)
q, v = robot.home, np.zeros(robot.nv)
state = robot.state(q)
goals = right.at(state.position(right.frame) + [0.1, 0.0, 0.1]), left.at(state.position(left.frame) + [0.9, 0.2, 0.2])
for _ in range(1200):
    tick = session.step(robot.state(q, v), *goals)
    q, v = tick.advance()
state = robot.state(q, v)
for task, goal in zip((right, left), goals, strict=True):
    print(f"{task.name}: {100 * np.linalg.norm(state.position(task.frame) - goal.value):.1f} cm off")
assert np.linalg.norm(state.position(right.frame) - goals[0].value) < 0.01
