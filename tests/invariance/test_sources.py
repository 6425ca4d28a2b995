"""One stack from Python, from TOML, from a file, in a batch, or of readable elements."""

from __future__ import annotations

from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest

import hqp
from hqp import serial
from tests.invariance.scenes import KINDS, catalogue, off

SEEDS = [0, *(pytest.param(seed, marks=pytest.mark.slow) for seed in range(1, 12))]
pytestmark = [pytest.mark.parametrize("kind", KINDS), pytest.mark.parametrize("seed", SEEDS)]


def test_toml_gives_the_bits_of_python(kind: str, seed: int) -> None:
    rng = np.random.default_rng([seed, KINDS.index(kind)])
    scene = catalogue(rng, kind)
    read = scene.but(rewritten=lambda c: replace(c, stack=serial.loads(serial.dumps(c.stack))))
    assert (scene.run().commands == read.run().commands).all(), scene.robot.name


def test_files_and_batches_give_the_bits_of_python(kind: str, seed: int, tmp_path: Path) -> None:
    rng = np.random.default_rng([seed, KINDS.index(kind)])
    scene = catalogue(rng, kind)
    session = scene.controller().session(scene.robot, scene.dt)
    session.export(tmp_path / "plan.hqp")
    file, batch = hqp.load(tmp_path / "plan.hqp"), hqp.Batch.load(tmp_path / "plan.hqp", 2)
    q, v = scene.first, np.zeros(scene.robot.nv)
    for i, references in enumerate(scene.references()):
        tick = session.step(scene.robot.state(q, v), *references)
        if i == 0:  # hold values come from Pinocchio here, from the file there
            for name, value in session.hold_values.items():
                if name in file.names:
                    file.hold(name, value)
        found = file.step(q, v, {r.name: r.value for r in references})
        assert (found.command == tick.command).all(), (scene.robot.name, i)
        targets = {r.name: np.stack([np.ravel(r.value)] * 2) for r in references}  # type: ignore[arg-type]
        worlds = batch.step(np.stack([q, q]), np.stack([v, v]), targets)
        scale = max(1.0, float(np.abs(tick.command).max()))
        assert np.abs(worlds.commands - tick.command).max() < 1e-9 * scale, (scene.robot.name, i)
        q, v = tick.advance()


def test_readable_elements_give_the_command_of_native_ones(kind: str, seed: int) -> None:
    rng = np.random.default_rng([seed, KINDS.index(kind)])
    scene = catalogue(rng, kind)
    there = scene.but(rewritten=lambda c: replace(c, stack=readable(c.stack)))
    assert off(scene.run().commands, there.run().commands) < 1e-9, (scene.robot.name, scene.reach)


def readable(stack: hqp.Stack) -> hqp.Stack:
    """The stack with elements without a native plan."""
    made: dict[type, type] = {}

    def plain(element: hqp.Element) -> hqp.Element:
        kind = type(element)
        if kind not in made:
            made[kind] = type(f"Readable{kind.__name__}", (kind,), {"plan": lambda self, robot: None})
        clone = object.__new__(made[kind])
        clone.__dict__.update(element.__dict__)
        return clone

    levels = (level.replace(*map(plain, level)) for level in stack.levels)
    return hqp.Stack(*levels, subject_to=[plain(e) for e in stack.subject_to])
