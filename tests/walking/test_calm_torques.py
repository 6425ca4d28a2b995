"""Noise of gyroscope and encoders does not reach the torques of a walk."""

from __future__ import annotations

import math
from pathlib import Path
from typing import Any

import numpy as np
import pytest

import hqp
from hqp.errors import DeclarationError
from hqp.walking import Walker, Walkers

DT = 0.002
REVERSALS, STEP, LEAST = 10.0, 15.0, 0.02
"""Most reversals a second, largest change in a tick [N m], least reversal as a share of a joint's limit."""


def reversals(torques: Any, least: Any) -> float:
    """Changes of direction by more than ``least`` ``(n,)`` of the joint with most of them, per second."""
    counts = []
    for x, size in zip(torques.T, least, strict=True):
        way, extreme, count = 0, x[0], -1
        for value in x:
            if way * (value - extreme) >= 0.0 and way:
                extreme = value
            elif abs(value - extreme) > size:
                way, extreme, count = int(np.sign(value - extreme)), value, count + 1
        counts.append(max(count, 0))
    return max(counts) / (DT * len(torques))


@pytest.mark.long
@pytest.mark.parametrize(
    ("name", "speed", "seed"), [("g1", 0.2, 3), pytest.param("talos", 0.3, 4, marks=pytest.mark.slow)]
)
def test_torques_neither_reverse_nor_jump(name: str, speed: float, seed: int) -> None:
    """In MuJoCo on estimated states, with noise on every sensor."""
    course_of = pytest.importorskip("hqp.walking.course").Course
    robot = hqp.robots.load(name, rotors=True)
    limit, found = robot.effort_limit[robot.actuated], {}
    for bandwidth in (40.0, math.inf):
        walker = Walker(robot.copy(), dt=DT, bandwidth=bandwidth, deadline=math.inf)
        course = course_of(walker, seed=seed)
        walker.go(speed)
        torques = np.array([course.step().command.copy() for _ in range(round(3.0 / DT))])
        assert not course.fallen
        found[bandwidth] = reversals(torques, LEAST * limit)
        if bandwidth == 40.0:
            assert np.abs(np.diff(torques, axis=0)).max() < STEP
    assert found[40.0] < REVERSALS
    assert found[math.inf] > 5.0 * REVERSALS, "the noise would not show"


@pytest.mark.long
@pytest.mark.parametrize("seed", range(3))
def test_a_batch_filters_with_the_bits_of_single_walkers(seed: int, tmp_path: Path) -> None:
    """Drawn rates, a world of which is not finite for a tick."""
    rng = np.random.default_rng(seed)
    singles = [Walker(hqp.robots.load("g1", rotors=True), dt=DT, deadline=math.inf) for _ in range(2)]
    singles[0].export(tmp_path / "walker.hqp")
    batch, nv = Walkers.load(tmp_path / "walker.hqp", 2), singles[0].robot.nv
    Q, V = np.array([walker.start for walker in singles]), np.zeros((2, nv))
    for k in range(40):
        V = 0.99 * V + 0.01 * rng.normal(size=V.shape)
        measured = V + 0.02 * rng.normal(size=V.shape)
        if k == 20:
            measured[1, 6 + int(rng.integers(nv - 6))] = math.nan
        found = batch.step(Q, measured)
        ticks = [w.step(w.robot.state(q, v)) for w, q, v in zip(singles, Q, measured, strict=True)]
        np.testing.assert_array_equal(found.commands, [tick.command for tick in ticks])
        assert found.statuses() == tuple(tick.status for tick in ticks)


@pytest.mark.parametrize("seed", range(3))
def test_rates_of_the_model_are_taken_as_they_are(seed: int) -> None:
    """Rates that the torques lead to are their own estimate, and so is the velocity of the base in any case."""
    rng = np.random.default_rng(seed)
    walker = Walker(hqp.robots.load("g1", rotors=True), dt=DT, deadline=math.inf)
    q, v = walker.start, 0.05 * rng.normal(size=walker.robot.nv)
    for _ in range(20):
        tick = walker.step(walker.robot.state(q, v))
        np.testing.assert_allclose(tick.state.v, v, atol=1e-9)
        q, v = tick.advance()
    noisy = v + 0.02 * rng.normal(size=v.size)
    found = walker.step(walker.robot.state(q, noisy)).state.v
    np.testing.assert_array_equal(found[:3], noisy[:3])
    np.testing.assert_allclose(found[3:] - v[3:], (1.0 - math.exp(-40.0 * DT)) * (noisy - v)[3:], atol=1e-9)


@pytest.mark.parametrize("seed", range(3))
def test_rates_stay_near_measured_ones(seed: int) -> None:
    """An impact shows at once but for 0.06 rad/s: without that G1 falls on a slope."""
    rng = np.random.default_rng(seed)
    walker = Walker(hqp.robots.load("g1", rotors=True), dt=DT, deadline=math.inf)
    q, v = walker.start, 0.02 * rng.normal(size=walker.robot.nv)
    _, v = walker.step(walker.robot.state(q, v)).advance()
    blow = rng.uniform(0.1, 1.0, v.size) * rng.choice([-1.0, 1.0], v.size)
    found = walker.step(walker.robot.state(q, v + blow)).state.v
    np.testing.assert_allclose((found - v - blow)[3:], -0.06 * np.sign(blow)[3:], atol=1e-9)


def test_rates_that_gears_exclude_move_no_motor() -> None:
    """Noise on the fingers of Talos, which gears couple to a motor of 1 N m: it reversed 100 times a second."""
    rng = np.random.default_rng(0)
    robot = hqp.robots.load("talos_full_v2", rotors=True)
    fingers = np.array([c for c in range(6, robot.nv) if c not in robot.actuated])
    walker = Walker(robot, dt=DT, bandwidth=math.inf, deadline=math.inf)
    torques = []
    for _ in range(20):
        v = np.zeros(robot.nv)
        v[fingers] = 0.02 * rng.normal(size=fingers.size)
        torques.append(walker.step(robot.state(walker.start, v)).command.copy())
    assert fingers.size == 12
    assert np.all(np.ptp(torques, axis=0) < LEAST * robot.effort_limit[robot.actuated])


def test_a_bad_bandwidth_is_named() -> None:
    robot = hqp.robots.load("g1", rotors=True)
    for bandwidth in (0.0, -1.0, math.nan):
        with pytest.raises(DeclarationError, match="bandwidth"):
            Walker(robot, bandwidth=bandwidth)
