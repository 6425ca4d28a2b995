"""Equivalent descriptions give one robot: names, order, frames, units, reflection, format."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pinocchio as pin
import pytest

import hqp
from hqp.declare.element import Element
from tests.invariance import generated, urdf
from tests.invariance.described import draw, rotation
from tests.invariance.scenes import KINDS, off

EXACT = 1e-8
"""Tolerance relative to the largest command: equal numbers in another order."""

DIGITS = 1e-3
"""Tolerance relative to the largest command, for a file with six digits."""

SEEDS = [0, *(pytest.param(seed, marks=pytest.mark.slow) for seed in range(1, 24))]
pytestmark = [pytest.mark.parametrize("kind", KINDS), pytest.mark.parametrize("seed", SEEDS)]


def test_names_and_their_order_permute_the_command(kind: str, seed: int, tmp_path: Path) -> None:
    who, rng = draw(kind, seed)
    robot = who.robot(tmp_path)
    scene = who.scene(robot, kind, rng)
    root, names = urdf.renamed(who.root, rng)
    other = who.robot(tmp_path, root, names)
    there = who.scene(other, kind, rng, names).but(reach=scene.reach, price=scene.price)
    place = [other.joint_names.index(names[joint]) for joint in robot.joint_names]
    assert off(scene.run().commands, there.run().commands[:, place]) < EXACT, (who.name, scene.reach, scene.price)


def test_a_turned_tool_frame_with_its_task_turned_back(kind: str, seed: int, tmp_path: Path) -> None:
    who, rng = draw(kind, seed)
    scene, R = who.scene(who.robot(tmp_path), kind, rng), rotation(rng)
    other = who.robot(tmp_path, urdf.with_link_turned(who.root, who.tool, R))
    assert off(scene.run().commands, scene.but(robot=other, tool_turn=R).run().commands) < EXACT, who.name


def test_soles_turned_about_their_normals(kind: str, seed: int, tmp_path: Path) -> None:
    """By quarters: the friction pyramid, whose facets follow the frame, is unchanged."""
    who, rng = draw(kind, seed)
    root = who.root
    for sole in who.flat:
        root = urdf.with_link_turned(root, sole, pin.utils.rotate("z", 0.5 * np.pi * int(rng.integers(4))))
    scene = who.scene(who.robot(tmp_path), kind, rng)
    assert off(scene.run().commands, scene.but(robot=who.robot(tmp_path, root)).run().commands) < EXACT, who.name


def test_units_of_length_and_mass_scale_the_command(kind: str, seed: int, tmp_path: Path) -> None:
    """Limits from 1e6 on count as none in a file, so that torques stay below."""
    who, rng = draw(kind, seed)
    length = float(rng.choice([0.1, 10.0, 1000.0]))
    mass = float(rng.choice([0.1, 1.0, 10.0])) / (length if length > 100.0 else 1.0)
    scene = who.scene(who.robot(tmp_path), kind, rng)
    if scene.price is None and kind != "torque" and scene.reach > 0.1:
        scene = scene.but(price=0)  # the price weights a level's unit against motion
    bounds = hqp.StateBounds(distance=1e4 * max(length, 1.0), speed=1e3 * max(length, 1.0))
    other = who.robot(tmp_path, urdf.in_units(who.root, length, mass), length=length)
    there = scene.but(robot=other, unit=length, options={"bounds": bounds})
    factor = mass * length * length if kind == "torque" else 1.0
    assert off(scene.run().commands * factor, there.run().commands) < 1e-6, (
        who.name,
        length,
        mass,
        scene.reach,
        scene.price,
    )


def test_a_reflected_robot_with_reflected_targets(kind: str, seed: int, tmp_path: Path) -> None:
    """Angles keep their signs, since axes are reflected as pseudo-vectors."""
    who, rng = draw(kind, seed)
    scene = who.scene(who.robot(tmp_path), kind, rng)
    there = scene.but(robot=who.robot(tmp_path, urdf.mirrored(who.root)), mirror=True)
    assert off(scene.run().commands, there.run().commands) < EXACT, (who.name, scene.reach, scene.price)


def test_the_file_that_mujoco_writes_of_it(kind: str, seed: int, tmp_path: Path) -> None:
    """MJCF has no speed limits, so both files go without; MuJoCo writes six digits."""
    rng = np.random.default_rng([seed, KINDS.index(kind)])
    who = generated.biped(rng) if rng.random() < 0.5 else generated.arm(rng)
    root = urdf.without(who.root, "velocity")
    robot = who.robot(tmp_path, root)
    other = who.standing(hqp.robots.load(urdf.as_mjcf(root, tmp_path, who.floating)))
    scene, place = who.scene(robot, kind, rng), [other.joint_names.index(name) for name in robot.joint_names]
    commands = scene.but(robot=other).run().commands[:, place]
    assert off(scene.run().commands, commands) < DIGITS, (who.name, scene.reach, scene.price)


def test_the_order_of_what_holds_at_once(kind: str, seed: int, tmp_path: Path) -> None:
    who, rng = draw(kind, seed)
    scene = who.scene(who.robot(tmp_path), kind, rng)

    def shuffled(held: list[Element]) -> list[Element]:
        """Contacts before their dependents."""
        first = [e for e in held if not hasattr(e, "contact")]
        last = [e for e in held if hasattr(e, "contact")]
        return [part[i] for part in (first, last) for i in np.random.default_rng(seed).permutation(len(part))]

    assert off(scene.run().commands, scene.but(order=shuffled).run().commands) < EXACT, who.name
