"""Noise of measured joint rates at torque level, in MuJoCo, with a hand target far out of reach."""

from __future__ import annotations

import math
from typing import Any

import numpy as np
import pytest

pytest.importorskip("mujoco")

import hqp
from hqp import PD, Level, Stack
from hqp.errors import DeclarationError
from hqp.estimation import RateObserver
from hqp.robots.on_mujoco import Plant
from hqp.robots.soles import sole as corners
from hqp.tasks import CenterOfPressure, Com, FixedContact, FrictionCone, JointLimits, Position, Posture, TorqueLimits
from hqp.tasks.polygons import shrunk
from tests.counting import reversals

DT, NOISE = 0.002, 0.02
SMALL = 0.02
"""Threshold of a noticeable change, as a share of a joint's torque limit."""


def commands(name: str, noise: float, observed: bool, ticks: int = 300, seed: int = 0) -> tuple[Any, Any]:
    """Torques ``(ticks, n)`` while the robot stands in MuJoCo and reaches for a point 2 m ahead, and their limits."""
    robot = hqp.robots.load(name, rotors=True)
    soles = robot.landmarks["soles"]
    hand = Position(frame=robot.landmarks["palms"][-1], law=PD(60.0, 15.0, max_velocity=0.4), name="hand")
    stack = Stack(
        Level(Com(law=PD(60.0, 15.0))),
        Level(hand),
        Level(Posture(law=PD(20.0, 9.0))),
        subject_to=[
            *(FixedContact(frame=sole, name=sole) for sole in soles),
            *(FrictionCone(contact=sole, mu=0.6) for sole in soles),
            *(CenterOfPressure(contact=sole, polygon=shrunk(corners(robot, sole), 0.01)) for sole in soles),
            TorqueLimits(),
            JointLimits(),
        ],
    )
    session = hqp.Controller(stack, hqp.Torque(contact_law=PD(0.0, 20.0)), deadline=math.inf).session(robot, DT)
    plant = Plant(robot)
    q, v = plant.reset()
    goal = robot.state(q).position(hand.frame) + [2.0, 0.0, 0.0]
    observer, rng, tick, found = RateObserver(robot, DT), np.random.default_rng(seed), None, []
    for _ in range(ticks):
        v = v.copy()
        v[robot.actuated] += noise * rng.normal(size=robot.actuated.size)
        tick = session.step(robot.state(q, observer.update(v, tick) if observed else v), hand.at(goal))
        found.append(tick.command.copy())
        plant.step(tick.command, steps=round(DT / plant.timestep))
        q, v = plant.state()
    assert plant.com()[2] > 0.8 * robot.state(robot.home).com()[2], "it fell"
    return np.array(found), robot.effort_limit[robot.actuated]


@pytest.mark.long
@pytest.mark.parametrize("name", [pytest.param(n, marks=pytest.mark.slow) for n in ("talos", "cbi", "icub")] + ["g1"])
def test_torques_neither_reverse_nor_jump(name: str) -> None:
    quiet, limits = commands(name, 0.0, True)
    noisy, _ = commands(name, NOISE, True)
    raw, _ = commands(name, NOISE, False)
    steps = [float(np.abs(np.diff(torques, axis=0)).max()) for torques in (quiet, noisy, raw)]
    assert reversals(noisy, SMALL * limits, DT) <= 10.0
    assert steps[1] <= steps[0] + 10.0
    if name != "icub":  # light arms on strong motors: measured rates alone are calm there
        assert reversals(raw, SMALL * limits, DT) > 30.0 or steps[2] > 1.5 * steps[1], (
            "noise would not show without the observer"
        )


def test_it_follows_what_the_model_knows_without_lag() -> None:
    """On the exact plant the estimate equals the true rate up to noise, also while joints accelerate."""
    robot = hqp.robots.load("panda")
    posture = Posture(law=PD(40.0, 12.0))
    session = hqp.Controller(Stack(Level(posture)), hqp.Torque(), deadline=math.inf).session(robot, DT)
    observer, rng, tick = RateObserver(robot, DT), np.random.default_rng(0), None
    q, v, off = robot.home.copy(), np.zeros(robot.nv), []
    goal = robot.state(q).angles + 0.3
    for _ in range(400):
        estimate = observer.update(v + NOISE * rng.normal(size=robot.nv), tick)
        off.append((estimate - v)[robot.actuated])
        tick = session.step(robot.state(q, estimate), posture.at(goal))
        q, v = robot.integrate(q, v, DT), v + DT * session.program.acceleration(tick.solution.x)  # type: ignore[attr-defined,union-attr]
    share = 1.0 - math.exp(-100.0 * DT)
    learns = 0.5 * share**2
    power = (2.0 * share**2 + learns * (2.0 - 3.0 * share)) / (
        share * (4.0 - 2.0 * share - learns)
    )  # alpha-beta filter
    expected = NOISE * math.sqrt(power)
    assert np.std(off[50:]) == pytest.approx(expected, rel=0.2)
    assert np.abs(np.mean(off[50:], axis=0)).max() < 0.5 * expected
    assert np.abs(v).max() > 0.01


@pytest.mark.parametrize("seed", range(4))
def test_it_learns_accelerations_that_the_model_lacks(seed: int) -> None:
    """Drawn ones, up to 10 rad/s^2, as of a load or a soft contact: 0.1 rad/s off before, and always to one side."""
    rng = np.random.default_rng(seed)
    robot = hqp.robots.load("panda")
    bandwidth = float(rng.uniform(30.0, 100.0))
    observer, v = RateObserver(robot, DT, bandwidth=bandwidth), np.zeros(robot.nv)
    unknown = rng.uniform(-10.0, 10.0, robot.nv)
    for _ in range(round(20.0 / bandwidth / DT)):
        found = observer.correct(v)
        observer.expect(found)
        v = v + DT * unknown
    assert np.abs(observer.correct(v) - v).max() < 1e-3
    observer.forget()
    np.testing.assert_array_equal(observer.correct(v), v)


def test_what_is_wrong_is_told() -> None:
    robot = hqp.robots.load("panda")
    for given in ({"period": 0.0}, {"period": DT, "bandwidth": math.nan}):
        with pytest.raises(DeclarationError, match="observer"):
            RateObserver(robot, **given)
    observer, bad = RateObserver(robot, DT), np.full(robot.nv, np.nan)
    assert np.isnan(observer.update(bad)).all()
    np.testing.assert_array_equal(observer.update(np.ones(robot.nv)), np.ones(robot.nv))
