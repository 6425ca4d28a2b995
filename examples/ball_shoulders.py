"""Two arms with ball shoulders carry a stick: 40 cm between the hands, shoulders in their cones, elbows bent.

A ball joint has one limit, on the angle of its turn; a task of two frames, Distance, holds the hands apart.
"""

import math
import tempfile
from pathlib import Path

import numpy as np

import hqp
from hqp import Level, P, Stack
from hqp.tasks import BallLimits, Distance, JointLimits, LowAcceleration, Manipulability, Position, Within

ARM = """
<body name="{side}_upper" pos="0 {y} 1.4">
  <joint name="{side}_shoulder" type="ball" range="0 1.3"/>
  <geom type="capsule" fromto="0 0 0 0.15 0 -0.26" size="0.04" mass="2"/>
  <body name="{side}_lower" pos="0.15 0 -0.26">
    <joint name="{side}_elbow" axis="0 -1 0" range="-1.4 1.0"/>
    <geom type="capsule" fromto="0 0 0 0.3 0 0" size="0.03" mass="1.2"/>
    <body name="{side}_hand" pos="0.3 0 0"><geom type="sphere" size="0.04" mass="0.4"/></body>
  </body>
</body>"""
file = Path(tempfile.mkdtemp()) / "arms.xml"
arms = "".join(ARM.format(side=side, y=y) for side, y in (("left", 0.2), ("right", -0.2)))
file.write_text(f"<mujoco><compiler angle='radian'/><worldbody>{arms}</worldbody></mujoco>")

robot = hqp.robots.load(str(file))
left = Position(frame="left_hand", law=P(3.0, max_velocity=0.5))
right = Position(frame="right_hand", law=P(3.0, max_velocity=0.5))
stick = Distance(frame="left_hand", other="right_hand", name="stick")
agile = Within(Manipulability(frame="left_hand", angular=""), lower=0.01, name="agile")
shoulders = BallLimits()
stack = Stack(
    Level(left),
    Level(right),
    Level(LowAcceleration()),
    subject_to=[stick, shoulders, JointLimits(), agile],
)
session = hqp.Controller(stack, deadline=math.inf).session(robot, dt=0.002)
q, v = robot.home, np.zeros(robot.nv)
start = robot.state(q).position("left_hand").copy()
span, off, bend, agility = stick.value(robot.state(q))[0], 0.0, [], []
for k in range(4000):
    t = 0.002 * k
    goal = start + [0.15 * np.sin(t), 0.25 * np.sin(0.5 * t), 0.35 * (1.0 - np.cos(t))]  # overhead and to the side
    tick = session.step(robot.state(q, v), left.at(goal), right.at(goal - [0.0, 0.4, 0.0]))
    q, v = tick.advance()
    state = robot.state(q)
    off = max(off, abs(stick.value(state)[0] - span))
    bend.append(min(shoulders.bounds(state)[1]))
    agility.append(agile.task.value(state)[0])
print(session.explain(tick))
print(f"the stick kept its length to {1e6 * off:.1f} um; shoulders {min(bend):.4f} rad from their limit of 1.3;")
print(f"manipulability from {min(agility):.4f} to {max(agility):.4f}, 0.01 at least")
assert off < 5e-5
assert -1e-4 < min(bend) < 0.01
assert min(agility) > 0.01 - 1e-6
