"""pink's mobile bases (stretch, mobile_omni): the hand of Tiago on an omnidirectional base follows a circle.

The base is a planar joint at the root; the order of two postures below the hand selects whether base or arm moves.
"""

import math

import numpy as np
import pinocchio as pin

import hqp
from hqp import Level, P, Stack
from hqp.tasks import JointLimits, Pose, Posture

fixed = hqp.robots.load("tiago", floating=False)
model = pin.buildModelFromUrdf(str(fixed.source), pin.JointModelPlanar())
home = pin.neutral(model)
for joint, angle in {"arm_1_joint": 0.5, "arm_2_joint": 0.2, "arm_4_joint": 1.2, "arm_6_joint": 0.4}.items():
    home[model.joints[model.getJointId(joint)].idx_q] = angle
robot = hqp.robots.Robot(model, name="tiago on wheels", home=home)
base, arm = model.names[1], [name for name in robot.joint_names if name.startswith(("arm", "torso"))]
hand = Pose(frame="arm_tool_link", law=P(5.0, max_velocity=1.0))
keep = Posture(joints=arm, law=P(1.0), name="arm")
stand = Posture(joints=base, law=P(1.0), name="base")
reach_first = Stack(Level(hand), Level(stand), Level(keep), subject_to=[JointLimits(joints=arm)])
drive_first = Stack(Level(hand), Level(keep), Level(stand), subject_to=[JointLimits(joints=arm)])

for title, stack in (("the arm moves before the base", reach_first), ("the base moves before the arm", drive_first)):
    session = hqp.Controller(stack, braking=hqp.Braking(resume="ask")).session(robot, dt=0.005)
    q, v, error, driven = robot.home, np.zeros(robot.nv), 0.0, 0.0
    start = hand.value(robot.state(q))
    for k in range(1200):
        t, turning = 0.005 * k, 2.0 * math.pi / 5.0  # [s], [rad/s]
        w, rate = turning * min(t, 5.0), turning if t < 5.0 else 0.0
        goal = start.copy()
        goal[:2, 3] += [0.4 * math.sin(w), 0.4 * (1.0 - math.cos(w))]  # a circle of 80 cm
        velocity = 0.4 * rate * np.array([math.cos(w), math.sin(w), 0.0, 0.0, 0.0, 0.0])
        q, v = session.step(robot.state(q, v), hand.at(goal, velocity=velocity)).advance()
        driven = max(driven, math.hypot(q[0], q[1]))
        if t > 1.0:
            error = max(error, float(np.linalg.norm(robot.state(q).position(hand.frame) - goal[:3, 3])))
    print(f"{title}: hand within {1e3 * error:.1f} mm of a circle, the base up to {100 * driven:.0f} cm away")
    assert np.linalg.norm(hand.error(robot.state(q), goal)) < 1e-3
