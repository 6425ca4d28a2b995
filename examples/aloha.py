"""mink's arm_aloha: two arms with one target stay apart over a table with a cube.  Needs gym-aloha.

The model comes from the package gym-aloha: ``pip install --no-deps gym-aloha``, or give the folder of its assets.
"""

import sys
from importlib.util import find_spec
from pathlib import Path

import numpy as np

import hqp
from hqp import Level, P, Stack, shapes
from hqp.tasks import CollisionAvoidance, JointLimits, Pose, Posture

folder = Path(sys.argv[1]) if len(sys.argv) > 1 else Path(find_spec("gym_aloha").origin).parent / "assets"
robot = hqp.robots.load(folder / "bimanual_viperx_transfer_cube.xml")
arms = [j for j in robot.joint_names if "finger" not in j]
grippers = [Pose(frame=f"vx300s_{s}/gripper_link", law=P(4.0, max_velocity=0.5), name=s) for s in ("left", "right")]
own = [[c.name for c in robot.capsules if c.name.startswith(f"vx300s_{s}")] for s in ("left", "right")]
table = shapes.half_space("table")
between = [(one, two) for one in own[0] for two in own[1]]
fingers = [(name, "table") for arm in own for name in arm if "finger" in name or "gripper" in name]
apart = CollisionAvoidance(pairs=(*between, *fingers), world=table, clearance=0.02)
stack = Stack(
    Level(*grippers, name="hands"),
    Level(Posture(law=P(1.0))),
    subject_to=[JointLimits(), apart],
)
session = hqp.Controller(stack).session(robot, dt=0.005)
q, v, least = robot.configurations["key_0"], np.zeros(robot.nv), np.inf
state = robot.state(q)
goals = [g.value(state) for g in grippers]
middle = 0.5 * (goals[0][:3, 3] + goals[1][:3, 3])
for goal in goals:
    goal[:3, 3] = middle
references = [g.at(goal) for g, goal in zip(grippers, goals, strict=True)]
for _ in range(800):
    q, v = session.step(robot.state(q, v), *references).advance()
    least = min([least, *(n.distance for n in apart.near(robot.state(q)) if n is not None)])
state = robot.state(q)
left = [float(np.linalg.norm(state.position(g.frame) - middle)) for g in grippers]
print(f"both asked to the middle: {100 * left[0]:.1f} and {100 * left[1]:.1f} cm short, {1e3 * least:.1f} mm apart")
assert least > 0.0195
assert set(robot.obstacles.bodies) == {"box"}  # no actuator moves the cube
assert max(left) < 0.2
