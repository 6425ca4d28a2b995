"""Parts of a file that the model lacks are listed in the notes and in the report, by joint; others are modelled."""

from __future__ import annotations

import warnings
from pathlib import Path
from typing import Any

import mujoco
import numpy as np
import pytest

import hqp.robots
from hqp.errors import ModelError
from hqp.robots.model_map import ModelMap
from hqp.robots.mujoco_extra import full_inertia
from hqp.robots.report import report

LEFT_OUT = {
    "damping": "damping of the file is ignored",
    "frictionloss": "dry friction of the file is ignored",
    "stiffness": "springs of the file are ignored",
    "gravcomp": "gravity compensation of the file is ignored",
}
JOINTS = ("one", "two", "three", "four")


def chain(attributes: dict[str, list[str]], more: str = "") -> str:
    """Four hinges in a chain; each attribute is on some of them, ``gravcomp`` on the bodies that they move."""
    inside = ""
    for name in reversed(JOINTS):
        words = {word: '"0.3"' for word, names in attributes.items() if name in names}
        body = f" gravcomp={words.pop('gravcomp')}" if "gravcomp" in words else ""
        joint = " ".join(f"{word}={value}" for word, value in words.items())
        inside = (
            f'\n<body name="{name}" pos=".1 .05 0"{body}>\n<joint name="{name}" axis="0 1 .2" {joint}/>'
            f'<geom size=".05" pos=".02 .01 .1"/>{inside}</body>'
        )
    return f"<mujoco><worldbody>{inside}</worldbody>{more}</mujoco>"


def load(folder: Path, text: str) -> Any:
    path = folder / "chain.xml"
    path.write_text(text)
    with warnings.catch_warnings():
        warnings.simplefilter("ignore")
        return hqp.robots.load(path)


@pytest.mark.parametrize("seed", range(8))
def test_losses_are_noted_and_armature_is_modelled(seed: int, tmp_path: Path) -> None:
    rng = np.random.default_rng(seed)
    drawn = {word: [n for n in JOINTS if rng.random() < 0.4] for word in (*LEFT_OUT, "armature")}
    robot = load(tmp_path, chain(drawn))
    text = report(robot)
    for word, told in LEFT_OUT.items():
        found = [note for note in robot.notes if note.startswith(told)]
        assert len(found) == bool(drawn[word]), (word, robot.notes)
        for note in found:
            assert note.rpartition(": ")[2].split(", ") == drawn[word]
            assert note in text.partition("Left out")[2]
    simulated = mujoco.MjModel.from_xml_path(str(robot.source))
    data, convert = mujoco.MjData(simulated), ModelMap(simulated, robot)
    q = rng.uniform(-1, 1, robot.nv)
    data.qpos[:] = convert.to_mujoco(q, np.zeros(robot.nv))[0]
    mujoco.mj_forward(simulated, data)
    np.testing.assert_allclose(robot.state(q).mass_matrix(), full_inertia(simulated, data), atol=1e-12)
    for name in JOINTS:
        (row,) = [line for line in text.splitlines() if line.split()[:2] == [name, "revolute"]]
        assert ("0.3 kg m^2" in row) == (name in drawn["armature"])


@pytest.mark.parametrize("seed", range(4))
def test_tendons_are_noted(seed: int, tmp_path: Path) -> None:
    rng = np.random.default_rng(seed)
    parts = {
        "limits": 'limited="true" range="-.1 .1"',
        "springs": 'stiffness="3"',
        "damping and friction": str(rng.choice(['damping="2"', 'frictionloss=".1"'])),
    }
    given = [what for what in parts if rng.random() < 0.5]
    one, two = rng.choice(JOINTS, 2, replace=False)
    tendon = (
        f'<tendon><fixed name="pull" {" ".join(parts[what] for what in given)}><joint joint="{one}" coef="1"/>'
        f'<joint joint="{two}" coef="-2"/></fixed></tendon>'
    )
    robot = load(tmp_path, chain({}, tendon))
    for what in parts:
        found = [note for note in robot.notes if note.startswith(what) and "of tendons" in note]
        assert len(found) == (what in given)
        assert all(f"pull along {one}, {two}" in note for note in found)


@pytest.mark.parametrize("seed", range(3))
def test_ranges_without_a_use_are_refused_or_noted(seed: int, tmp_path: Path) -> None:
    """MuJoCo drops a range whose ends are swapped: the joint would turn without a limit."""
    name = str(np.random.default_rng(seed).choice(JOINTS))
    text = chain({}, "<actuator>" + "".join(f'<motor name="m_{n}" joint="{n}"/>' for n in JOINTS) + "</actuator>")
    joint, motor = f'<joint name="{name}"', f'<motor name="m_{name}"'
    for old, words, told in (
        (joint, 'range="1 -1"', f"joint '{name}': range="),
        (joint, 'actuatorfrcrange="2 -2"', f"joint '{name}': actuatorfrcrange="),
        (joint, 'armature="-1"', f"joint '{name}': negative armature"),
        (motor, 'ctrlrange="1 -1"', f"actuator 'm_{name}': ctrlrange="),
        (motor, 'forcerange="3 -1"', f"actuator 'm_{name}': forcerange="),
        (motor, 'gear="0"', f"actuator 'm_{name}': gear 0 moves nothing"),
        (joint, 'axis="0 0 0"', "axis too small"),
    ):
        faulty = text.replace(f'{old} axis="0 1 .2"', old).replace(old, f"{old} {words}")
        with pytest.raises(ModelError, match=rf"chain\.xml.*{told}") as refused:
            load(tmp_path, faulty)
        assert "\n" not in str(refused.value)
        assert f"line {faulty[: faulty.index(old)].count(chr(10)) + 1}" in str(refused.value)
    robot = load(tmp_path, text.replace(joint, f'{joint} range="-60 60" limited="false"'))
    assert f'ranges with limited="false" limit nothing: {name}' in robot.notes
    assert np.isinf(robot.upper).all()
    robot = load(tmp_path, text.replace(f"{motor}", f'<velocity joint="{name}" kv="2"/>{motor}'))
    assert f"joints with several actuators have one motor, of their smallest limit: {name}" in robot.notes


@pytest.mark.parametrize("seed", range(3))
def test_configurations_outside_the_limits_are_noted(seed: int, tmp_path: Path) -> None:
    rng = np.random.default_rng(seed)
    text = chain({}).replace("<joint ", '<joint range="-60 60" limited="true" ')
    values = rng.choice([0.5, 2.0], (2, len(JOINTS)))
    values[0, 0] = 2.0
    keys = "".join(f'<key name="k{k}" qpos="{" ".join(map(str, row))}"/>' for k, row in enumerate(values))
    robot = load(tmp_path, text.replace("</worldbody>", f"</worldbody><keyframe>{keys}</keyframe>"))
    (note,) = [note for note in robot.notes if note.startswith("configurations outside")]
    outside = {f"k{k}": ", ".join(np.array(JOINTS)[row > 1.1]) for k, row in enumerate(values)}
    assert note.partition("joints: ")[2] == "; ".join(f"{key}: {names}" for key, names in outside.items() if names)


@pytest.mark.parametrize("transmission", ["joint", "jointinparent"])
def test_an_actuator_limits_its_joint(transmission: str, tmp_path: Path) -> None:
    motors = "".join(f'<motor {transmission}="{n}" gear="{k + 2}" ctrlrange="-3 3"/>' for k, n in enumerate(JOINTS))
    robot = load(tmp_path, chain({}, f"<actuator>{motors}</actuator>"))
    np.testing.assert_allclose(robot.effort_limit, [6.0, 9.0, 12.0, 15.0])


def test_actuators_without_a_joint_are_noted(tmp_path: Path) -> None:
    text = chain({}, '<actuator><motor site="tip" gear="0 0 1"/></actuator>')
    robot = load(tmp_path, text.replace("<geom", '<site name="tip"/><geom', 1))
    assert any("1 actuators of the file are ignored" in n and "have a motor instead" in n for n in robot.notes)
