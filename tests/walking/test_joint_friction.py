"""Friction of joints that a robot's file has, in MuJoCo by the file's own physics."""

from __future__ import annotations

import math
import re
from pathlib import Path
from types import SimpleNamespace
from typing import Any

import numpy as np
import pytest

import hqp
from hqp.robots.soles import feet
from hqp.torque.joint_friction import JointFriction
from hqp.walking import Walker, Walkers
from hqp.walking.walker import _friction
from tests.scenes.bipeds import biped

SPEED, SECONDS = 0.15, 4.0

RUBBED: dict[str, dict[str, Any]] = {
    "viscous": {"damping": 10.0, "dry": 2.5},
    "dry": {"damping": 5.0, "dry": 5.0},
}


def made(path: Path, dt: float = 0.002) -> Walker:
    robot, soles = feet(hqp.robots.load(path, floating=True, rotors=True))
    return Walker(robot, soles=soles, dt=dt, deadline=math.inf)


def walked(path: Path, seed: int = 0) -> tuple[float, float]:
    """Way ahead and aside of a walk of so many seconds, and a stop [m]; NaN for a fall."""
    course_of = pytest.importorskip("hqp.walking.course").Course
    walker = made(path)
    course = course_of(walker, seed=seed)
    begin = course.plant.com().copy()
    for k in range(round((SECONDS + 2.5) / walker.dt)):
        if k == round(0.2 / walker.dt):
            walker.go(SPEED)
        if k == round((0.2 + SECONDS) / walker.dt):
            walker.stop()
        course.step()
        if course.fallen:
            return math.nan, math.nan
    ahead, aside, _ = (course.plant.com() - begin).tolist()
    return ahead, aside


@pytest.mark.long
@pytest.mark.parametrize("rubbed", [pytest.param(r, id=name) for name, r in RUBBED.items()])
def test_a_biped_walks_with_the_friction_of_its_file(rubbed: dict[str, Any], tmp_path: Path) -> None:
    """The way is that without friction; torques that do not overcome it go 0.7 and 0.8 of it."""
    free, _ = walked(biped(tmp_path, name="free", size=0.6))
    ahead, aside = walked(biped(tmp_path, name="rubbed", size=0.6, **rubbed))
    assert free > 0.7 * SPEED * SECONDS
    assert ahead > 0.9 * free
    assert abs(aside) < 0.05


def test_a_batch_overcomes_friction_with_the_bits_of_a_single_walker(tmp_path: Path) -> None:
    walker, other = (made(biped(tmp_path, damping=5.0, dry=3.0)) for _ in range(2))
    other.export(tmp_path / "walker.hqp")
    batch = Walkers.load(tmp_path / "walker.hqp", 1)
    rng = np.random.default_rng(3)
    q = walker.start
    for _ in range(5):
        v = rng.normal(scale=0.2, size=walker.robot.nv)
        tick = walker.step(walker.robot.state(q, v), (150.0, 150.0))
        found = batch.step(q[None], v[None], np.array([[150.0, 150.0]]))
        np.testing.assert_array_equal(found.commands[0], tick.command)


@pytest.mark.parametrize(("constant", "value"), [("kSoon", JointFriction.SOON), ("kBreaks", JointFriction.BREAKS)])
def test_the_native_law_has_the_numbers_of_the_readable_one(constant: str, value: float) -> None:
    text = (Path(hqp.__file__).parent / "cpp" / "walking" / "joint_friction.hpp").read_text(encoding="utf-8")
    found = re.search(rf"\b{constant} = ([0-9.e-]+)", text)
    assert found is not None
    assert float(found.group(1)) == value


def test_motors_without_a_limit_overcome_all_friction(tmp_path: Path) -> None:
    """Files state no limit as infinite or as zero."""
    robot = made(biped(tmp_path, damping=5.0, dry=3.0)).robot
    for none in (math.inf, 0.0):
        limits = np.full(robot.nv, none)
        same = SimpleNamespace(model=robot.model, nv=robot.nv, actuated=robot.actuated, effort_limit=limits)
        found = _friction(same)
        assert [(one["viscous"], one["dry"]) for one in found] == [(5.0, 3.0)] * robot.actuated.size


@pytest.mark.parametrize("seed", range(5))
def test_a_joint_that_moves_takes_its_friction_more(seed: int, tmp_path: Path) -> None:
    """Torques of two bipeds that differ in their friction alone: by it, at the rates of the joints shortly after, and
    the less, the larger a share of the motor's torque it is.
    """
    rng = np.random.default_rng(seed)
    damping, dry = rng.uniform([0.0, 0.0], [5.0, 100.0]).tolist()
    free = made(biped(tmp_path, name="free"))
    rubbed = made(biped(tmp_path, name="rubbed", damping=damping, dry=dry))
    v = np.zeros(free.robot.nv)
    moving = free.robot.actuated[:3]
    v[moving] = rng.uniform(-0.3, 0.3, 3)
    both = [each.step(each.robot.state(free.start, v), (175.0, 175.0)) for each in (free, rubbed)]
    _, after = both[0].advance()
    rates = (v + 0.02 / free.dt * (after - v))[free.robot.actuated]
    limit = free.robot.effort_limit[free.robot.actuated]
    overcome = np.maximum(1.0 - dry / limit, 0.0) * (damping * rates + dry * np.tanh(rates / 0.3))
    wanted = np.clip(both[0].command + overcome, -limit, limit)
    np.testing.assert_allclose(both[1].command, wanted, atol=1e-4)
