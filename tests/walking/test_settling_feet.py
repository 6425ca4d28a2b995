"""Feet that roll onto their sole, settle or turn while they bear load do not carry the estimated base along."""

from __future__ import annotations

import math
from dataclasses import dataclass, replace
from typing import Any

import numpy as np
import pytest

import hqp.robots
from hqp.arrays import Mat, Vec
from hqp.estimation import FeetEstimator
from hqp.walking.course import LEAST

DT = 0.002
RESTS = 0.5
"""Both feet at rest before and after the motion [s]."""


@dataclass(frozen=True)
class Settling:
    """Base at rest; a foot moves with a twist ``(6,)`` about a point in its axes, for a time [s], while it bears a
    share of the weight; then it takes all of it within SHIFT, and the other foot nothing.
    """

    robot: str
    side: int
    twist: Vec
    point: Vec
    lasts: float
    share: float

    SHIFT = 0.1

    def seen(self) -> tuple[Mat, Vec]:
        """Error of the base over time ``(n, 3)`` [m] and of its heading ``(n,)`` [rad]."""
        robot, rng = hqp.robots.load(self.robot), np.random.default_rng(1)
        soles = robot.landmarks["soles"]
        count = round(self.lasts / DT)
        poses, rates = [robot.home.copy()], []
        for _ in range(count):  # from the end, which is home
            state = robot.state(poses[-1])
            R = state.rotation(soles[self.side])
            at_origin = self.twist[:3] - np.cross(self.twist[3:], R @ self.point)
            rate = np.zeros(robot.nv)
            twist = np.concatenate((at_origin, self.twist[3:]))
            rate[6:] = np.linalg.lstsq(state.jacobian(soles[self.side])[:, 6:], twist, rcond=None)[0]
            rates.append(rate)
            poses.append(np.asarray(robot.integrate(poses[-1], -rate, DT)))
        rest, still = round(RESTS / DT), np.asarray(np.zeros(robot.nv))
        q: list[Vec] = [poses[-1]] * rest + poses[::-1] + [poses[0]] * rest
        v: list[Vec] = [still] * rest + rates[::-1] + [still] * (rest + 1)
        least, weight = LEAST * robot.mass, 9.81 * robot.mass
        estimator = FeetEstimator(robot, soles, DT, q[0], least_load=least)
        home, up, off, turned = robot.home[:3], np.array([0.0, 0.0, 9.81]), [], []
        for k, (angles, speeds) in enumerate(zip(q, v, strict=True)):
            since = (k - rest - count) * DT
            share = self.share + (1.0 - self.share) * min(max(since / self.SHIFT, 0.0), 1.0)
            load = weight * (np.array([1.0 - share, share]) if self.side else np.array([share, 1.0 - share]))
            measured = speeds.copy()
            measured[3:6] += 0.01 * rng.normal(size=3)
            measured[6:] += 0.02 * rng.normal(size=robot.nv - 6)
            found, _ = estimator.update(angles, measured, up + 0.05 * rng.normal(size=3), load)
            off.append(found[:3] - home)
            turned.append(2.0 * math.atan2(found[5], found[6]))
        return np.array(off), np.array(turned)


def drawn(seed: int, **given: Any) -> Settling:
    """A robot, a side and the given parts."""
    rng = np.random.default_rng(seed)
    return Settling(("g1", "talos", "cbi")[seed % 3], int(rng.integers(2)), **given)


@pytest.mark.parametrize("seed", range(9))
def test_a_foot_that_rolls_onto_its_sole_moves_the_base_little(seed: int) -> None:
    """It stands on an edge, alone or beside the other foot, and rolls about it by 4 to 9 degrees until it is flat."""
    rng = np.random.default_rng(seed)
    point = rng.choice([-1.0, 1.0], 2) * rng.uniform((0.05, 0.02), (0.09, 0.04))
    axis = np.array([point[1], -point[0], 0.0]) / np.linalg.norm(point)
    angle, rate = rng.uniform(0.07, 0.16), rng.uniform(0.6, 2.5)
    twist = np.concatenate((np.zeros(3), rng.choice([-1.0, 1.0]) * rate * axis))
    share = (1.0, 0.8, 0.5)[seed // 3]
    roll = drawn(seed, twist=twist, point=np.array([*point, 0.0]), lasts=angle / rate, share=share)
    off, _ = roll.seen()
    assert np.max(np.linalg.norm(off, axis=1)) < 2e-3


@pytest.mark.parametrize("seed", range(6))
def test_a_foot_that_settles_moves_the_base_by_its_share_of_the_load(seed: int) -> None:
    """It slides, sinks and turns slowly while the other foot bears most, and then takes the weight."""
    rng = np.random.default_rng(seed)
    way = rng.normal(size=3)
    twist = np.concatenate((0.04 / np.linalg.norm(way) * way, [0.0, 0.0, rng.choice([-0.15, 0.15])]))
    settles = drawn(seed, twist=twist, point=np.zeros(3), lasts=0.25, share=rng.uniform(0.1, 0.2))
    off, turned = settles.seen()
    assert np.max(np.linalg.norm(off, axis=1)) < settles.share * 0.01 + 1.5e-3
    assert np.max(np.abs(turned)) < settles.share * 0.15 * 0.25 + math.radians(0.15)
    alone, _ = replace(settles, share=1.0).seen()
    assert np.max(np.linalg.norm(alone, axis=1)) > 5e-3  # nothing else would show it


@pytest.mark.parametrize("seed", range(6))
def test_a_foot_that_pivots_under_the_weight_hardly_turns_the_base(seed: int) -> None:
    """The gyro sees that the base does not turn."""
    rng = np.random.default_rng(seed)
    rate, lasts = rng.choice([-1.0, 1.0]) * rng.uniform(0.03, 0.3), rng.uniform(0.3, 0.6)
    twist = np.array([0.0, 0.0, 0.0, 0.0, 0.0, rate])
    _, turned = drawn(seed, twist=twist, point=np.zeros(3), lasts=lasts, share=1.0).seen()
    assert np.max(np.abs(turned[: round((RESTS + lasts) / DT)])) < 0.3 * abs(rate) * lasts
