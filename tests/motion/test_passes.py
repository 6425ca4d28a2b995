"""Passes over a motion: the choice keeps to the order of the levels, and a way through all passes loses least."""

from __future__ import annotations

from dataclasses import replace
from functools import cache
from itertools import product
from types import SimpleNamespace
from typing import Any

import numpy as np
import pytest

from hqp.loop.session import Session
from hqp.motion import anchored
from hqp.motion.anchored import SHORT, Judged, best, solved
from hqp.motion.body import Body
from hqp.motion.joints import parts_of
from hqp.motion.skeleton_map import find_map
from hqp.motion.stacks import Stacks
from hqp.motion.targets import targets_of
from hqp.motion.tracker import Pass, Tracker
from hqp.motion.weaving import woven
from tests.scenes.clips import bend

from .people import walk
from .robots import robot as catalogued

ORDER = "toe", "hand", "sole", "torso"
"""Parts by level, first the most important."""


@cache
def tracker(flat: bool = False) -> Tracker:
    return tracker_of(walk(2.0), flat)


def tracker_of(motion: Any, flat: bool = False) -> Tracker:
    robot = catalogued("g1")
    found = find_map(None, robot)
    body = Body.of(robot, found)
    targets = targets_of(motion, parts_of(motion.names), body)
    return Tracker(robot, Stacks(robot, found, body, 1.0 / targets.fps, flat=flat), targets)


@pytest.mark.parametrize("seed", [0, *(pytest.param(s, marks=pytest.mark.long) for s in range(1, 4))])
def test_rest_takes_no_more_ticks_at_a_high_rate(seed: int, monkeypatch: pytest.MonkeyPatch) -> None:
    """Clips of any rate settle within three seconds of ticks of 1/120 s; clips of 120 Hz or more end in one rest."""
    rng, ticks, still = np.random.default_rng(seed), [0], walk(2.0)
    pose = still.positions[[rng.integers(len(still))]]
    step = Session.step

    def counted(self: Session, *given: Any, **more: Any) -> Any:
        ticks[0] += 1
        return step(self, *given, **more)

    monkeypatch.setattr(Session, "step", counted)
    found: list[Any] = []
    for fps in (120.0, 30.0, float(rng.uniform(120.0, 1000.0)), 1000.0):
        own = tracker_of(replace(still, positions=np.repeat(pose, 1 + round(0.3 * fps), axis=0), fps=fps))
        aside = np.concatenate((np.zeros(6), np.full(own.robot.nv - 6, 0.05)))
        ticks[0] = 0
        found.append(own.settle(own.robot.integrate(own.robot.home, aside, 1.0), 0))
        assert ticks[0] <= 360, fps
        if fps >= 120.0:
            np.testing.assert_allclose(own.robot.difference(found[0], found[-1]), 0.0, atol=1e-6, err_msg=str(fps))


def losses(track: Tracker, errors: Any) -> list[float]:
    """Errors beyond 1 that last for a tenth of a second, by level, frame by frame."""
    names = [task.name for level in track.stacks.judged for task in level]
    found = []
    for part in ORDER:
        found.append(0.0)
        for k, name in enumerate(names):
            if part not in name:
                continue
            for i, error in enumerate(errors[:, k]):
                first, last = i, i
                while first > 0 and errors[first - 1, k] > 1.0:
                    first -= 1
                while last + 1 < len(errors) and errors[last + 1, k] > 1.0:
                    last += 1
                if error > 1.0 and (last - first + 1) * track.dt >= SHORT:
                    found[-1] += error - 1.0
    return found


def drawn(rng: Any, frames: int) -> Any:
    """Errors of seven parts that lag in one or two runs, or in none."""
    errors = rng.uniform(0.0, 1.0, (frames, 7))
    for k in range(7):
        for _ in range(rng.integers(0, 3)):
            first, length = rng.integers(0, frames), rng.integers(1, 12)
            errors[first : first + length, k] = rng.uniform(1.0, 4.0)
    return errors


@pytest.mark.parametrize("flat", [False, True])
def test_no_pass_is_chosen_that_is_worse_on_a_higher_level(flat: bool) -> None:
    """A pass is better if it loses less in the first level in which the two differ, however much it loses below."""
    rng, track, nothing = np.random.default_rng(5), tracker(flat), Pass(np.zeros((1, 1)), np.zeros((1, 1)), [])
    for _ in range(100):
        found = [Judged(nothing, drawn(rng, 40)) for _ in range(4)]
        chosen = losses(track, best(track, found).errors)
        for other in (losses(track, each.errors) for each in found):
            first = next((k for k in range(len(chosen)) if abs(chosen[k] - other[k]) > 1e-9), None)
            assert first is None or chosen[first] < other[first]


@pytest.mark.long
def test_the_choice_of_a_motion_keeps_the_order(monkeypatch: pytest.MonkeyPatch) -> None:
    """All passes over a bend that lags, each judged by the levels; the chosen one is on no level worse than one that is
    as good above it."""
    made: list[Judged] = []
    for name in ("_from", "_led"):
        make: Any = getattr(anchored, name)

        def kept(track: Tracker, *given: Any, make: Any = make) -> Judged:
            found: Judged = make(track, *given)
            if track.stacks.collision:
                made.append(found)
            return found

        monkeypatch.setattr(anchored, name, kept)
    track = tracker_of(bend(np.random.default_rng(7)))
    chosen = losses(track, track.errors(solved(track).q))
    assert len(made) > 3
    assert chosen == pytest.approx(min(losses(track, track.errors(each.motion.q)) for each in made))


def test_a_way_through_all_passes_loses_least() -> None:
    """No other way through three passes of six frames loses less with its changes, for drawn passes and losses."""
    robot = catalogued("ur5")
    track: Any = SimpleNamespace(robot=robot, dt=0.01)
    rng, limit = np.random.default_rng(2), robot.velocity_limit * 0.01
    changed = 0
    for _ in range(20):
        q = rng.normal(0.0, 1.0, (1, 1, 6)) + rng.normal(0.0, 0.01, (3, 6, 6))
        lost = rng.uniform(0.0, 1.0, (3, 6)) * rng.uniform(0.0, 4.0, (3, 1))
        found = woven(track, [Pass(each, each, []) for each in q], list(lost))

        def cost(way: Any, q: Any = q, lost: Any = lost) -> float:
            steps = zip(way[:-1], way[1:], range(6), strict=False)
            changes = sum(float((np.abs(q[k, i + 1] - q[j, i + 1]) / limit).max()) for k, j, i in steps if k != j)
            return changes + sum(float(lost[k, i]) for i, k in enumerate(way))

        way = [int(np.flatnonzero((q[:, i] == found[i]).all(axis=1))[0]) for i in range(6)]
        assert cost(way) == pytest.approx(min(map(cost, product(range(3), repeat=6))))
        changed += len(set(way)) > 1
    assert changed > 3
