"""mink's tidybot: an arm on an omnidirectional base follows a circle, by the arm first or by the base first.

A Kinova Gen3 on the Omron base of robosuite, assembled by MuJoCo: ``pip install --no-deps robosuite``, or give the
folder of its assets.  The order of two postures below the hand selects whether base or arm moves if both can.
"""

import math
import sys
import tempfile
from importlib.util import find_spec
from pathlib import Path

import mujoco
import numpy as np

import hqp
from hqp import Level, P, Stack
from hqp.tasks import JointLimits, Pose, Posture

given = Path(sys.argv[1]) if len(sys.argv) > 1 else None
folder = given or Path(find_spec("robosuite").origin).parent / "models/assets"
base = mujoco.MjSpec.from_file(str(folder / "bases/omron_mobile_base.xml"))
arm = mujoco.MjSpec.from_file(str(folder / "robots/kinova3/robot.xml"))
for spec, place in ((base, "bases"), (arm, "robots/kinova3")):
    spec.compiler.degree = False
    for mesh in spec.meshes:
        mesh.file = str((folder / place / mesh.file).resolve())
base.attach(arm, site=base.site("center"), prefix="arm/")
base.add_key(name="home", qpos=[0.0] * 4 + [0.0, 0.65, 0.0, 1.89, 0.0, 0.6, -math.pi / 2])
base.compile()
with tempfile.TemporaryDirectory() as scratch:
    path = Path(scratch) / "tidybot.xml"
    path.write_text(base.to_xml())
    robot = hqp.robots.load(path)
print(robot)
wheels = [f"joint_mobile_{way}" for way in ("forward", "side", "yaw")]
joints = [name for name in robot.joint_names if name not in wheels]
hand = Pose(frame="arm/right_hand", law=P(5.0, max_velocity=1.0))
keep, stand = Posture(joints=joints, law=P(1.0), name="arm"), Posture(joints=wheels, law=P(1.0), name="base")
for title, first, second in (("the arm moves first", stand, keep), ("the base moves first", keep, stand)):
    stack = Stack(Level(hand), Level(first), Level(second), subject_to=[JointLimits()])
    session = hqp.Controller(stack).session(robot, dt=0.005)
    q, v, error, driven, start = robot.home, np.zeros(robot.nv), 0.0, 0.0, hand.value(robot.state())
    for k in range(1200):
        turning, goal = 2.0 * math.pi / 5.0, start.copy()
        w = turning * min(0.005 * k, 5.0)  # [rad]
        goal[:2, 3] += [0.25 * math.sin(w), 0.25 * (1.0 - math.cos(w))]  # a circle of 50 cm
        speed = 0.25 * turning * (k < 1000) * np.array([math.cos(w), math.sin(w), 0.0, 0.0, 0.0, 0.0])
        q, v = session.step(robot.state(q, v), hand.at(goal, velocity=speed)).advance()
        driven = max(driven, math.hypot(*q[robot.joints(wheels[:2])]))
        if k > 200:
            error = max(error, float(np.linalg.norm(robot.state(q).position(hand.frame) - goal[:3, 3])))
    print(f"{title}: hand within {1e3 * error:.1f} mm of a circle, the base up to {100 * driven:.0f} cm away")
    assert error < 0.005
    assert (driven > 0.4) == (first is keep)
