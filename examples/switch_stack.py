"""A stack changes while the robot runs: a task is removed and added again."""

import numpy as np

import hqp
from hqp import Level, P, Stack
from hqp.tasks import Com, FixedContact, JointLimits, Position, Posture

robot = hqp.robots.load("cbi")
hand = Position(frame="r_palm", law=P(5.0, max_velocity=0.3))
feet = [FixedContact(frame="l_sole"), FixedContact(frame="r_sole")]
with_hand = Stack(Level(*feet, Com(axes="xy")), Level(hand), Level(Posture(law=P(1.0))), subject_to=[JointLimits()])
without_hand = with_hand.without("r_palm")
session = hqp.Controller(with_hand).session(robot, dt=0.002)
q, v = robot.home, np.zeros(robot.nv)
goal = robot.state(q).position("r_palm") + [0.1, 0.0, 0.1]
for k in range(1500):
    if k in (500, 1000):
        session.change(without_hand if k == 500 else with_hand)
    references = [hand.at(goal)] if "r_palm" in session else []
    tick = session.step(robot.state(q, v), *references)
    q, v = tick.advance()
    if k % 500 == 499:
        print(f"{session.stack}: hand {100 * np.linalg.norm(robot.state(q, v).position('r_palm') - goal):.1f} cm off")
assert np.linalg.norm(robot.state(q, v).position("r_palm") - goal) < 0.02
