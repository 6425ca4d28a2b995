"""A stop brings every robot to rest at every level and holds it until resume."""

from __future__ import annotations

import threading
from collections.abc import Callable
from typing import Any

import numpy as np
import pinocchio as pin
import pytest

import hqp
import hqp.tasks as t
from hqp import Braking, Level, Stack, Status
from hqp.arrays import Vec
from hqp.errors import DeclarationError
from hqp.export.loaded import LoadedSession
from hqp.loop.file import text
from hqp.solvers.lexicographic import kernel
from tests.loop.test_begin import DT, FORMULATIONS, Physics, robot_nan, session, standing, tool

pytestmark = pytest.mark.skipif(not kernel(), reason="no native kernel here")

BRAKING = Braking(deceleration=20.0)


class Loop:
    """A hand on its way to a target, in a closed loop: integrated, at torque level by Pinocchio's dynamics."""

    def __init__(self, name: str, kind: str, **more: Any) -> None:
        self.run = session(name, kind, None, braking=more.pop("braking", BRAKING), **more)
        self.kind = kind
        self.robot: Any = self.run.robot
        self.physics = Physics(self.robot, standing(name))
        start = self.robot.state(self.physics.q).position(tool(self.robot))
        self.hand = self.run.stack.find("hand", t.Position).at(start + np.array((0.05, -0.05, 0.1)))
        self.sent: Vec = np.zeros(self.robot.actuated.size)

    def step(self, *, state: Any = None) -> hqp.Tick:
        at = self.physics
        tick = self.run.step(self.robot.state(at.q, at.v) if state is None else state, self.hand)
        if self.kind == "torque":
            at.step(tick.command)
        else:
            at.v = tick.x.copy() if self.kind == "velocity" else at.v + DT * tick.x
            at.q = self.robot.integrate(at.q, at.v, DT)
        self.sent = tick.command
        return tick

    @property
    def energy(self) -> float:
        """Kinetic energy [J]."""
        return float(pin.computeKineticEnergy(self.robot.model, self.physics.data, self.physics.q, self.physics.v))

    @property
    def speed(self) -> float:
        return float(np.abs(self.physics.v).max())


ROBOTS = [(name, kind) for name in ("ur5", "kinova", "cbi", "g1") for kind in FORMULATIONS]


@pytest.mark.parametrize(("name", "kind"), ROBOTS)
def test_a_stop_brings_a_robot_to_rest_and_holds_it_until_resume(name: str, kind: str) -> None:
    loop = Loop(name, kind)
    for _ in range(60):
        assert loop.step().status.usable
    fastest, energy = loop.speed, loop.energy
    assert fastest > 0.05
    loop.run.stop("operator")
    assert loop.run.stopped == "operator"
    v, q = loop.physics.v.copy(), loop.physics.q.copy()
    for k in range(400):
        tick = loop.step()
        assert tick.status is Status.STOPPED
        assert tick.held == k + 1
        assert [(note.element, note.detail.split(":")[0]) for note in tick.notes] == [("stop", "operator")]
        if kind != "torque":
            assert np.abs(loop.physics.v - v).max() <= BRAKING.deceleration * DT * (1.0 + 1e-6)
        v = loop.physics.v.copy()
    if kind == "torque":  # every joint slows down with the time constant of the damping
        assert loop.energy < 1e-4 * energy
        assert np.abs(pin.difference(loop.robot.model, q, loop.physics.q)).max() < 1.5 * BRAKING.damping * fastest
    else:
        assert loop.speed <= 1e-9
        away = np.abs(pin.difference(loop.robot.model, q, loop.physics.q)).max()
        assert away <= 0.5 * fastest**2 / BRAKING.deceleration + 2.0 * fastest * DT
    loop.run.resume()
    assert loop.run.stopped == ""
    before = loop.sent
    tick = loop.step()
    assert tick.status.usable
    assert tick.held == 0
    if kind == "velocity":  # the window of JointLimits stands around the command at rest
        most = next(e.acceleration or 0.0 for e in loop.run.stack if isinstance(e, t.JointLimits)) * DT
        assert np.abs(tick.command - before).max() <= most * (1.0 + 1e-6)
    for _ in range(300):
        tick = loop.step()
    assert tick.status.usable


@pytest.mark.parametrize("kind", FORMULATIONS)
def test_data_that_is_none_in_a_stop_is_told_and_changes_no_status(kind: str) -> None:
    loop = Loop("ur5", kind)
    for _ in range(30):
        loop.step()
    loop.run.stop()
    for k in range(300):
        tick = loop.step(state=robot_nan(loop.run) if k % 5 in (1, 2) else None)
        assert tick.status is Status.STOPPED
        assert np.isfinite(tick.command).all()
        assert tick.refused == (k % 5 in (1, 2))
    assert loop.speed < 0.01
    assert loop.run.counters.rejected_states == 120


def test_any_thread_may_stop_and_resume() -> None:
    loop = Loop("ur5", "velocity")
    done = threading.Event()

    def press() -> None:
        while not done.is_set():
            loop.run.stop("button")
            _ = loop.run.stopped
            loop.run.resume()
        loop.run.stop("last")

    thread = threading.Thread(target=press)
    thread.start()
    found = {loop.step().status for _ in range(1500)}
    done.set()
    thread.join()
    assert loop.step().status is Status.STOPPED
    assert found <= {Status.OPTIMAL, Status.STOPPED}


@pytest.mark.parametrize("kind", FORMULATIONS)
def test_a_stop_holds_through_a_change_of_stack(kind: str) -> None:
    loop = Loop("cbi", kind)
    for _ in range(20):
        loop.step()
    stack = loop.run.stack
    other = Stack(*stack.levels[:-1], Level(t.Posture(name="other")), subject_to=stack.subject_to)
    loop.run.change(other, over=0.1)
    for _ in range(10):
        tick = loop.step()
    far = tick.transition
    assert 0.0 < far < 1.0
    loop.run.stop()
    for k in range(300):
        tick = loop.step(state=robot_nan(loop.run) if k % 7 == 3 else None)
        assert tick.status is Status.STOPPED
        assert np.isfinite(tick.command).all()
    assert tick.transition == far
    assert loop.speed < 0.01
    loop.run.change(loop.run.stack, over=0.0)
    assert loop.step().status is Status.STOPPED
    loop.run.resume()
    assert loop.step().status.usable


@pytest.mark.parametrize("resume", ["auto", "ask"])
@pytest.mark.parametrize("kind", FORMULATIONS)
def test_a_long_interval_without_an_answer_waits_if_it_is_to_ask(kind: str, resume: str) -> None:
    loop = Loop("ur5", kind, braking=Braking(resume=resume, after=0.05))
    for _ in range(10):
        loop.step()
    bad = robot_nan(loop.run)
    for ticks, waits in ((25, False), (26, resume == "ask")):
        for k in range(ticks):
            bad = robot_nan(loop.run)
            tick = loop.step(state=bad)
            stopped = waits and k == 25
            assert tick.status is (Status.STOPPED if stopped else Status.INVALID_STATE), k
        tick = loop.step()
        assert tick.status is (Status.STOPPED if waits else Status.OPTIMAL)
        if waits:
            assert any("no answer was usable for 0.05 s" in note.detail for note in tick.notes)
            loop.run.resume()
            assert loop.step().status is Status.OPTIMAL


@pytest.mark.parametrize("kind", FORMULATIONS)
def test_files_and_batches_stop_with_the_same_bits(kind: str) -> None:
    loop = Loop("ur5", kind, braking=Braking(deceleration=20.0, resume="ask", after=0.02))
    file, batch = LoadedSession(text(loop.run)), hqp.Batch(loop.run.controller, loop.robot, 2, DT, threads=2)
    value = loop.hand.value
    assert value is not None
    calls: dict[int, Callable[[Any], None]] = {
        10: lambda s: s.stop(reason="operator"), 40: lambda s: s.resume(), 70: lambda s: s.resume()
    }  # fmt: skip
    seen = set()
    for k in range(80):
        q, v = loop.physics.q.copy(), loop.physics.v.copy()
        if k in calls:
            for each in (loop.run, file, batch):
                calls[k](each)
        if 50 <= k < 65:
            q = np.full(6, np.nan)
        tick = loop.step(state=loop.robot.state(q, v))
        found = file.step(q, v, {"hand": value})
        many = batch.step(np.tile(q, (2, 1)), np.tile(v, (2, 1)), {"hand": np.tile(value, (2, 1))})
        assert found.status is tick.status
        assert many.statuses() == (tick.status,) * 2
        seen.add(tick.status)
        np.testing.assert_array_equal(found.x, tick.x)
        np.testing.assert_array_equal(many.x, np.tile(tick.x, (2, 1)))
        assert file.stopped == loop.run.stopped
    assert seen == {Status.OPTIMAL, Status.INVALID_STATE, Status.STOPPED}
    file.stop("again")
    file.reset()
    assert file.stopped == "again"
    batch.stop([1])
    assert batch.step(np.tile(loop.physics.q, (2, 1))).statuses()[1] is Status.STOPPED
    batch.reset([1])
    assert batch.step(np.tile(loop.physics.q, (2, 1))).statuses()[1] is Status.OPTIMAL


@pytest.mark.parametrize("kind", FORMULATIONS)
def test_a_session_that_is_stopped_before_its_first_tick_holds(kind: str) -> None:
    loop = Loop("ur5", kind)
    loop.run.stop()
    q = loop.physics.q.copy()
    for _ in range(50):
        assert loop.step().status is Status.STOPPED
    assert np.abs(loop.physics.q - q).max() < 1e-9
    loop.run.resume()
    assert loop.step().status is Status.OPTIMAL


def test_other_ways_to_resume_are_refused() -> None:
    given: list[dict[str, Any]] = [{"resume": "never"}, {"resume": None}, {"after": 0.0}, {"after": "x"}]
    for wrong in given:
        with pytest.raises(DeclarationError, match="Braking"):
            Braking(**wrong)
