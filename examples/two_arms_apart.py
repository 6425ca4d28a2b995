"""Two arms of Baxter exchange places without contact (pink's yumi: yumi.py)."""

import numpy as np

import hqp
from hqp import Level, P, Stack
from hqp.tasks import CollisionAvoidance, JointLimits, Position, Posture

robot = hqp.robots.load("baxter", floating=False)
joints = {f"{side}_{j}": a for side, sign in (("left", 1), ("right", -1)) for j, a in
          (("s0", -0.6 * sign), ("s1", -0.5), ("e1", 1.6), ("w1", 0.6))}  # fmt: skip
angles = np.zeros(robot.nv)
for name, angle in joints.items():
    angles[robot.joints(name)] = angle
robot.set_home(robot.configuration(angles))
hands = [Position(frame=f"{side}_gripper", law=P(2.0, max_velocity=0.3), name=side) for side in ("left", "right")]
for avoid in (False, True):
    apart = CollisionAvoidance(clearance=0.03)
    stack = Stack(Level(*hands), Level(Posture(law=P(1.0))), subject_to=[JointLimits(), *([apart] if avoid else [])])
    session = hqp.Controller(stack, braking=hqp.Braking(resume="ask")).session(robot, dt=0.005)
    q, v, least, who = robot.home, np.zeros(robot.nv), np.inf, ""
    state = robot.state(q)
    left, right = (state.position(hand.frame) for hand in hands)
    for _ in range(800):
        tick = session.step(robot.state(q, v), hands[0].at(right), hands[1].at(left))
        q, v = tick.advance()
        least = min([least, *(n.distance - n.clearance for n in apart.near(robot.state(q)) if n is not None)])
    print(f"{'with' if avoid else 'without'} collision avoidance: nearest pair {1e3 * least:.1f} mm over its clearance")
assert least > -1e-3
