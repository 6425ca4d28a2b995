"""pink's and mink's stretch: its wheels roll without slip while the hand rests.  Needs hello-robot-stretch-urdf.

The model comes from the package: ``pip install --no-deps hello-robot-stretch-urdf``, or give the file.  Rolling
wheels in ``subject_to`` restrict the base to turns and forward motion.  The target is to drive straight on, but the
base drives around the hand, which has priority.
"""

import math
import sys
from importlib.util import find_spec
from pathlib import Path

import numpy as np
import pinocchio as pin

import hqp
from hqp import Level, P, Stack
from hqp.robots import Wheel
from hqp.tasks import JointCoupling, JointLimits, JointVelocity, Position, Posture, WheelContact

FILE = "SE3/stretch_description_SE3_eoa_wrist_dw3_tool_sg3.urdf"
file = Path(sys.argv[1]) if len(sys.argv) > 1 else Path(find_spec("stretch_urdf").origin).parent / FILE
model = pin.buildModelFromUrdf(str(file), pin.JointModelPlanar())
home = pin.neutral(model)
ARM = [f"joint_arm_l{k}" for k in range(4)]
for joint, angle in {"joint_lift": 0.6, **dict.fromkeys(ARM, 0.06), "joint_wrist_yaw": 0.4}.items():
    home[model.joints[model.getJointId(joint)].idx_q] = angle
radius = 0.0508  # [m]
wheels = {f"link_{side}_wheel": Wheel(radius, (0.0, 0.0, 1.0)) for side in ("left", "right")}
moving = ["joint_lift", *ARM, "joint_wrist_yaw", "joint_wrist_pitch", "joint_wrist_roll"]
robot = hqp.robots.Robot(
    model, name="stretch", home=home, wheels=wheels, actuated=["joint_left_wheel", "joint_right_wheel", *moving]
)
telescope = [JointCoupling({ARM[0]: 1.0, other: -1.0}, name=f"telescope {other}") for other in ARM[1:]]
rolling = [WheelContact(wheel=wheel, name=wheel) for wheel in wheels]
hand = Position(frame="link_grasp_center", law=P(5.0, max_velocity=0.3))
drive = JointVelocity(joints=["joint_left_wheel", "joint_right_wheel"], name="drive")
stack = Stack(
    Level(hand),
    Level(drive),
    Level(Posture(joints=moving, law=P(1.0))),
    subject_to=[*rolling, *telescope, JointLimits(joints=moving)],
)
session = hqp.Controller(stack).session(robot, dt=0.01)
q, v, off, slid, way = robot.home, np.zeros(robot.nv), 0.0, 0.0, 0.0
place = robot.state(q).position(hand.frame)
forward = drive.at(velocity=np.full(2, 0.1 / radius))  # 0.1 m/s, straight on
for _ in range(1500):
    q, v = session.step(robot.state(q, v), hand.at(place), forward).advance()
    off = max(off, float(np.linalg.norm(robot.state(q).position(hand.frame) - place)))
    slid, way = max(slid, abs(v[1])), way + 0.01 * v[0]  # the base's velocity is in its own axes
heading = math.degrees(math.atan2(q[3], q[2]))
print(f"the base drove {way:.2f} m, turned to {heading:.0f} degrees and slid sideways at {slid:.0e} m/s at most")
print(f"the hand stayed within {1e3 * off:.2f} mm of its place")
assert off < 1e-3
assert slid < 1e-9
assert way > 0.3
