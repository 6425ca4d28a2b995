"""Tasks that stay unmet although a posture exists: notes and the path out."""

from __future__ import annotations

import pickle
import time
from threading import Thread
from typing import Any

import numpy as np
import pytest

import hqp
from hqp import Level, P, Stack, Status, Tick
from hqp.arrays import Vec
from hqp.declare.reference import Reference
from hqp.search import ways_out
from hqp.tasks import FixedContact, JointLimits, Position, Posture
from tests.scenes.calm.arrival import case
from tests.scenes.calm.drawn import scene

from .traps import CRAWL, TURNED, crawled_start, elbow, references, turned_start, whole_body


def until_stuck(
    robot: Any, stack: Stack, aims: list[Reference], q: Vec, dt: float, seconds: float, formulation: Any = None
) -> tuple[Vec, Tick, float]:
    """Run until a task is stuck or time is over: final configuration, tick, time."""
    session = hqp.Controller(stack, formulation or hqp.Velocity(), deadline=np.inf).session(robot, dt)
    v, every = np.zeros(robot.nv), max(1, round(0.05 / dt))
    for k in range(round(seconds / dt)):
        tick = session.step(robot.state(q, v), *aims)
        if tick.way_out() is not None:
            break
        if k % every == 0:
            time.sleep(0.002)  # gives the thread a turn
        q, v = tick.advance()
    return q, tick, k * dt


@pytest.mark.parametrize(("targets", "begin"), [(TURNED, turned_start), (CRAWL, lambda robot: crawled_start())])
def test_a_humanoid_knows_the_way_out_of_a_trap(targets: dict[str, tuple[float, ...]], begin: Any) -> None:
    """Facing backwards, and after a crawl: both feet stay off forever."""
    robot, stack = whole_body()
    aims = references(stack, targets)
    _, tick, _ = until_stuck(robot, stack, aims, begin(robot), 1.0 / 120.0, 8.0)
    assert tick.status is Status.OPTIMAL
    note = next(note for note in tick.notes if "STUCK" in note.detail)
    assert note.detail.startswith("STUCK: left_foot is at rest 0.")
    assert "limit" in note.detail
    posture = tick.way_out()
    assert posture is not None
    assert pickle.loads(pickle.dumps(tick)).way_out() == pytest.approx(posture)
    state = robot.state(posture)
    for aim in aims:
        if aim.name.endswith("foot"):
            assert np.linalg.norm(stack.find(aim.name).error(state, aim.value)) < 2e-3
    assert (state.angles[6:] > robot.lower[6:] - 1e-6).all()
    assert (state.angles[6:] < robot.upper[6:] + 1e-6).all()


def far(robot: Any, hand: Any, aim: Reference, q: Vec) -> float:
    """Distance of the hand from its target [m, rad]."""
    return float(np.linalg.norm(hand.error(robot.state(q), aim.value)))


@pytest.mark.parametrize("formulation", [hqp.Velocity(), hqp.Acceleration()], ids=["velocity", "acceleration"])
def test_an_arm_goes_free_where_the_user_takes_the_posture(formulation: Any) -> None:
    robot, hand, aim, start = elbow()
    if formulation.order == 2:
        hand = type(hand)(frame=hand.frame, name="hand", law=hqp.PD(100.0))
    posture = Posture(law=P(1.0) if formulation.order == 1 else hqp.PD(25.0))
    stack = Stack(Level(hand), Level(posture), subject_to=[JointLimits()])
    q, tick, _ = until_stuck(robot, stack, [aim], start, 0.01, 8.0, formulation)
    way = tick.way_out()
    assert way is not None
    assert far(robot, hand, aim, q) > 0.05
    first = Posture(law=P(2.0) if formulation.order == 1 else hqp.PD(25.0), name="way out")
    free = Stack(Level(first), Level(hand), subject_to=[JointLimits()])
    session = hqp.Controller(free, formulation, deadline=np.inf).session(robot, 0.01)
    there, v = first.at(robot.state(way).angles), np.zeros(robot.nv)
    for _ in range(600):
        tick = session.step(robot.state(q, v), there, aim)
        q, v = tick.advance()
    assert far(robot, hand, aim, q) < 5e-3
    assert tick.way_out() is None


def test_the_note_goes_where_the_task_moves_again() -> None:
    robot, hand, aim, start = elbow()
    stack = Stack(Level(hand), Level(Posture()), subject_to=[JointLimits()])
    session = hqp.Controller(stack, deadline=np.inf).session(robot, 0.01)
    q, v, told = start, np.zeros(robot.nv), []
    home = hand.at(hand.value(robot.state(q)))
    for k in range(800):
        tick = session.step(robot.state(q, v), aim if not any(told) else home)
        told.append(tick.way_out() is not None)
        if any(told) and k > told.index(True) + 50:
            break
        if k % 25 == 0:
            time.sleep(0.002)
        q, v = tick.advance()
    assert any(told)
    assert not told[-1]


def test_a_session_may_do_without() -> None:
    robot, hand, aim, start = elbow()
    stack = Stack(Level(hand), Level(Posture()), subject_to=[JointLimits()])
    session = hqp.Controller(stack, deadline=np.inf).session(robot, 0.01, stuck=False)
    q, v = start, np.zeros(robot.nv)
    for _ in range(400):
        tick = session.step(robot.state(q, v), aim)
        assert tick.way_out() is None
        q, v = tick.advance()
    assert far(robot, hand, aim, q) > 0.05


@pytest.mark.long
def test_what_is_out_of_reach_is_not_stuck(monkeypatch: pytest.MonkeyPatch) -> None:
    """Start at most one query in two seconds."""
    asked: list[Any] = []
    begin = ways_out.Query.__init__

    def counted(self: Any, *given: Any) -> None:
        asked.append(given)
        begin(self, *given)

    monkeypatch.setattr(ways_out.Query, "__init__", counted)
    robot = hqp.robots.load("g1")
    hand = Position(frame="right_rubber_hand", law=P(5.0))
    feet = [FixedContact(frame=sole) for sole in robot.landmarks["soles"]]
    stack = Stack(Level(hand), Level(Posture()), subject_to=[*feet, JointLimits()])
    goal = hand.value(robot.state(robot.home)) + np.array([1.5, 0.0, 0.0])
    begun = time.monotonic()
    _, tick, _ = until_stuck(robot, stack, [hand.at(goal)], robot.home.copy(), 0.005, 10.0)
    assert tick.way_out() is None
    assert 1 <= len(asked) <= 1 + (time.monotonic() - begun) / ways_out.PAUSE


def test_a_slow_task_is_not_stuck() -> None:
    robot = hqp.robots.load("ur5")
    hand = Position(frame="tool0", law=P(0.02))
    stack = Stack(Level(hand), Level(Posture()), subject_to=[JointLimits()])
    q = robot.integrate(robot.home, np.array([0.3, -1.4, 1.5, -1.2, -1.3, 0.2]), 1.0)
    goal = hand.value(robot.state(q)) + np.array([0.0, 0.1, 0.0])
    _, tick, when = until_stuck(robot, stack, [hand.at(goal)], q, 0.005, 4.0)
    assert tick.way_out() is None
    assert when > 3.9


@pytest.mark.long
def test_a_hand_that_creeps_on_is_not_stuck() -> None:
    """A quadruped's trunk leaves its corner within 9 s."""
    drawn = scene(55, "acceleration")
    robot = drawn.subject.robot
    aims = list(drawn.targets(0.0))
    q, tick, _ = until_stuck(robot, drawn.stack, aims, robot.home.copy(), drawn.dt, 12.0, hqp.Acceleration())
    assert tick.way_out() is None
    hand: Any = drawn.stack.find("hand")
    assert np.linalg.norm(hand.error(robot.state(q), aims[0].value)) < 1e-3


FIRST, EVERY = 3, 5
"""First seed and stride of the drawn loops; one of them is stuck."""


@pytest.mark.slow
@pytest.mark.parametrize(("formulation", "seeds"), [("velocity", 100), ("acceleration", 60), ("torque", 40)])
def test_no_false_alarm_in_drawn_loops(formulation: str, seeds: int) -> None:
    """A task reported as stuck does not arrive within the next 10 s."""
    told = [(seed, name) for seed in range(FIRST, seeds, EVERY) for name in alarms(formulation, seed)]
    assert not [each for each in told if each[1].endswith("arrived")]


@pytest.mark.slow
@pytest.mark.parametrize("name", ["ur5", "panda", "xarm7"])
def test_of_random_goals_those_that_are_missed_are_told(name: str) -> None:
    """Report no other goal."""
    alarms = 0
    for seed in range(12):
        one = case(name, seed)
        session = hqp.Controller(one.stack, deadline=np.inf).session(one.robot, one.dt)
        q, v, told = one.start, np.zeros(one.robot.nv), False
        for k in range(round(14.0 / one.dt)):
            tick = session.step(one.robot.state(q, v), one.hand.at(one.goal))
            told |= tick.way_out() is not None
            if k % max(1, round(0.05 / one.dt)) == 0:
                time.sleep(0.001)
            q, v = tick.advance()
        alarms += told
        assert told == (one.off(q) > 0.01), one.text
    assert alarms


def alarms(formulation: str, seed: int) -> list[str]:
    """Tasks of a drawn loop that were reported stuck, each with its final outcome."""
    drawn = scene(seed, formulation)
    robot = drawn.subject.robot
    law = {"velocity": hqp.Velocity, "acceleration": hqp.Acceleration, "torque": hqp.Torque}[formulation]()
    session = hqp.Controller(drawn.stack, law, deadline=np.inf).session(robot, drawn.dt)
    q, v, told = robot.home.copy(), np.zeros(robot.nv), dict[str, float]()
    aims: list[Reference] = []
    for k in range(round(16.0 / drawn.dt)):
        t = k * drawn.dt
        aims = list(drawn.targets(t))
        tick = session.step(robot.state(q, v), *aims)
        if not told and t > 6.0:
            break
        if tick.way_out() is not None:
            note = next(note for note in tick.notes if "STUCK" in note.detail)
            told.setdefault(note.element, t)
        since = min(told.values(), default=t)
        if t > since + 10.0:
            break
        if k % max(1, round(0.05 / drawn.dt)) == 0:
            time.sleep(0.001)
        q, v = tick.advance()
    state, found = robot.state(q), []
    for name in told:
        task: Any = drawn.stack.find(name)
        error = task.error(state, next(aim.value for aim in aims if aim.name == name))
        found.append(f"{name} {'arrived' if np.abs(error).max() < 1e-3 else 'off'}")
    return found


def test_a_search_starts_no_search(monkeypatch: pytest.MonkeyPatch) -> None:
    """Steps of a search are no loop: out of reach they start no search for a way out."""
    begun: list[str] = []
    monkeypatch.setattr(Thread, "start", lambda thread: begun.append(thread.name))
    robot = hqp.robots.load("ur5")
    hand = Position(frame="tool0")
    stack = Stack(Level(hand), Level(Posture()), subject_to=[JointLimits()])
    assert not hqp.reach(stack, robot, hand.at([2.0, 0.0, 0.5])).success
    assert not begun
