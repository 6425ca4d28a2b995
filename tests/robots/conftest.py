"""A robot outside the catalogue: floating, with a slide, a bent link, position actuators and a displaced root."""

from __future__ import annotations

from pathlib import Path

import pytest

HOPPER = """
<mujoco model="hopper">
  <compiler angle="radian"/>
  <worldbody>
    <body name="trunk" pos="0 0 1.2">
      <freejoint name="floating"/>
      <inertial pos="0.02 0.01 0.1" mass="12" fullinertia="0.4 0.5 0.3 0.02 0.01 0.03"/>
      <site name="nose" pos="0.2 0 0.1" euler="0.1 0.2 0.3"/>
      <body name="thigh" pos="0.05 0.1 -0.1" euler="0.3 0.1 -0.2">
        <joint name="hip" axis="0.2 1 0.1" range="-1 1.5"/>
        <inertial pos="0 0 -0.2" mass="3" diaginertia="0.05 0.05 0.01"/>
        <body name="shin" pos="0 0 -0.4">
          <joint name="leg" type="slide" axis="0 0 1" range="-0.2 0.2"/>
          <inertial pos="0.01 0 -0.2" mass="1.5" diaginertia="0.02 0.02 0.004"/>
          <geom name="foot" type="sphere" pos="0 0 -0.4" size="0.03"/>
        </body>
      </body>
      <body name="arm" pos="0 -0.2 0.2">
        <joint name="shoulder" axis="1 0 0"/>
        <inertial pos="0 -0.15 0" mass="1" diaginertia="0.01 0.002 0.01"/>
      </body>
    </body>
  </worldbody>
  <actuator>
    <position name="a" joint="shoulder" kp="50" forcerange="-15 15"/>
    <motor name="b" joint="hip" gear="20" ctrlrange="-2 2"/>
    <position name="c" joint="leg" kp="900"/>
  </actuator>
</mujoco>
"""


@pytest.fixture(scope="session")
def hopper(tmp_path_factory: pytest.TempPathFactory) -> Path:
    path = tmp_path_factory.mktemp("mjcf") / "hopper.xml"
    path.write_text(HOPPER)
    return path
