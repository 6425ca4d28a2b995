"""Couplings, states and names follow the file."""

from __future__ import annotations

from pathlib import Path
from typing import Any

import numpy as np
import pinocchio as pin
import pytest

import hqp
from hqp.errors import ModelError
from tests.scenes.coupled import Follower, urdf

MASS = '<inertial><mass value=".3"/><inertia ixx="1e-2" iyy="1e-2" izz="1e-2" ixy="0" ixz="0" iyz="0"/></inertial>'
ENDS = {"continuous": "", "revolute": 'lower="-9" upper="9"'}


def chain(folder: Path, kind: str, *mimics: str, suffix: str = ".urdf", more: str = "") -> Any:
    """Joints j0, j1, ... in a chain, each with its mimic element."""
    links = "".join(f'<link name="l{i}">{MASS}</link>' for i in range(len(mimics) + 1))
    joints = "".join(
        f'<joint name="j{i}" type="{kind}"><parent link="l{i}"/><child link="l{i + 1}"/><origin xyz="0 0 .1"/>'
        f'<axis xyz="0 1 0"/><limit {ENDS[kind]} velocity="9" effort="50"/>{mimic}</joint>'
        for i, mimic in enumerate(mimics)
    )
    path = folder / f"chain{suffix}"
    path.write_text(f'<robot xmlns:xacro="x" name="chain">{links}{joints}{more}</robot>')
    return hqp.robots.load(path)


def follower(leader: str, factor: float, offset: float = 0.0) -> str:
    return f'<mimic joint="{leader}" multiplier="{factor}" offset="{offset}"/>'


def test_states_satisfy_chains_of_couplings(tmp_path: Path) -> None:
    (tmp_path / "chain.srdf").write_text(
        '<robot name="chain"><group name="g"><joint name="j2"/></group>'
        '<group_state name="bent" group="g"><joint name="j2" value="0.3"/></group_state></robot>'
    )
    robot = chain(tmp_path, "revolute", follower("j1", 2.0), follower("j2", -1.0, 0.1), "")
    np.testing.assert_allclose(robot.configuration("bent"), [-0.4, -0.2, 0.3], atol=1e-12)


def test_a_link_keeps_its_name(tmp_path: Path) -> None:
    end = '<link name="j1"/><joint name="end" type="fixed"><parent link="l1"/><child link="j1"/>'
    robot = chain(tmp_path, "revolute", "", "", more=f'{end}<origin xyz="0 0 .5"/></joint>')
    np.testing.assert_allclose(robot.state(robot.home).position("j1"), [0.0, 0.0, 0.6], atol=1e-12)


def test_suffixes_in_capitals_and_macros_left_in(tmp_path: Path) -> None:
    assert chain(tmp_path, "revolute", "", suffix=".URDF").nv == 1
    assert chain(tmp_path, "revolute", "", more="<!-- <xacro:hand/> -->").nv == 1
    with pytest.raises(ModelError, match="line 2: <xacro:hand"):
        chain(tmp_path, "revolute", "", more='\n<xacro:hand parent="l1"/>')


@pytest.mark.parametrize("seed", range(12))
def test_a_follower_that_narrows_its_leader_is_noted(seed: int, tmp_path: Path) -> None:
    rng = np.random.default_rng(seed)
    two = Follower("j1", "j0", float(rng.choice([-2.0, -0.5, 1.0, 3.0])), round(float(rng.uniform(-0.5, 0.5)), 2))
    limits = {
        name: (round(-float(rng.uniform(0.1, 2)), 2), round(float(rng.uniform(0.1, 2)), 2)) for name in ("j0", "j1")
    }
    (tmp_path / "two.urdf").write_text(urdf(rng, [two], str(rng.choice(["revolute", "prismatic"])), limits))
    robot = hqp.robots.load(tmp_path / "two.urdf")
    notes = [note for note in robot.notes if "'j1' = " in note]
    leader = np.linspace(*limits["j0"], 20001)
    places = two.ratio * leader + two.offset
    kept = leader[(places >= limits["j1"][0] - 1e-9) & (places <= limits["j1"][1] + 1e-9)]
    assert bool(notes) == (kept.size < leader.size)
    if notes:
        low, high = map(float, notes[0].rsplit("[", 1)[1].rstrip("]").split(", "))
        np.testing.assert_allclose((low, high), (kept[0], kept[-1]), atol=1e-3)
        assert "'j0'" in notes[0]
    at = robot.configuration(np.array([0.01, 0.01 * two.ratio + two.offset]))
    assert robot.state(at).angles[1] == pytest.approx(0.01 * two.ratio + two.offset)


@pytest.mark.parametrize("seed", range(5))
def test_a_planar_joint_moves_across_its_axis(seed: int, tmp_path: Path) -> None:
    """Draw its axis: the link slides in the plane through its origin and turns about the axis; its pose at zero is the
    file's."""
    rng = np.random.default_rng(seed)
    axis, other = rng.normal(size=3) if seed else np.array((0.0, 0.0, -1.0)), rng.normal(size=3)
    place, shift = rng.uniform(-1, 1, 3), rng.uniform(-1, 1, 3)
    words = {k: " ".join(f"{x:.9f}" for x in v) for k, v in {"a": axis, "o": other, "p": place, "s": shift}.items()}
    path = tmp_path / "puck.urdf"
    path.write_text(
        f'<robot name="puck"><link name="table"/><link name="puck">{MASS}</link><link name="top">{MASS}</link>'
        '<joint name="slide" type="planar"><parent link="table"/><child link="puck"/>'
        f'<origin xyz="{words["p"]}" rpy="0.3 -0.2 0.5"/><axis xyz="{words["a"]}"/>'
        '<limit velocity="3" effort="4"/></joint>'
        '<joint name="turn" type="continuous"><parent link="puck"/><child link="top"/>'
        f'<origin xyz="{words["s"]}" rpy="0.1 0.2 0.3"/><axis xyz="{words["o"]}"/>'
        '<limit velocity="2" effort="3"/></joint></robot>'
    )
    robot = hqp.robots.load(path)
    start = robot.state(robot.configuration(np.zeros(robot.nv)))
    R = pin.rpy.rpyToMatrix(0.3, -0.2, 0.5)
    normal = R @ axis / np.linalg.norm(axis)
    np.testing.assert_allclose(start.position("puck"), place, atol=1e-6)
    np.testing.assert_allclose(start.rotation("puck"), R, atol=1e-6)
    np.testing.assert_allclose(start.position("top"), place + R @ shift, atol=1e-6)
    np.testing.assert_allclose(robot.velocity_limit[robot.joints("slide")], 3.0)
    for _ in range(5):
        state = robot.state(robot.random_configuration(rng))
        assert normal @ (state.position("puck") - place) == pytest.approx(0.0, abs=1e-6)
        np.testing.assert_allclose(state.rotation("puck") @ R.T @ normal, normal, atol=1e-6)
        np.testing.assert_allclose(
            state.position("top"), state.position("puck") + state.rotation("puck") @ shift, atol=1e-6
        )


def test_friction_and_damping_are_noted(tmp_path: Path) -> None:
    robot = chain(tmp_path, "revolute", '<dynamics damping="0.3"/>', '<dynamics friction="1"/>', "")
    assert any("damping" in note and "j0" in note and "j1" not in note for note in robot.notes)
    assert any("friction" in note and "j1" in note for note in robot.notes)
