"""Joints that do not follow their commands, in MuJoCo; and healthy robots with delay, noise, contacts and pushes."""

from __future__ import annotations

import math
from pathlib import Path

import numpy as np
import pytest

pytest.importorskip("mujoco")

import hqp
from hqp import PD, Braking, Level, P, Stack, Status
from hqp.tasks import Posture
from tests.scenes.following import DT, MAX_AGE, Fault, Loop, load

LEVELS = ("velocity", "acceleration", "torque")
DELAY = MAX_AGE + 3 * DT + 0.05
SPAN, WAY, AGAIN = 0.5, 1.0, 1.0
"""Constants of hqp/cpp/session/follow_watch.hpp [s]."""


@pytest.mark.parametrize("level", LEVELS)
@pytest.mark.parametrize("name", ["ur5", "panda"])
def test_no_healthy_arm_is_stopped(name: str, level: str) -> None:
    assert Loop(name, level, seed=1, late=3, noise=0.02, push=40.0).run().caught == math.inf


@pytest.mark.slow
@pytest.mark.parametrize("seed", range(2, 8))
@pytest.mark.parametrize(
    ("name", "level"),
    [(n, level) for n in ("ur5", "panda") for level in LEVELS]
    + [(n, level) for n in ("g1", "talos") for level in ("velocity", "torque")],
)
def test_no_healthy_robot_is_stopped(name: str, level: str, seed: int) -> None:
    late, push = seed % 4, (0.0, 30.0)[seed % 2]
    loop = Loop(name, level, seed=seed, late=late, noise=0.02, push=push).run()
    assert loop.caught == math.inf, loop.notes[-1]
    if loop.robot.floating:
        assert loop.plant.com()[2] > 0.8 * loop.robot.state(loop.robot.home).com()[2], "it fell: no healthy loop"


FAULTS = [Fault("frozen", at=0.1), Fault("blocked", (1,), at=0.1), Fault("exchanged", (1, 2), at=0.1)]


@pytest.mark.parametrize("fault", FAULTS, ids=lambda fault: fault.kind)
@pytest.mark.parametrize("level", LEVELS)
def test_faults_are_caught(level: str, fault: Fault) -> None:
    loop = Loop("ur5", level, seed=1, late=1, noise=0.02, fault=fault).run()
    assert loop.notes, "nobody was told"
    if level != "torque" or fault.kind == "frozen":  # at torque level a brake and a load look alike
        assert loop.caught <= 0.7
        held = [s for s in loop.statuses if s is Status.NOT_FOLLOWING]
        assert len(held) * DT <= AGAIN + DT or loop.ticks * DT < 2 * AGAIN
        first = loop.statuses.index(Status.NOT_FOLLOWING)
        assert first * DT >= fault.at, "caught before there was a fault"
        if level != "torque":
            last = loop.commands[min(first + 100, loop.ticks - 1)]
            assert np.abs(last).max() < 1e-6, "the command did not come to rest"


@pytest.mark.long
@pytest.mark.parametrize("seed", [1, 2, 3])
@pytest.mark.parametrize("name", ["ur5", "panda"])
def test_a_sensor_that_is_frozen_from_the_start_is_caught_at_torque_level(name: str, seed: int) -> None:
    """At rest nothing is wrong with its speed; but noise would change its last digits."""
    frozen = Loop(name, "torque", seed=seed, late=1, noise=0.02, fault=Fault("frozen", at=0.0)).run()
    assert 0.25 <= frozen.caught <= 0.7
    held = Loop(name, "torque", seed=seed, late=1, noise=0.02, wall=True).run()
    assert held.caught == math.inf


@pytest.mark.slow
@pytest.mark.parametrize("seed", range(2, 6))
@pytest.mark.parametrize("kind", ["frozen", "exchanged"])
@pytest.mark.parametrize("level", ["velocity", "acceleration"])
@pytest.mark.parametrize("name", ["ur5", "panda"])
def test_drawn_faults_are_caught(name: str, level: str, kind: str, seed: int) -> None:
    fault = Fault(kind, (1, 2), at=0.05 * seed)
    loop = Loop(name, level, seed=seed, late=seed % 4, noise=0.02, fault=fault, ticks=900).run()
    assert 0.0 <= loop.caught <= 1.0


def test_an_arm_against_a_wall_is_stopped_at_velocity_level_and_noted_at_torque_level() -> None:
    at_wall = Loop("ur5", "velocity", seed=1, wall=True).run()
    assert at_wall.caught < 0.7
    pressing = Loop("ur5", "torque", seed=1, wall=True).run()
    assert pressing.caught == math.inf
    assert "a load or contact that the model lacks" in pressing.notes[0]


def blocked(session: hqp.Session, posture: Posture, goal: np.ndarray, ticks: int, q: np.ndarray) -> list[hqp.Tick]:
    robot = session.robot
    return [
        session.step(robot.state(q, np.zeros(robot.nv), time=k * DT), posture.at(goal), now=k * DT)
        for k in range(ticks)
    ]


@pytest.mark.parametrize("share", [0.15, 0.3, 0.9])
def test_a_blocked_joint_is_caught_within_the_documented_time(share: float) -> None:
    """t = -kWay log(1 - v_max delay / (u kWay)) at a constant commanded speed u, never if u <= v_max delay / kWay."""
    robot = load("ur5")
    top, goal = robot.velocity_limit[0], robot.home + np.eye(6)[0]
    first = caught(P(1e3, max_velocity=share * top), goal)
    expected = -WAY * math.log(1.0 - DELAY / (share * WAY))
    assert abs(first - expected) <= 0.02 * expected + 2 * DT
    assert caught(P(1e3, max_velocity=0.95 * DELAY / WAY * top), goal, 3000) == math.inf


def caught(law: P, goal: np.ndarray, ticks: int = 1000) -> float:
    """Time to NOT_FOLLOWING of a UR5 that does not move [s]."""
    robot, posture = load("ur5"), Posture(law=law)
    session = hqp.Controller(Stack(Level(posture)), price=0, deadline=math.inf).session(
        robot, DT, max_age=MAX_AGE, stuck=False
    )
    found = blocked(session, posture, goal, ticks, robot.home)
    return next((k * DT for k, tick in enumerate(found) if tick.status is Status.NOT_FOLLOWING), math.inf)


@pytest.mark.parametrize("resume", ["auto", "ask"])
def test_it_is_tried_again_or_waits_for_resume(resume: str) -> None:
    robot = load("ur5")
    posture = Posture(law=P(5.0))
    controller = hqp.Controller(Stack(Level(posture)), deadline=math.inf, braking=Braking(resume=resume))
    session = controller.session(robot, DT, max_age=MAX_AGE, stuck=False)
    ticks = blocked(session, posture, robot.home + 1.0, 1000, robot.home)
    statuses = [tick.status for tick in ticks]
    first = statuses.index(Status.NOT_FOLLOWING)
    after = set(statuses[first + round((AGAIN + 0.002) / DT) :])
    if resume == "auto":
        assert Status.OPTIMAL in after
        assert Status.STOPPED not in after
    else:
        assert after == {Status.STOPPED}
        session.resume()
        assert session.step(robot.state(time=2.0), now=2.0).status is Status.OPTIMAL


def test_files_say_the_same(tmp_path: Path) -> None:
    robot = load("ur5")
    posture = Posture(law=PD(100.0, 20.0))
    session = hqp.Controller(Stack(Level(posture)), hqp.Acceleration(), deadline=math.inf).session(
        robot, DT, max_age=MAX_AGE, stuck=False
    )
    session.export(tmp_path / "arm.hqp")
    file = hqp.load(tmp_path / "arm.hqp")
    live = blocked(session, posture, robot.home + 0.3, 400, robot.home)
    for k, tick in enumerate(live):
        told = file.step(robot.home, None, {posture.name: robot.home + 0.3}, time=k * DT, now=k * DT)
        assert told.status is tick.status
        assert [note.detail for note in told.notes] == [note.detail for note in tick.notes if note.element == "joints"]
    assert live[-1].status is Status.NOT_FOLLOWING


def test_sessions_without_max_age_do_not_compare() -> None:
    """Repeated ticks of one state, or states in any order, are no closed loop."""
    robot = load("ur5")
    session = hqp.Controller(Stack(Level(Posture())), deadline=math.inf).session(robot, DT, stuck=False)
    goal = Posture().at(robot.home + 1.0)
    assert {session.step(robot.state(), goal).status for _ in range(300)} == {Status.OPTIMAL}
