"""mink's hands with a cube: a Shadow hand grasps it with three fingers and turns it.  Needs gymnasium-robotics.

The package's model has a hand and a free cube: ``pip install --no-deps gymnasium-robotics``, or give the file.
`reach` finds the grasp: fingertips at places on the cube, at any pose of the cube within reach.  Then constraints in
``subject_to`` hold the tips on the cube, and a task on the cube's pose moves the fingers.
"""

import sys
from importlib.util import find_spec
from pathlib import Path

import numpy as np
import pinocchio as pin

import hqp
from hqp import Level, P, Stack
from hqp.tasks import JointLimits, Pose, Position, Posture

FILE = "envs/assets/hand/manipulate_block.xml"
file = Path(sys.argv[1]) if len(sys.argv) > 1 else Path(find_spec("gymnasium_robotics").origin).parent / FILE
robot = hqp.robots.load(file, root=("robot0:hand mount", "object"))  # the fingers move the cube: part of the robot
off = 0.025 + 0.008  # half of the cube, and a tip [m]
PLACES = {"th": (off, 0.0, 0.0), "ff": (-off, 0.0, -0.012), "mf": (-off, 0.0, 0.012)}
tips = {k: Position(frame=f"robot0:S_{k}tip", relative_to="object", name=k) for k in PLACES}
at = [tips[k].at(place) for k, place in PLACES.items()]
posture = Posture(joints=robot.joint_names)
grasp = Stack(Level(*tips.values()), Level(posture), subject_to=[JointLimits()])
found = hqp.reach(grasp, robot, *at, tolerance=1e-5, budget=10.0)
assert found.success, found.reason

cube = Pose(frame="object", law=P(10.0), name="cube")
turn = Stack(Level(cube), Level(posture), subject_to=[*tips.values(), JointLimits()])
session = hqp.Controller(turn, deadline=np.inf).session(robot, dt=0.005)
q, v, slid, error = found.q, np.zeros(robot.nv), 0.0, 0.0
start = cube.value(robot.state(q))
for k in range(1200):
    t = 0.005 * k
    goal = start.copy()
    goal[:3, :3] = start[:3, :3] @ pin.exp3(np.array([0.2 * np.sin(2.0 * t), 0.1 * np.sin(t), 0.0]))
    goal[2, 3] += 0.005 * np.sin(t)
    q, v = session.step(robot.state(q, v), cube.at(goal), *at).advance()
    state = robot.state(q)
    slid = max([slid, *(float(np.linalg.norm(tips[f].error(state, PLACES[f]))) for f in tips)])
    error = max(error, float(np.linalg.norm(cube.error(state, goal)[3:])))
print(f"grasp found in {1e3 * found.time:.0f} ms from {found.starts} starts")
print(f"the cube turned within {np.degrees(error):.1f} degrees of its goal, tips slid by {1e3 * slid:.3f} mm at most")
assert slid < 1e-4
assert error < 0.1
