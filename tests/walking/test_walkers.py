"""Many walkers over native threads have the numbers of single ones."""

from __future__ import annotations

import math
from pathlib import Path
from typing import Any

import numpy as np
import pytest

from hqp import Status
from hqp.errors import DeclarationError, HqpError
from hqp.walking import Walkers
from hqp.walking.plan import _loads as loads
from hqp.walking.plan import advance
from tests.scenes.walkers import DT, made

COMMANDS = ((0.2, 0.0, 0.0), (0.1, 0.03, 0.2), (9.0, 0.0, 0.0))


@pytest.mark.long
@pytest.mark.parametrize("threads", [pytest.param(1, marks=pytest.mark.slow), 2])
def test_a_batch_walks_with_the_bits_of_single_walkers(robot: Any, threads: int, tmp_path: Path) -> None:
    """They walk, stop and are halted; states are those of their own models, loads of their own feet."""
    singles = [made(robot) for _ in COMMANDS]
    singles[0].export(tmp_path / "walker.hqp")
    batch = Walkers.load(tmp_path / "walker.hqp", len(COMMANDS), threads=threads)
    assert batch.threads == threads
    Q, V = np.array([walker.start for walker in singles]), np.zeros((len(COMMANDS), robot.nv))
    batch.go(*np.transpose(COMMANDS))
    for walker, command in zip(singles, COMMANDS, strict=True):
        walker.go(*command)
    assert batch.commands == tuple(walker.command for walker in singles)
    assert batch.why(2) == singles[2].why != ()
    seen, ticks = set(), []
    for k in range(round(6.0 / DT)):
        if k == round(2.0 / DT):
            batch.stop([0])
            batch.halt([1], "door")
            singles[0].stop()
            singles[1].session.stop("door")
        felt = [loads(walker, walker.robot.state(q, v)) for walker, q, v in zip(singles, Q, V, strict=True)]
        found = batch.step(Q, V, felt)
        moved = [advance(walker, q, v) for walker, q, v in zip(singles, Q, V, strict=True)]
        ticks = [tick for _, _, tick in moved]
        Q, V = np.array([q for q, _, _ in moved]), np.array([v for _, v, _ in moved])
        np.testing.assert_array_equal(found.commands, [tick.command for tick in ticks])
        assert found.statuses() == tuple(tick.status for tick in ticks)
        assert batch.phases == tuple(walker.phase for walker in singles)
        assert batch.supports == tuple(walker.support for walker in singles)
        seen |= set(batch.phases)
    assert seen == {"stand", "shift", "swing"}
    assert ticks[1].status is Status.STOPPED


@pytest.mark.long
def test_a_world_that_is_reset_begins_anew(robot: Any) -> None:
    walker, batch = made(robot), Walkers(made(robot), 2)
    q, v = np.array([walker.start] * 2), np.zeros((2, robot.nv))
    first = batch.step(q, v).commands
    batch.go(0.1)
    for _ in range(round(0.8 / DT)):
        batch.step(q, v)
    batch.reset([1])
    assert batch.phases == ("shift", "stand")
    np.testing.assert_array_equal(batch.step(q, v).commands[1], first[1])


def test_a_state_that_is_not_finite_is_that_of_its_world(robot: Any) -> None:
    batch = Walkers(made(robot), 2)
    q, v = np.array([robot.home] * 2), np.zeros((2, robot.nv))
    batch.step(q, v)
    v[1, 8] = math.nan
    assert batch.step(q, v).statuses() == (Status.OPTIMAL, Status.INVALID_STATE)
    v[1, 8] = 0.0
    assert batch.step(q, v).solved.all()


def test_bad_input_is_named(robot: Any, tmp_path: Path) -> None:
    walker = made(robot)
    batch = Walkers(walker, 2)
    with pytest.raises(DeclarationError, match="count"):
        Walkers(walker, 0)
    with pytest.raises(DeclarationError, match="worlds"):
        batch.go(0.1, worlds=[2])
    with pytest.raises(DeclarationError, match="velocities"):
        batch.go([0.1, 0.2, 0.3])
    with pytest.raises(DeclarationError, match="forward"):
        batch.go(math.nan)
    with pytest.raises(DeclarationError, match="wrong shape"):
        batch.step(np.zeros((2, 3)), np.zeros((2, robot.nv)))
    walker.session.export(tmp_path / "bare.hqp")
    with pytest.raises(HqpError, match="no walker"):
        Walkers.load(tmp_path / "bare.hqp", 1)
