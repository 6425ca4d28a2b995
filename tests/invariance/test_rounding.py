"""Rounding does not matter: noise of 1e-13 in every number, other kernels, threads, and earlier ticks."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest

import hqp
from hqp.arrays import Vec
from tests.invariance import urdf
from tests.invariance.described import draw
from tests.invariance.scenes import KINDS, catalogue, off

NOISE = 1e-13
LIPSCHITZ = 1e-6
"""Largest change of a command by this noise, relative to the largest command."""

SEEDS = [0, *(pytest.param(seed, marks=pytest.mark.slow) for seed in range(1, 20))]


@pytest.mark.parametrize("kind", KINDS)
@pytest.mark.parametrize("seed", SEEDS)
def test_noise_in_the_state(kind: str, seed: int) -> None:
    rng = np.random.default_rng([seed, KINDS.index(kind)])
    scene = catalogue(rng, kind, price=[None, 0][int(rng.integers(2))], ticks=60)

    def noisy(q: Vec, v: Vec) -> tuple[Vec, Vec]:
        return q * (1.0 + NOISE * rng.normal(size=q.size)), v * (1.0 + NOISE * rng.normal(size=v.size))

    assert off(scene.run().commands, scene.run(state=noisy).commands) < LIPSCHITZ, (
        scene.robot.name,
        scene.reach,
        scene.price,
    )


@pytest.mark.parametrize("kind", KINDS)
@pytest.mark.parametrize("seed", SEEDS)
def test_noise_in_the_numbers_of_the_file(kind: str, seed: int, tmp_path: Path) -> None:
    who, rng = draw(kind, seed)
    scene = who.scene(who.robot(tmp_path), kind, rng).but(ticks=60)
    other = who.robot(tmp_path, urdf.noisy(who.root, NOISE, rng))
    assert off(scene.run().commands, scene.but(robot=other).run().commands) < LIPSCHITZ, (
        who.name,
        scene.reach,
        scene.price,
    )


@pytest.mark.parametrize("kind", KINDS)
def test_sessions_in_turn_and_worlds_on_threads_give_the_bits_of_one_alone(kind: str) -> None:
    rng = np.random.default_rng(KINDS.index(kind))
    scene = catalogue(rng, kind, ticks=40)
    controller, given = scene.controller(), list(scene.references())
    twins = [controller.session(scene.robot.copy(), scene.dt) for _ in range(3)]
    states = [(scene.first, np.zeros(scene.robot.nv)) for _ in twins]
    batches = [hqp.Batch(controller, scene.robot, 3, scene.dt, threads=threads) for threads in (1, 2)]
    for i, references in enumerate(given):
        targets = {r.name: np.stack([np.ravel(r.value)] * 3) for r in references}  # type: ignore[arg-type]
        Q, V = (np.stack(part) for part in zip(*states, strict=True))
        worlds = [batch.step(Q, V, targets).commands for batch in batches]
        commands: list[Vec] = [np.empty(0)] * 3
        for k in rng.permutation(3):
            tick = twins[k].step(twins[k].robot.state(*states[k]), *references)
            commands[k], states[k] = tick.command.copy(), tick.advance()
        assert (np.stack(commands) == commands[0]).all(), f"tick {i}"
        assert (worlds[0] == worlds[1]).all(), f"tick {i}"
