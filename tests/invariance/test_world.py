"""Rotation and translation of the world rotate and move the answer: joint commands stay."""

from __future__ import annotations

import math

import numpy as np
import pytest

import hqp
from tests.invariance.scenes import KINDS, World, catalogue, off

TOLERANCE = 1e-6
"""Tolerance relative to the largest command; positions of 1 km have a rounding of 1e-13 m, amplified by gains and stiff
rows."""


def check(kind: str, seed: int) -> None:
    rng = np.random.default_rng([seed, KINDS.index(kind)])
    scene = catalogue(rng, kind, names=("talos", "g1", "cbi", "icub", "romeo"))
    yaw = float(rng.integers(36)) * math.radians(10.0) + float(rng.choice([0.0, 2.0 * math.pi, -2.0 * math.pi]))
    shift = (*rng.uniform(-1000.0, 1000.0, 2).tolist(), float(rng.uniform(-100.0, 100.0)))
    here, there = scene.run(), scene.but(world=World(yaw, shift)).run()
    assert off(here.commands, there.commands) < TOLERANCE, (scene.robot.name, scene.reach, math.degrees(yaw), shift)


@pytest.mark.parametrize("seed", [0, *(pytest.param(k, marks=pytest.mark.slow) for k in range(1, 24))])
@pytest.mark.parametrize("kind", KINDS)
def test_a_turned_and_moved_world_gets_the_same_command(kind: str, seed: int) -> None:
    check(kind, seed)


def check_slope(kind: str, seed: int) -> None:
    rng = np.random.default_rng([seed, KINDS.index(kind), 1])
    scene = catalogue(rng, kind, names=("talos", "g1", "cbi", "icub", "romeo"), com="xyz")
    slope, yaw = float(rng.choice([-1.0, 1.0]) * rng.uniform(0.05, 1.4)), float(rng.uniform(-math.pi, math.pi))
    world = World(yaw, slope=slope)
    robot = hqp.robots.load(scene.robot.name)
    robot.model.gravity.linear = world.placement.rotation @ robot.model.gravity.linear
    level, slanted = scene.run(), scene.but(world=world, robot=robot).run()
    assert off(level.commands, slanted.commands) < TOLERANCE, (robot.name, scene.reach, math.degrees(slope))


@pytest.mark.filterwarnings("ignore:the first state")
@pytest.mark.parametrize("seed", [0, *(pytest.param(k, marks=pytest.mark.slow) for k in range(1, 24))])
@pytest.mark.parametrize("kind", KINDS)
def test_a_slope_with_its_gravity_gets_the_same_command(kind: str, seed: int) -> None:
    check_slope(kind, seed)
