"""MJCF files with oddities of published robots: duplicate names, deformable bodies, cameras, motors."""

from __future__ import annotations

import re
from pathlib import Path
from typing import Any

import numpy as np
import pytest

import hqp.robots
from hqp.errors import ModelError, ModelWarning
from hqp.robots.on_mujoco import Plant

FINGER = """
<mujoco model="finger">
  <asset><texture name="plant" type="skybox" builtin="flat" width="8" height="8"/></asset>
  <worldbody>
    <camera name="side" pos="0 -1 1"/>
    <geom name="ground" type="box" size="1 1 .1" pos="0 0 -1"/>
    <body name="palm">
      <joint name="bend" axis="0 1 0"/>
      <geom type="capsule" fromto="0 0 0 0 0 .1" pos="0 0 0" size=".01"/>
      <body name="tip" pos="0 0 .1">
        <joint name="curl" axis="0 1 0"/>
        <geom type="capsule" fromto="0 0 0 0 0 .05" size=".01"/>
        <site name="tip" pos="0 0 .06"/>
        <site name="palm" pos="0 0 .01"/>
      </body>
    </body>
  </worldbody>
  <actuator><general joint="bend" ctrllimited="true" ctrlrange="0 255" gainprm="2" biastype="affine"/></actuator>
</mujoco>
"""


def load(folder: Path, text: str, root: Any = None) -> Any:
    path = folder / "finger.xml"
    path.write_text(text)
    return hqp.robots.load(path, root=root)


def test_a_name_of_a_body_and_a_site_is_the_bodys(tmp_path: Path) -> None:
    robot = load(tmp_path, FINGER)
    state = robot.state()
    np.testing.assert_allclose(state.position("tip"), [0.0, 0.0, 0.1], atol=1e-12)
    np.testing.assert_allclose(state.position("tip_site"), [0.0, 0.0, 0.16], atol=1e-12)
    np.testing.assert_allclose(state.position("palm_site"), [0.0, 0.0, 0.11], atol=1e-12)
    assert "tip, palm" in str(robot)
    plant = Plant(robot)
    for frame in ("tip", "tip_site", "palm", "palm_site"):
        np.testing.assert_allclose(plant.place(frame)[0], state.position(frame), atol=1e-12)


def test_sites_keep_their_names_beside_frames_of_the_robot_alone(tmp_path: Path) -> None:
    """Names of sites that end in _site, with and without a body of the rest of the name."""
    text = FINGER.replace('<site name="palm" pos="0 0 .01"/>', '<site name="nail_site" pos="0 0 .01"/>')
    text = text.replace('<site name="tip" pos="0 0 .06"/>', '<site name="palm_site" pos="0 0 .06"/>')
    robot = load(tmp_path, text).with_frame("pad", "tip", np.array([0.0, 0.0, 0.02]))
    plant, state = Plant(robot), robot.state()
    for frame in ("nail_site", "palm_site", "pad", "tip", "palm"):
        np.testing.assert_allclose(plant.place(frame)[0], state.position(frame), atol=1e-12)


@pytest.mark.parametrize("actuation", ["torque", "position"])
def test_a_plant_of_a_file_with_names_and_motors_of_its_own(tmp_path: Path, actuation: Any) -> None:
    """The camera and the box share names with the scene's; the servo's control range is no limit of torque."""
    from hqp.robots.on_mujoco import Servo

    robot = load(tmp_path, FINGER)
    plant = Plant(robot, actuation=actuation, servo=Servo(other=10.0))
    assert plant.joint_names == ("bend",)
    plant.step(np.array([0.3]), steps=20)
    assert plant.state()[1][0] > 0.01
    assert [plant.model.camera(name).bodyid[0] for name in ("side", "front")] == [1, 1]


@pytest.mark.filterwarnings("ignore:flex:UserWarning")
def test_deformable_bodies_are_refused_by_name(tmp_path: Path) -> None:
    flex = '<flexcomp name="cloth" type="grid" count="3 3 1" spacing=".1 .1 .1" dim="2" mass="1" radius=".01"/>'
    with pytest.raises(ModelError, match=r"finger\.xml: deformable"):
        load(tmp_path, FINGER.replace("</worldbody>", f"{flex}</worldbody>"))


def test_a_file_with_more_bodies_than_there_is_room_for_is_refused(tmp_path: Path) -> None:
    """Data of Pinocchio take 32 nv^3 bytes: minutes and gigabytes for a heap of boxes."""
    heap = "".join(f'<body pos="0 0 {k}"><freejoint/><geom size=".1"/></body>' for k in range(67))
    text = FINGER.replace("</worldbody>", f"{heap}</worldbody>")
    with pytest.raises(ModelError, match="nv = 404, allowed 400"):
        load(tmp_path, text, root=("palm", *(f"body_{k}" for k in range(3, 70))))
    assert load(tmp_path, text).nv == 2


def test_rotor_inertia_of_a_tendon_is_warned_of(tmp_path: Path) -> None:
    """MuJoCo's inertia includes it, the model's does not."""
    tendon = '<tendon><fixed armature=".1"><joint joint="bend" coef="1"/></fixed></tendon>'
    with pytest.warns(ModelWarning, match="tendons"):
        load(tmp_path, FINGER.replace("<actuator>", f"{tendon}<actuator>"))


def test_a_centre_of_mass_that_is_almost_at_the_origin_is_no_reason_to_refuse(tmp_path: Path) -> None:
    """MuJoCo treats such a free body as simple, with a diagonal inertia."""
    body = """<body><freejoint/><geom size=".1" mass="0"/>
      <inertial pos="2e-9 1e-9 0" mass="200" diaginertia=".5 .5 .5"/></body>"""
    robot = load(tmp_path, FINGER.replace("</worldbody>", f"{body}</worldbody>"), root=("palm", "body_3"))
    assert robot.nv == 8


def test_home_of_a_ball_lies_in_its_cone(tmp_path: Path) -> None:
    text = FINGER.replace('name="bend" axis="0 1 0"', 'name="bend" type="ball" limited="true" range="0 30"')
    key = '<keyframe><key name="home" qpos="0.8 0.6 0 0 0"/></keyframe>'
    robot = load(tmp_path, text.replace("</mujoco>", f"{key}</mujoco>"))
    turned = robot.state().angles[robot.joints("bend")]
    assert np.linalg.norm(turned) == pytest.approx(np.radians(30.0))
    assert "home was moved into the limits of bend" in str(robot)


NUMBERS = """<mujoco model="nan">
 <compiler angle="radian" autolimits="true"/>
 <option gravity="0 0 -9.81" timestep="0.002"/>
 <default>
  <joint damping="0.1" armature="0.01"/>
  <default class="inf"><geom size="0.05"/></default>
 </default>
 <worldbody>
  <body name="a" pos="0 0 1" quat="1 0 0 0" gravcomp="0.5">
   <inertial pos="0 0 .1" mass="1" diaginertia=".01 .01 .01"/>
   <joint name="j" axis="0 1 0" range="-1 1" stiffness="1" frictionloss="0.1" ref="0" actuatorfrcrange="-5 5"/>
   <body pos="0 0 .2" euler="0 0 0">
    <joint name="k" axis="1 0 0"/>
    <geom type="box" size=".02 .03 .04" mass="0.5" pos="0 0 .05"/>
    <site name="s" pos="0 0 .1"/>
    <geom class="inf" type="sphere" density="100"/>
   </body>
  </body>
 </worldbody>
 <tendon><fixed name="t" range="-1 1"><joint joint="j" coef="1"/><joint joint="k" coef="0.5"/></fixed></tendon>
 <equality><joint joint1="j" joint2="k" polycoef="0 1 0 0 0"/></equality>
 <actuator><motor name="m" joint="j" gear="2" ctrlrange="-3 3"/></actuator>
 <keyframe><key name="nan" qpos="0 0"/></keyframe>
</mujoco>
"""


@pytest.mark.parametrize("included", [False, True])
@pytest.mark.parametrize("word", ["nan", "-NaN", "nan(0x1)", "inf", "-1e60", "abc", "1,5"])
def test_a_number_that_is_none_is_named_with_its_line(word: str, included: bool, tmp_path: Path) -> None:
    """Each number of a file, in turn, becomes a word: the error has the line, of an included file too."""
    main, path = tmp_path / "arm.xml", tmp_path / ("parts.xml" if included else "arm.xml")
    main.write_text('<mujoco><include file="parts.xml"/></mujoco>')
    path.write_text(NUMBERS)
    assert hqp.robots.load(main).nv == 2
    lines = NUMBERS.splitlines()
    for i, line in enumerate(lines):
        for found in re.finditer(r' (\w+)="[-\d. e]+"', line):
            free = ("quat", "axis", "euler", "timestep") if word == "-1e60" else ("range", "timestep")
            if word in ("inf", "-1e60") and found[1].endswith(free):
                continue  # directions have any length, ranges may be infinite
            changed = re.sub(r'[-\d.e]+"$', f'{word}"', found[0])
            path.write_text("\n".join([*lines[:i], line.replace(found[0], changed), *lines[i + 1 :]]))
            with pytest.raises(ModelError, match=rf"{path.name}, line {i + 1}\b|line {i + 1}$"):
                hqp.robots.load(main)
