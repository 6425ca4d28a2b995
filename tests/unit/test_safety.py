"""Inputs of a session, its outputs, and the command without a usable solution."""

from __future__ import annotations

import dataclasses
import pickle
import sys
import threading
from pathlib import Path
from time import monotonic
from typing import Any, ClassVar

import numpy as np
import pinocchio as pin
import pytest

import hqp
from hqp import Level, P, Stack, Status
from hqp.declare.element import Inequality
from hqp.declare.safety import Braking, RateLimits, StateBounds
from hqp.errors import ConcurrentUse, DeclarationError, HqpError, ModelError, UnknownReference
from hqp.robots import Robot
from hqp.tasks import Com, FixedContact, JointLimits, JointTorque, Momentum, Position, Posture, TorqueLimits
from tests.scenes.altered import Altered, Answers
from tests.scenes.overloaded import measure as measure_deadline
from tests.scenes.overloaded import overloaded

DT = 0.002


@pytest.fixture
def robot() -> Robot:
    return hqp.robots.load("cbi")


def feet() -> list[FixedContact]:
    return [FixedContact(frame="l_sole"), FixedContact(frame="r_sole")]


def stack(*more: Any, hand: Any = None) -> Stack:
    return Stack(Level(hand or Position(frame="r_palm", name="hand")), Level(Posture()), subject_to=[*feet(), *more])


FORMULATIONS = pytest.mark.parametrize(
    "formulation", [hqp.Velocity(), hqp.Acceleration(), hqp.Torque()], ids=["velocity", "acceleration", "torque"]
)


def session(robot: Robot, formulation: Any = None, declared: Stack | None = None, **options: Any) -> hqp.Session:
    limits = TorqueLimits() if isinstance(formulation, hqp.Torque) else JointLimits()
    made = hqp.Controller(declared or stack(limits), formulation or hqp.Velocity(), deadline=np.inf, **options)
    return made.session(robot, DT)


# in -----------------------------------------------------------------------------------------------------------------


def states(robot: Robot) -> dict[str, tuple[Any, Any]]:
    q, v = robot.home, np.zeros(robot.nv)
    knee = int(robot.joints("R_KFE")[0])

    def with_q(i: Any, value: Any) -> np.ndarray:
        changed = q.copy()
        changed[i] = value
        return changed

    def with_v(i: int, value: float) -> np.ndarray:
        changed = v.copy()
        changed[i] = value
        return changed

    return {
        "R_KFE: position nan": (with_q(knee + 1, np.nan), v),
        "R_KFE: velocity inf": (q, with_v(knee, np.inf)),
        "R_KFE: velocity 1e+30 is too large": (q, with_v(knee, 1e30)),
        "R_KFE: position 200 is too large": (with_q(knee + 1, 200.0), v),
        "base: quaternion of length 0,": (with_q(slice(3, 7), 0.0), v),
        "base: quaternion of length 1.01": (with_q(slice(3, 7), 1.01 * q[3:7]), v),
        "base: position 1e+06 m is too far": (with_q(0, 1e6), v),
        "base: velocity 1e+05 is too large": (q, with_v(1, 1e5)),
        "R_KFE: velocity 1e+200 is not a finite number": (q, with_v(knee, 1e200)),
    }


@FORMULATIONS
def test_a_state_that_is_none_is_refused_by_joint(robot: Robot, formulation: Any) -> None:
    for said, (q, v) in states(robot).items():
        run = session(robot, formulation)
        run.step(robot.state())
        with np.errstate(over="ignore"):
            tick = run.step(robot.state(q, v))
        assert tick.status is Status.INVALID_STATE, said
        assert said.split(" too")[0] in tick.notes[0].detail
        assert np.isfinite(tick.command).all()
        assert tick.held == 1
        assert run.step(robot.state()).held == 0


def test_a_quaternion_nearly_of_length_one_is_used_as_one(robot: Robot) -> None:
    q = robot.home.copy()
    q[3:7] *= 1.0 + 9e-4
    run, plain = session(robot), session(robot)
    goal = robot.state().position("r_palm") + [0.0, 0.0, 0.01]
    hand = run.stack.find("hand", Position)
    run.step(robot.state())
    plain.step(robot.state())
    tick = run.step(robot.state(q), hand.at(goal))
    assert tick.status is Status.OPTIMAL
    assert np.allclose(tick.command, plain.step(robot.state(), hand.at(goal)).command, atol=1e-9)


def test_bounds_of_a_state_are_declared(robot: Robot) -> None:
    v = np.zeros(robot.nv)
    v[6:] = 3.0
    assert session(robot).step(robot.state(None, v)).held == 0
    bounds = StateBounds(speed=1e-6)  # accepted: ten times a joint's limit
    v[0] = 1.0
    tick = session(robot, bounds=bounds).step(robot.state(None, v))
    assert "base: velocity 1 is too large" in tick.notes[0].detail
    for wrong in ({"outside": 0.0}, {"speed": np.nan}, {"distance": "far"}, {"angle": -1.0}):
        with pytest.raises(DeclarationError, match="StateBounds"):
            StateBounds(**wrong)  # type: ignore[arg-type]


def test_old_states_are_refused(robot: Robot) -> None:
    run = hqp.Controller(stack()).session(robot, DT, max_age=0.01)
    assert run.step(robot.state(time=5.0), now=5.005).status is Status.OPTIMAL
    assert "0.02 s old" in run.step(robot.state(time=5.0), now=5.02).notes[0].detail
    assert "time" in run.step(robot.state(), now=5.02).notes[0].detail
    assert run.step(robot.state(time=np.nan), now=5.02).status is Status.INVALID_STATE
    with pytest.raises(DeclarationError, match="max_age"):
        hqp.Controller(stack()).session(robot, DT, max_age=0.0)


@pytest.mark.parametrize("ahead", [0.002, 0.02, 3600.0, np.inf])
def test_states_from_the_future_are_refused(robot: Robot, ahead: float) -> None:
    run = hqp.Controller(stack()).session(robot, DT, max_age=0.01)
    assert run.step(robot.state(time=5.0), now=5.0 - 1e-4).status is Status.OPTIMAL  # two clocks differ a little
    tick = run.step(robot.state(time=5.0 + ahead), now=5.0)
    assert tick.status is Status.INVALID_STATE
    assert f"{ahead:.3g} s ahead of the session's clock" in tick.notes[0].detail
    wall = run.step(robot.state(time=monotonic() + ahead))
    assert "ahead of the session's clock" in wall.notes[0].detail


def test_the_callers_arrays_are_copied(robot: Robot) -> None:
    q, v = robot.home.copy(), np.zeros(robot.nv)
    state = robot.state(q, v)
    q[:] = np.nan
    assert state.valid
    with pytest.raises(ValueError, match="read-only"):
        state.q[0] = 1.0
    hand = Position(frame="r_palm", name="hand")
    goal, rate = np.array([0.3, -0.2, 1.0]), np.ones(3)
    reference = hand.at(goal, velocity=rate)
    goal[:], rate[:] = np.nan, np.nan
    assert reference.finite
    run = session(robot)
    run.step(robot.state())
    palm = robot.state().position("r_palm")
    first = run.step(robot.state(), hand.at(palm + 0.02))
    sent = first.command.copy()
    first.command[:] = 1e9
    assert first.solution is not None
    if first.solution.x.flags.writeable:
        first.solution.x[:] = 1e9
    bad = run.step(robot.state(np.full(robot.nq, np.nan)))
    assert np.abs(bad.command).max() <= np.abs(sent).max()


# out ----------------------------------------------------------------------------------------------------------------


@FORMULATIONS
@pytest.mark.parametrize("solver", ["lexicographic", "weighted"])
def test_a_lasting_bad_state_brings_the_command_to_rest(robot: Robot, formulation: Any, solver: str) -> None:
    run = session(robot, formulation, solver=solver)
    rng = np.random.default_rng(3)
    v = 0.2 * rng.standard_normal(robot.nv)
    hand = run.stack.find("hand", Position)
    run.step(robot.state())
    palm = robot.state().position("r_palm")
    good = run.step(robot.state(None, v), hand.at(palm + 0.05))
    assert good.status.usable
    lost, sent = np.full(robot.nq, np.nan), [good.command]
    for k in range(1, 600):
        tick = run.step(robot.state(lost))
        assert tick.held == k
        assert np.isfinite(tick.command).all()
        sent.append(tick.command)
    if formulation.order == 1:
        moved = robot.home[7:] + DT * np.cumsum(sent, axis=0)[:-1]
        near = np.minimum(moved - robot.lower[6:], robot.upper[6:] - moved) < 1e-3  # a joint stops at its limit at once
        assert np.where(near, 0.0, np.abs(np.diff(sent, axis=0))).max() <= 50.0 * DT + 1e-12
    if isinstance(formulation, hqp.Torque):
        J = np.vstack([robot.state().jacobian(frame) for frame in ("l_sole", "r_sole")])
        g = robot.state().gravity_force()
        rest = g.copy()
        rest[robot.actuated] -= sent[-1]  # carried by the feet alone
        forces = np.linalg.lstsq(J.T, rest, rcond=None)[0]
        assert np.abs(J.T @ forces - rest).max() < 1e-6 * np.abs(g).max()
        assert np.abs(sent[-1]).max() > 1.0
    else:
        assert np.abs(sent[-1]).max() < 1e-9
    assert run.step(robot.state()).held == 0


def test_a_command_on_its_way_to_rest_stops_at_the_limits(robot: Robot) -> None:
    run = hqp.Controller(Stack(Level(Posture(law=P(0.0)))), braking=Braking(deceleration=1.0), deadline=np.inf).session(
        robot, DT
    )
    posture = run.stack.find("posture", Posture)
    elbow = int(robot.joints("R_EB")[0])
    q = robot.home.copy()
    q[elbow + 1] = robot.upper[elbow] - 0.01
    rate = np.zeros(robot.nv - 6)
    rate[elbow - 6] = 2.0
    tick = run.step(robot.state(q), posture.at(velocity=rate))
    place = float(q[elbow + 1]) + DT * float(tick.command[elbow - 6])
    for _ in range(2000):
        place += DT * float(run.step(robot.state(np.full(robot.nq, np.nan))).command[elbow - 6])
        assert place <= robot.upper[elbow] + 1e-12


def test_contacts_hold_on_the_way_to_rest(robot: Robot) -> None:
    run = session(robot, declared=stack())
    hand = run.stack.find("hand", Position)
    run.step(robot.state())
    state = robot.state()
    good = run.step(state, hand.at(state.position("r_palm") + 0.3))
    assert good.solution is not None
    J = robot.state().jacobian("l_sole")
    for _ in range(5):
        held = run.step(robot.state(np.full(robot.nq, np.nan)))
        assert np.abs(held.x).max() > 1e-3
        assert np.abs(J @ held.x).max() < 1e-9


def test_an_answer_that_is_not_certified_is_not_sent(robot: Robot) -> None:
    answers = Answers()
    run = session(robot, declared=stack(), solver=Altered(answers=answers))
    hand = run.stack.find("hand", Position)
    run.step(robot.state())
    state = robot.state()
    goal = hand.at(state.position("r_palm") + 0.02)
    good = run.step(state, goal)

    def refused(problem: Any, found: Any) -> Any:
        return dataclasses.replace(found, status=Status.NOT_CERTIFIED, detail="refused", x=np.full(57, 3.0))

    answers.alter = refused
    ticks = [run.step(robot.state(), goal) for _ in range(3)]
    assert [tick.held for tick in ticks] == [1, 2, 3]
    assert all(tick.status is Status.NOT_CERTIFIED for tick in ticks)
    assert all(np.abs(tick.command).max() < np.abs(good.command).max() for tick in ticks)


@pytest.mark.parametrize("deadline", [2e-4, 4e-4])
def test_conflicts_at_torque_level_keep_a_deadline(deadline: float) -> None:
    """Feet must bear more than the weight: exact levels, priced stages and the certificate all stop at the deadline."""
    found = measure_deadline(hqp.robots.load("g1"), 150, deadline)
    assert found.statuses["TIME_LIMIT"] > 20
    assert found.worse == 0
    assert np.median(found.cpu) < deadline + 2e-3
    assert np.percentile(found.cpu, 95) < deadline + 5e-3


@pytest.mark.long
@pytest.mark.parametrize("ticks", [20, pytest.param(60, marks=pytest.mark.slow)])
def test_a_stopped_tick_can_be_explained(ticks: int) -> None:
    robot = hqp.robots.load("g1")
    run = hqp.Controller(overloaded(robot), hqp.Torque(), deadline=3e-5).session(robot, DT)
    goal = run.stack.find("hand", Position).at([1.0, 0.5, 1.0])
    stopped = 0
    for k in range(ticks):
        tick = run.step(robot.state(None, 0.1 * np.sin(k + np.arange(robot.nv))), goal)
        if tick.status is Status.TIME_LIMIT:
            stopped += 1
            assert {a.element for a in tick.explain().accounts} == set(tick.account().elements)
    assert stopped > 5


def test_an_unfinished_answer_is_no_worse_than_the_last_command(robot: Robot) -> None:
    answers = Answers()
    run = session(robot, solver=Altered(answers=answers))
    hand = run.stack.find("hand", Position)
    state = robot.state()
    goal = hand.at(state.position("r_palm") + 0.02)
    good = run.step(state, goal)
    for spoilt in (np.full(57, 1e3), np.zeros(57)):

        def unfinished(problem: Any, found: Any, x: Any = spoilt) -> Any:
            return dataclasses.replace(found, status=Status.TIME_LIMIT, x=x)

        answers.alter = unfinished
        tick = run.step(robot.state(), goal)
        assert tick.status is Status.TIME_LIMIT
        assert tick.held == 0
        assert np.allclose(tick.command, good.command)


def test_rates_hold_in_every_tick_and_say_what_they_cost(robot: Robot) -> None:
    limits = RateLimits(velocity=2.0, acceleration=100.0, torque=500.0)
    for formulation, rate in ((hqp.Velocity(), 2.0), (hqp.Acceleration(), 100.0), (hqp.Torque(), 500.0)):
        run = session(robot, formulation, rates=limits)
        hand = run.stack.find("hand", Position)
        start = robot.state()
        last = run.step(start).command
        goal = start.position("r_palm") + 0.1
        limited = 0
        for k in range(60):
            q = np.full(robot.nq, np.nan) if k % 7 == 3 else robot.home
            tick = run.step(robot.state(q), hand.at(goal * (1.0 if k < 30 else np.nan)))
            assert np.abs(tick.command - last).max() <= rate * DT * (1.0 + 1e-9)
            said = [note.detail for note in tick.notes if note.element == "rates"]
            assert all(detail.split(" would change by")[0] in robot.joint_names for detail in said)
            limited += len(said)
            last = tick.command
        assert limited > 0
    run = session(robot, hqp.Acceleration(), rates=limits)
    run.step(robot.state())
    notes = run.step(robot.state(None, np.full(robot.nv, 0.3))).notes  # moving feet must stop within a tick
    off = {note.element for note in notes if "by the rate limit" in note.detail}
    assert {"l_sole", "r_sole"} <= off
    for wrong in ({"velocity": 0.0}, {"torque": [1.0, -1.0]}, {"acceleration": np.inf}):
        with pytest.raises(DeclarationError, match="RateLimits"):
            RateLimits(**wrong)  # type: ignore[arg-type]
    with pytest.raises(DeclarationError, match="51 on"):
        session(robot, rates=RateLimits(velocity=[1.0, 2.0]))


# user elements ------------------------------------------------------------------------------------------------------


@dataclasses.dataclass(frozen=True, kw_only=True)
class Faulty(Position):
    """User task that fails in a given way from its third evaluation on."""

    kind: str = ""

    @property
    def ill(self) -> bool:
        return getattr(self, "_count", 0) > 2

    def jacobian(self, state: Any) -> Any:
        J = super().jacobian(state).copy()
        if not self.ill:
            return J
        if self.kind == "raises":
            raise RuntimeError("the camera is gone")
        return {
            "nan": J * np.nan,
            "huge": J * 1e200,
            "large": J * 1e12,
            "shape": J[:1],
            "vector": J[0],
            "none": None,
        }.get(self.kind, J)

    def error(self, state: Any, reference: Any) -> Any:
        object.__setattr__(self, "_count", getattr(self, "_count", 0) + 1)
        e = super().error(state, reference)
        return e[:2] if self.ill and self.kind == "short" else e


@dataclasses.dataclass(frozen=True, kw_only=True)
class Wall(Inequality):
    """User inequality with wrong bounds after the first tick."""

    kind: str = ""

    def rows(self, robot: Any) -> int:
        return 1

    def jacobian(self, state: Any) -> Any:
        return state.jacobian("r_palm")[:1]

    def drift(self, state: Any) -> Any:
        return state.drift("r_palm")[:1]

    def bounds(self, state: Any) -> Any:
        object.__setattr__(self, "_count", getattr(self, "_count", 0) + 1)
        if getattr(self, "_count", 0) == 1:
            return -5.0, 5.0
        return {"crossed": (1.0, -1.0), "nan": (-1.0, np.nan), "infinite": (-1.0, -np.inf), "beyond": (np.inf, np.inf)}[
            self.kind
        ]


@FORMULATIONS
@pytest.mark.parametrize("kind", ["raises", "nan", "huge", "large", "shape", "vector", "none", "short"])
def test_a_faulty_task_costs_no_other_element_its_rows(robot: Robot, formulation: Any, kind: str) -> None:
    run = session(robot, formulation, stack(hand=Faulty(frame="r_palm", name="hand", kind=kind)))
    without = session(robot, formulation, stack().without("hand"))
    rng = np.random.default_rng(0)
    for k in range(6):
        v = 0.1 * rng.standard_normal(robot.nv)
        tick, plain = run.step(robot.state(None, v)), without.step(robot.state(None, v))
        if k < 2:
            assert tick.status is Status.OPTIMAL
            continue
        assert tick.status is Status.INVALID_ELEMENT
        assert [note.element for note in tick.notes] == ["hand"]
        assert np.abs(tick.command - plain.command).max() < 1e-9 * (1.0 + np.abs(plain.command).max())


@FORMULATIONS
@pytest.mark.parametrize("kind", ["crossed", "nan", "infinite", "beyond"])
def test_a_faulty_constraint_costs_no_other_element_its_rows(robot: Robot, formulation: Any, kind: str) -> None:
    run, without = (
        session(robot, formulation, stack(Wall(name="wall", kind=kind))),
        session(robot, formulation, stack()),
    )
    for k in range(3):
        tick, plain = run.step(robot.state()), without.step(robot.state())
        assert tick.status is (Status.INVALID_ELEMENT if k else Status.OPTIMAL)
        if k:
            assert [note.element for note in tick.notes] == ["wall"]
            assert "bounds" in tick.notes[0].detail
        assert np.abs(tick.command - plain.command).max() < 1e-9 * (1.0 + np.abs(plain.command).max())


@dataclasses.dataclass(frozen=True, kw_only=True)
class Unsteady(Position):
    """User task that at times has no hold value or no Jacobian."""

    units: ClassVar[tuple[Any, ...]] = ()
    fault: Any = dataclasses.field(default_factory=lambda: {"": None}, compare=False)

    def hold(self, state: Any) -> Any:
        if self.fault.get("hold") == "raises":
            raise ValueError("no sight of it")
        return None if self.fault.get("hold") == "none" else super().hold(state)

    def jacobian(self, state: Any) -> Any:
        if self.fault.get("J") == "raises":
            raise KeyError("no sight of it")
        return super().jacobian(state) * (np.nan if self.fault.get("J") == "nan" else 1.0)


@FORMULATIONS
@pytest.mark.parametrize("how", ["raises", "none"])
@pytest.mark.parametrize("when", ["first", "change", "eased"])
def test_an_element_without_a_hold_value_is_left_out(robot: Robot, formulation: Any, how: str, when: str) -> None:
    """Try it again in every tick; use it once it has a hold value or a reference."""
    task = Unsteady(frame="l_palm", name="unsteady")
    whole = Stack(*stack().levels[:1], Level(task), *stack().levels[1:], subject_to=stack().subject_to)
    run = session(robot, formulation, whole if when == "first" else stack())
    if when != "first":
        run.step(robot.state())
        run.change(whole, 0.02 if when == "eased" else 0.0)
    task.fault["hold"] = how
    for _ in range(4):
        tick = run.step(robot.state())
        assert tick.status is Status.INVALID_ELEMENT
        assert [note.element for note in tick.notes] == ["unsteady"]
        assert "hold value" in tick.notes[0].detail
        assert np.isfinite(tick.command).all()
    goal = task.at(robot.state().position("l_palm"))
    assert run.step(robot.state(), goal).status is Status.OPTIMAL
    assert run.step(robot.state()).status is Status.INVALID_ELEMENT
    task.fault["hold"] = ""
    assert all(run.step(robot.state()).status is Status.OPTIMAL for _ in range(20))


@pytest.mark.parametrize("how", ["raises", "nan"])
def test_a_change_to_an_element_without_a_jacobian_is_refused(robot: Robot, how: str) -> None:
    task = Unsteady(frame="l_palm", name="unsteady", fault={"J": how})
    run = session(robot)
    before = run.step(robot.state())
    whole = Stack(*stack().levels[:1], Level(task), *stack().levels[1:], subject_to=stack().subject_to)
    for act in (run.change, run.prepare):
        with pytest.raises(DeclarationError, match=r"unsteady.*Jacobian at home"):
            act(whole)
    assert np.array_equal(run.step(robot.state()).command, before.command)


def test_a_stack_is_prepared_where_the_robot_has_moved_on(robot: Robot) -> None:
    rates = RateLimits(torque=1e5)  # the first step makes no native loop
    run, other = session(robot, hqp.Torque(), rates=rates), stack(TorqueLimits()).without("hand")
    run.step(robot.state())
    run.change(other)
    run.step(robot.state())
    robot.state()
    run.prepare(stack(TorqueLimits()))
    run.prepare(other)
    assert run.step(robot.state()).status is Status.OPTIMAL


@dataclasses.dataclass(frozen=True, kw_only=True)
class FaultyContact(FixedContact):
    """User contact that loses its Jacobian."""

    def jacobian(self, state: Any) -> Any:
        return super().jacobian(state) * (np.nan if state.q[0] > 0.05 else 1.0)


@FORMULATIONS
def test_a_faulty_contact_is_named_and_the_command_stays_finite(robot: Robot, formulation: Any) -> None:
    contacts = [FixedContact(frame="l_sole"), FaultyContact(frame="r_sole")]
    declared = Stack(Level(Posture()), subject_to=contacts)
    run = session(robot, formulation, declared)
    assert run.step(robot.state()).status is Status.OPTIMAL
    q = robot.home.copy()
    q[0] = 0.1
    tick = run.step(robot.state(q))
    assert tick.status is Status.INVALID_ELEMENT
    assert tick.notes[0].element == "r_sole"
    assert np.isfinite(tick.command).all()
    assert tick.held == 0
    assert run.step(robot.state()).status is Status.OPTIMAL


@FORMULATIONS
@pytest.mark.parametrize("bad", [np.nan, np.inf])
def test_a_reference_of_nan_leaves_a_stance_foot_where_it_is(robot: Robot, formulation: Any, bad: float) -> None:
    run, plain = session(robot, formulation), session(robot, formulation)
    foot = run.stack.find("r_sole", FixedContact)
    pose = foot.value(robot.state()).copy()
    pose[0, 3] = bad
    rng = np.random.default_rng(0)
    run.step(robot.state())
    plain.step(robot.state())
    v = 0.1 * rng.standard_normal(robot.nv)
    for reference in (foot.at(pose), foot.at(velocity=[bad, 0.0, 0.0, 0.0, 0.0, 0.0])):
        tick = run.step(robot.state(None, v), reference)
        assert tick.status is Status.INVALID_REFERENCE
        assert "hold value" in tick.notes[0].detail
        assert np.allclose(tick.command, plain.step(robot.state(None, v)).command, rtol=1e-9, atol=1e-9)


# dynamics -----------------------------------------------------------------------------------------------------------


def impossible_arm() -> Robot:
    """Two hinges with an impossible inertia: positive definite only near the elbow angle of home."""
    model, carrier = pin.Model(), 0
    for name, inertia in (("shoulder", 0.35), ("elbow", 0.02 - 0.25)):
        place = pin.SE3(np.eye(3), np.array([0.5, 0.0, 0.0]))
        carrier = model.addJoint(carrier, pin.JointModelRZ(), place if carrier else pin.SE3.Identity(), name)
        centre = np.array([0.5 if name == "elbow" else 0.0, 0.0, 0.0])
        model.appendBodyToJoint(carrier, pin.Inertia(1.0, centre, np.eye(3)), pin.SE3.Identity())
        model.inertias[carrier].inertia = np.diag([0.1, 0.1, inertia])
    model.addFrame(pin.Frame("hand", carrier, 0, pin.SE3(np.eye(3), np.array([0.5, 0.0, 0.0])), pin.FrameType.OP_FRAME))
    model.lowerPositionLimit, model.upperPositionLimit = -3.0 * np.ones(2), 3.0 * np.ones(2)
    return Robot(model, name="arm", home=np.array([0.0, np.pi / 2.0]))


@pytest.mark.parametrize("over", [0.0, 1.0], ids=["plain", "in a transition"])
def test_the_native_chain_tells_that_dynamics_fail(over: float) -> None:
    """Report DYNAMICS_FAILED in the one native call: elimination of an indefinite inertia fails."""
    robot = impossible_arm()
    whole = Stack(Level(Position(frame="hand", axes="xy", name="hand")), Level(Posture()))
    run = session(robot, hqp.Torque(effort_limits=False), whole.without("hand") if over else whole)
    for _ in range(5):
        good = run.step(robot.state())
    if over:
        run.change(whole, over)
        for _ in range(5):
            good = run.step(robot.state())
    for held in (1, 2):
        tick = run.step(robot.state(np.array([0.0, 0.1])))
        assert tick.status is Status.DYNAMICS_FAILED
        assert tick.notes[0].element == "robot"
        assert tick.held == held
        assert np.abs(tick.command - good.command).max() < 1.0
    ticks = [run.step(robot.state()) for _ in range(3)]
    assert all(tick.status is Status.OPTIMAL for tick in ticks)
    assert np.abs(ticks[-1].command - good.command).max() < 1.0


def test_a_file_tells_that_dynamics_fail(tmp_path: Path) -> None:
    robot = impossible_arm()
    run = session(
        robot, hqp.Torque(effort_limits=False), Stack(Level(Position(frame="hand", axes="xy")), Level(Posture()))
    )
    run.export(tmp_path / "arm.hqp")
    loaded, rest = hqp.load(tmp_path / "arm.hqp"), np.zeros(2)
    assert loaded.step(robot.home, rest).status is Status.OPTIMAL
    tick = loaded.step(np.array([0.0, 0.1]), rest)
    assert tick.status is Status.DYNAMICS_FAILED
    assert tick.notes[0].element == "robot"
    assert loaded.step(robot.home, rest).status is Status.OPTIMAL


def test_absurd_but_finite_states_never_raise(robot: Robot) -> None:
    run = session(robot, hqp.Torque())
    run.step(robot.state())
    rng = np.random.default_rng(1)
    for size in (1.0, 1e2, 9e2):
        for _ in range(10):
            q = robot.integrate(robot.home, size * rng.standard_normal(robot.nv), 1.0)
            tick = run.step(robot.state(q, size * rng.standard_normal(robot.nv)))
            assert np.isfinite(tick.command).all()


def three_links(fault: str = "") -> Robot:
    """Three revolute joints in series; fault: defect of the middle joint, or bodies without mass."""
    import pinocchio as pin

    model, joint = pin.Model(), 0
    for i in range(3):
        step = np.array([np.nan if fault == "placement" and i == 1 else 0.3, 0.0, 0.0])
        joint = model.addJoint(joint, pin.JointModelRZ(), pin.SE3(np.eye(3), step), f"j{i}")
        mass = {"no mass": 0.0, "last without mass": float(i < 2), "mass": (1.0, np.nan, 1.0)[i]}.get(fault, 1.0)
        mass = -1.0 if fault == "negative" and i == 1 else mass
        if mass != 0.0:
            inertia = pin.Inertia(mass, np.array([0.1, 0.0, 0.0]), 0.01 * np.eye(3))
            model.appendBodyToJoint(joint, inertia, pin.SE3.Identity())
    model.effortLimit[:], model.velocityLimit[:] = 10.0, 2.0
    model.lowerPositionLimit[:], model.upperPositionLimit[:] = -3.0, 3.0
    if fault == "limit":
        model.upperPositionLimit[1] = np.nan
    return Robot(model, name="light")


EVERY_FORMULATION = pytest.mark.parametrize(
    "formulation", [hqp.Velocity(), hqp.Acceleration(), hqp.Torque()], ids=lambda f: type(f).__name__
)


@EVERY_FORMULATION
@pytest.mark.parametrize(
    ("fault", "told"),
    [
        ("limit", "light, joint j1: its upper limit is NaN"),
        ("mass", "light, joint j1: its body has mass nan kg"),
        ("negative", "light, joint j1: its body has mass -1 kg"),
        ("placement", "light, joint j1: its placement at home is not finite"),
    ],
)
def test_a_model_that_is_none_is_found_before_the_loop(formulation: Any, fault: str, told: str) -> None:
    with pytest.raises(ModelError, match=told):
        hqp.Controller(Stack(Level(Posture())), formulation).session(three_links(fault), DT)
    sound = hqp.Controller(Stack(Level(Posture())), formulation).session(three_links(), DT)
    assert sound.step(sound.robot.state()).status is Status.OPTIMAL


@EVERY_FORMULATION
def test_a_chain_without_mass_is_found_before_the_loop(formulation: Any) -> None:
    torque = isinstance(formulation, hqp.Torque)
    told = "positive definite" if torque else "com: its Jacobian is not finite, at home and near it"
    with pytest.raises(ModelError, match=f"light.*{told}"):
        hqp.Controller(Stack(Level(Com(axes="xy"))), formulation).session(three_links("no mass"), DT)
    last, joints = three_links("last without mass"), Stack(Level(Posture()), subject_to=[JointLimits()])
    if torque:
        with pytest.raises(ModelError, match=r"light.*j2.*positive definite"):
            hqp.Controller(joints, formulation).session(last, DT)
        return
    whole = Stack(Level(Com(axes="xy")), *joints.levels, subject_to=joints.subject_to)
    for stack in (joints, whole):  # no row needs the inertia, and the robot has a CoM
        tick = hqp.Controller(stack, formulation).session(last, DT).step(last.state())
        assert tick.status is Status.OPTIMAL
        assert np.isfinite(tick.command).all()
    for task, name, robot in (
        (Com(axes="xy", subtree="j2"), "com", last),  # the link has no mass
        (Momentum(), "momentum", three_links("no mass")),
    ):
        with pytest.raises(ModelError, match=f"light.*{name}: its Jacobian is not finite"):
            hqp.Controller(Stack(Level(task)), formulation).session(robot, DT)


class SingularAtHome(Posture):
    """User posture without rows at home."""

    def jacobian(self, state: Any) -> Any:
        """NaN at home."""
        return super().jacobian(state) * (np.nan if np.array_equal(state.q, state.robot.home) else 1.0)


def test_an_element_of_the_users_is_left_to_the_loop() -> None:
    robot = three_links()
    run = hqp.Controller(Stack(Level(SingularAtHome()))).session(robot, DT)
    assert run.step(robot.state()).status is Status.INVALID_ELEMENT
    assert run.step(robot.state(robot.home + 0.1)).status is Status.OPTIMAL


def test_a_session_leaves_the_states_of_its_robot_as_they_are(robot: Robot) -> None:
    state = robot.state()
    run = hqp.Controller(Stack(Level(Posture()))).session(robot, DT)
    assert run.step(state).status is Status.OPTIMAL  # no StaleState: trials use a copy


# the program's own errors, threads, pickles -------------------------------------------------------------------------


def test_what_is_no_reference_is_refused_by_name(robot: Robot) -> None:
    run = session(robot)
    with pytest.raises(DeclarationError, match="not a Reference"):
        run.step(robot.state(), [0.0, 0.0, 0.0])  # type: ignore[arg-type]
    with pytest.raises(UnknownReference):
        run.step(robot.state(), Com().at([0.0, 0.0, 0.0]))
    torque = session(robot, hqp.Torque(), Stack(Level(JointTorque()), subject_to=feet()))
    torque.step(robot.state())
    with pytest.raises(DeclarationError, match="shape"):
        torque.step(robot.state(), torque.stack.find("joint_torque", JointTorque).at(np.zeros(3)))
    assert run.step(robot.state()).status is Status.OPTIMAL
    assert torque.step(robot.state()).status is Status.OPTIMAL


def test_numpy_that_raises_changes_nothing(robot: Robot) -> None:
    for formulation in (hqp.Velocity(), hqp.Acceleration(), hqp.Torque()):
        run, plain = session(robot, formulation), session(robot, formulation)
        hand = run.stack.find("hand", Position)
        for goal in ([0.3, -0.2, 1.0], [np.nan, 0.0, 0.0]):
            expected = plain.step(robot.state(), hand.at(goal))
            with np.errstate(all="raise"):
                tick = run.step(robot.state(), hand.at(goal))
            assert tick.status is expected.status
            assert np.array_equal(tick.command, expected.command)


def test_the_second_thread_is_refused(robot: Robot) -> None:
    inside, go = threading.Event(), threading.Event()

    @dataclasses.dataclass(frozen=True, kw_only=True)
    class Slow(Position):
        def jacobian(self, state: Any) -> Any:
            inside.set()
            go.wait(60.0)
            return super().jacobian(state)

    run = session(robot, declared=stack(hand=Slow(frame="r_palm", name="hand")))
    go.set()
    before = run.step(robot.state())
    inside.clear()
    go.clear()
    state, found = robot.state(), []
    worker = threading.Thread(target=lambda: found.append(run.step(state)))
    worker.start()
    assert inside.wait(60.0)
    with pytest.raises(ConcurrentUse, match="thread"):
        run.step(state)
    with pytest.raises(ConcurrentUse, match="thread"):
        run.change(run.stack)
    with pytest.raises(ConcurrentUse, match="thread"):
        before.account()
    go.set()
    worker.join()
    assert found[0].status is Status.OPTIMAL
    found[0].account()
    assert run.step(robot.state()).status is Status.OPTIMAL


def test_threads_that_fight_for_a_session_get_right_answers_or_none(robot: Robot) -> None:
    """Steps, changes and queries from four threads at once: each is refused or correct."""
    run = session(robot, declared=stack())
    hand = run.stack.find("hand", Position)
    goal = robot.state().position("r_palm") + [0.0, 0.0, 0.02]
    alone = session(robot, declared=stack())
    expected = [alone.step(robot.state(), hand.at(goal)).command for _ in range(5)][-1]
    state = robot.state()  # shared: states of a robot share its kinematics
    wrong: list[object] = []
    counts = {"taken": 0, "refused": 0}
    interval = sys.getswitchinterval()

    def fight(turn: int) -> None:
        for k in range(150):
            try:
                if k % 10 == 9 and turn == 3:
                    run.change(run.stack)
                    continue
                tick = run.step(state, hand.at(goal))
                if not np.allclose(tick.command, expected, atol=1e-6):
                    wrong.append(tick.command - expected)
                if k % 3 == turn % 3:
                    str(tick.account())
                counts["taken"] += 1
            except ConcurrentUse:
                counts["refused"] += 1
            except HqpError as error:
                if "latest step" not in str(error):
                    wrong.append(error)
            except Exception as error:
                wrong.append(error)

    sys.setswitchinterval(1e-6)
    try:
        workers = [threading.Thread(target=fight, args=(turn,)) for turn in range(4)]
        for worker in workers:
            worker.start()
        for worker in workers:
            worker.join(60.0)
    finally:
        sys.setswitchinterval(interval)
    assert not wrong, wrong[:3]
    assert min(counts.values()) > 0, counts
    assert run.step(robot.state(), hand.at(goal)).status is Status.OPTIMAL


def test_ticks_pickle_and_sessions_say_what_to_pickle(robot: Robot) -> None:
    run = session(robot)
    tick = run.step(robot.state())
    copy = pickle.loads(pickle.dumps(tick))
    assert copy.status is tick.status
    assert np.array_equal(copy.command, tick.command)
    assert np.array_equal(copy.state.q, tick.state.q)
    assert copy.jump == tick.jump
    assert copy.solution is not None
    with pytest.raises(HqpError, match="pickled"):
        copy.explain()
    with pytest.raises(TypeError, match="controller"):
        pickle.dumps(run)
    assert pickle.loads(pickle.dumps(run.controller)) == run.controller


def test_every_status_that_is_usable_becomes_the_safe_command(robot: Robot) -> None:
    for status in Status:

        def said(problem: Any, found: Any, status: Any = status) -> Any:
            return dataclasses.replace(found, status=status, x=np.full(57, 0.01))

        run = session(robot, solver=Altered(answers=Answers(said)))
        tick = run.step(robot.state())
        assert (tick.held == 0) is status.usable
        bad = run.step(robot.state(np.full(robot.nq, np.nan)))
        assert bad.held == (1 if status.usable else 2)
