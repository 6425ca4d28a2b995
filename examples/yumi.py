"""pink's yumi: two arms exchange places without contact.  Needs robosuite-models.

The model comes from the package: ``pip install --no-deps robosuite-models``, or give the path of its robot.xml.
"""

import sys
from importlib.util import find_spec
from pathlib import Path

import numpy as np

import hqp
from hqp import Level, P, Stack
from hqp.tasks import CollisionAvoidance, JointLimits, Position, Posture

if len(sys.argv) > 1:
    path = Path(sys.argv[1])
else:
    path = Path(find_spec("robosuite_models").origin).parent / "assets/robots/yumi/robot.xml"
robot = hqp.robots.load(path, name="yumi")
right = [-0.68, -0.43, -0.35, 0.12, -0.25, 0.83, 1.0]
left = [0.68, -0.43, 0.35, 0.12, 0.25, 0.83, -1.0]
robot.set_home(np.array([*right, *left]))  # arms half extended
hands = [Position(frame=f"yumi_link_7_{side}", law=P(2.0, max_velocity=0.3), name=side) for side in "lr"]
state = robot.state()
left, right = (state.position(hand.frame) for hand in hands)
for avoid in (False, True):
    apart = CollisionAvoidance(clearance=0.03)
    stack = Stack(Level(*hands), Level(Posture(law=P(1.0))), subject_to=[JointLimits(), *([apart] if avoid else [])])
    session = hqp.Controller(stack).session(robot, dt=0.005)
    q, v, least = robot.home, np.zeros(robot.nv), np.inf
    for _ in range(1000):
        q, v = session.step(robot.state(q, v), hands[0].at(right), hands[1].at(left)).advance()
        least = min([least, *(n.distance - n.clearance for n in apart.near(robot.state(q)) if n is not None)])
    print(f"{'with' if avoid else 'without'} collision avoidance: nearest pair {1e3 * least:.1f} mm over its clearance")
    assert avoid == (least > -1e-3)
