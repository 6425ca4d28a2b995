"""A four-bar whose loop is closed by a Ball, then by a Hinge: one motor turns the crank, the rocker follows."""

import tempfile
from pathlib import Path

import numpy as np

import hqp
from hqp import Level, P, Stack
from hqp.tasks import Ball, Hinge, Posture

MJCF = """<mujoco><worldbody>
  <body name="crank" pos="0 0 1"><joint name="crank" axis="0 1 0"/>
    <geom type="capsule" size=".01" fromto="0 0 0 .2 0 0"/>
    <body name="rod" pos=".2 0 0"><joint name="rod" axis="0 1 0"/>
      <geom type="capsule" size=".01" fromto="0 0 0 0 0 -.4"/><site name="rod_end" pos="0 0 -.4"/></body>
  </body>
  <body name="rocker" pos="0 0 .6"><joint name="rocker" axis="0 1 0"/>
    <geom type="capsule" size=".01" fromto="0 0 0 .2 0 0"/><site name="pin" pos=".2 0 0"/></body>
</worldbody><actuator><motor joint="crank"/></actuator></mujoco>"""
path = Path(tempfile.mkdtemp()) / "four_bar.xml"
path.write_text(MJCF)
robot = hqp.robots.load(path, root=("crank", "rocker"))  # no motor moves the rocker by itself
crank, rocker = robot.joints("crank")[0], robot.joints("rocker")[0]
turn = Posture(joints=["crank"], law=P(5.0), name="turn")

for closure in (
    Ball(frame="rod_end", relative_to="pin", closed=True),
    Hinge(frame="rod_end", relative_to="pin", axis="y", closed=True),
):
    session = hqp.Controller(Stack(Level(turn), subject_to=[closure])).session(robot, dt=0.01)
    q = robot.home
    for _ in range(200):
        tick = session.step(robot.state(q), turn.at([0.6]))
        q, _ = tick.advance()
    gap = np.linalg.norm(robot.state(q).position("rod_end") - robot.state(q).position("pin"))
    print(f"{type(closure).__name__}: crank {q[crank]:.3f} rad, rocker {q[rocker]:.3f} rad, gap {1e3 * gap:.3f} mm")
    assert abs(q[crank] - 0.6) < 1e-3
    assert abs(q[rocker] - 0.6) < 1e-3
    assert gap < 1e-3
