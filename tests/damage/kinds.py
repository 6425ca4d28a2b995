"""Kinds of damaged files: intact files, damage, and readers."""

from __future__ import annotations

import contextlib
import random
import tempfile
from collections.abc import Callable
from pathlib import Path
from typing import Any

import numpy as np

import hqp
import hqp.robots
from hqp.errors import DeclarationError, HqpError, ModelError
from hqp.tasks import FixedContact, JointLimits, Position, Posture, TorqueLimits
from tests.damage import recordings, text

Kind = tuple[list[bytes], Callable[[bytes, random.Random], bytes], Callable[[Path], bool], str]


def of(name: str) -> Kind:
    """Intact files, damage, reader (True if it refuses correctly), suffix."""
    if name == "recordings":
        return [recorded("ur5", hqp.Velocity()), recorded("ur5", hqp.Torque())], recordings.damaged, _recording, ".npz"
    if name == "urdf":
        return [ARM.encode(), text_of("ur5")], text.damaged, _model, ".urdf"
    if name == "mjcf":
        return [HAND.encode(), WALKER.encode()], text.damaged, _model, ".xml"
    raise KeyError(name)


ARM = """<robot name="arm">
  <material name="grey"><color rgba=".5 .5 .5 1"/></material>
  <link name="base"><visual><geometry><box size=".1 .1 .1"/></geometry><material name="grey"/></visual></link>
  <link name="upper">
    <inertial><origin xyz="0 0 .2" rpy="0 .1 0"/><mass value="2"/>
      <inertia ixx=".02" iyy=".02" izz=".01" ixy=".001" ixz="0" iyz="0"/></inertial>
    <collision><origin xyz="0 0 .2"/><geometry><cylinder radius=".05" length=".4"/></geometry></collision>
  </link>
  <link name="fore">
    <inertial><origin xyz="0 0 .1"/><mass value="1"/><inertia ixx=".01" iyy=".01" izz=".005"/></inertial>
    <collision><geometry><sphere radius=".05"/></geometry></collision>
  </link>
  <link name="left"><inertial><mass value=".1"/><inertia ixx="1e-4" iyy="1e-4" izz="1e-4"/></inertial></link>
  <link name="right"><inertial><mass value=".1"/><inertia ixx="1e-4" iyy="1e-4" izz="1e-4"/></inertial></link>
  <link name="tool"/>
  <joint name="shoulder" type="revolute"><parent link="base"/><child link="upper"/><axis xyz="0 1 0"/>
    <limit lower="-2" upper="2" velocity="3" effort="50"/><dynamics damping=".1" friction=".2"/></joint>
  <joint name="elbow" type="continuous"><parent link="upper"/><child link="fore"/><origin xyz="0 0 .4"/>
    <axis xyz="0 .6 .8"/><limit velocity="3" effort="20"/></joint>
  <joint name="grip" type="prismatic"><parent link="fore"/><child link="left"/><axis xyz="1 0 0"/>
    <limit lower="0" upper=".04" velocity=".1" effort="5"/></joint>
  <joint name="follow" type="prismatic"><parent link="fore"/><child link="right"/><axis xyz="-1 0 0"/>
    <limit lower="0" upper=".04" velocity=".1" effort="5"/><mimic joint="grip" multiplier="1" offset="0"/></joint>
  <joint name="mount" type="fixed"><parent link="fore"/><child link="tool"/><origin xyz="0 0 .2" rpy="0 0 1"/></joint>
</robot>"""

HAND = """<mujoco model="hand">
  <compiler angle="radian" autolimits="true"/>
  <option timestep=".002" gravity="0 0 -9.81"/><size memory="1M"/>
  <default><joint damping=".1" armature=".01"/><default class="tip"><geom size=".01"/></default></default>
  <asset><mesh name="wedge" vertex="0 0 0 .1 0 0 0 .1 0 0 0 .1"/><material name="red" rgba="1 0 0 1"/></asset>
  <worldbody>
    <light pos="0 0 2"/><camera name="side" pos="0 -1 1"/>
    <geom name="ground" type="plane" size="1 1 .1"/>
    <body name="palm" pos="0 0 .5" euler="0 0 .3">
      <joint name="wrist" type="ball" range="0 1"/>
      <geom type="mesh" mesh="wedge" material="red"/>
      <body name="finger" pos="0 0 .1">
        <joint name="bend" axis="0 1 0" range="-1 1" actuatorfrcrange="-5 5"/>
        <geom type="capsule" fromto="0 0 0 0 0 .1" size=".01" mass=".1"/>
        <body name="tip" pos="0 0 .1">
          <joint name="slide" type="slide" axis="0 0 1" range="0 .02" stiffness="10" frictionloss=".1"/>
          <geom class="tip" type="sphere" mass=".05"/><site name="touch" pos="0 0 .02"/>
        </body>
      </body>
      <body name="thumb" pos=".05 0 0">
        <joint name="turn" axis="0 .6 .8" pos="0 0 .01" ref=".1"/>
        <inertial pos="0 0 .02" mass=".1" fullinertia="1e-4 1e-4 1e-4 1e-6 0 0"/>
        <geom type="box" size=".01 .01 .02"/>
      </body>
    </body>
  </worldbody>
  <equality><joint joint1="bend" joint2="turn" polycoef="0 1 0 0 0"/></equality>
  <tendon><fixed name="pull"><joint joint="bend" coef="1"/><joint joint="slide" coef="10"/></fixed></tendon>
  <actuator>
    <motor name="m" joint="bend" gear="2" ctrlrange="-1 1"/><position joint="turn" kp="10" forcerange="-2 2"/>
    <general tendon="pull" gainprm="2"/>
  </actuator>
  <sensor><jointpos joint="bend"/></sensor>
  <keyframe><key name="home" qpos="1 0 0 0 .1 .01 .1"/></keyframe>
</mujoco>"""

WALKER = """<mujoco model="walker">
  <worldbody>
    <body name="trunk" pos="0 0 1"><freejoint name="root"/>
      <inertial pos="0 0 0" mass="5" diaginertia=".1 .1 .1"/>
      <geom type="ellipsoid" size=".1 .2 .1"/>
      <body name="leg" pos="0 .1 -.1" quat=".9 .1 0 0">
        <joint name="hip" axis="1 0 0" range="-60 60"/><joint name="thigh" axis="0 1 0"/>
        <geom type="cylinder" size=".03 .2" pos="0 0 -.2"/><site name="sole" pos="0 0 -.4"/>
      </body>
    </body>
    <body name="target" mocap="true"><geom type="sphere" size=".05" contype="0" conaffinity="0"/></body>
  </worldbody>
  <actuator><motor joint="hip"/><motor joint="thigh" forcerange="-10 20"/></actuator>
  <contact><exclude body1="trunk" body2="leg"/></contact>
</mujoco>"""


def text_of(name: str) -> bytes:
    """File of a robot of the catalogue."""
    source = hqp.robots.load(name).source
    assert source is not None
    return source.read_bytes()


def _model(path: Path) -> bool:
    """A loaded model has a state, a printed form and, unless a note gives a reason, shapes; otherwise ModelError."""
    floating = True if path.suffix == ".urdf" and path.stat().st_size % 2 else None
    try:
        robot = hqp.robots.load(path, floating=floating)
    except ModelError:
        return True
    assert str(robot)
    state = robot.state()
    assert state.mass_matrix().shape == (robot.nv, robot.nv)
    for kind in ("geometry", "visual"):
        try:
            getattr(robot, kind)
        except ModelError:
            continue
    with contextlib.suppress(HqpError):
        hqp.Controller(hqp.Stack(hqp.Level(Posture())), hqp.Velocity()).session(robot, 0.01).step(robot.state())
    return False


def recorded(name: str, formulation: Any) -> bytes:
    """A recording of eight ticks, the last with an invalid state."""
    robot = hqp.robots.load(name)
    hand = Position(frame=robot.frame_names[-1], name="hand")
    limits = TorqueLimits() if isinstance(formulation, hqp.Torque) else JointLimits()
    feet = [FixedContact(frame=frame) for frame in robot.landmarks.get("soles", ())]
    stack = hqp.Stack(hqp.Level(hand), hqp.Level(Posture()), subject_to=[*feet, limits])
    session = hqp.Controller(stack, formulation).session(robot, 0.002)
    q, v = robot.home, np.zeros(robot.nv)
    goal = robot.state(q).position(hand.frame) + [0.4, 0.0, 0.2]
    with tempfile.TemporaryDirectory() as folder:
        recorder = session.record(ticks=8, on="never", to=folder)
        for k in range(8):
            tick = session.step(robot.state(np.nan * q if k == 7 else q, v), hand.at(goal))
            q, v = tick.advance() if k < 7 else (q, v)
        recorder.dump()
        recorder.wait()
        return recorder.files[0].read_bytes()


def _recording(path: Path) -> bool:
    """A loaded recording can be printed, explained and solved again; otherwise DeclarationError."""
    try:
        found = hqp.recorder.load(path)
    except DeclarationError:
        return True
    assert str(found)
    for tick in found.ticks[::4]:
        try:
            assert str(tick.explain())
        except HqpError:
            continue
    with contextlib.suppress(HqpError):
        assert str(hqp.recorder.replay(found, "lexicographic", every=3))
    return False
