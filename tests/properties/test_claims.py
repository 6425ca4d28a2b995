"""Promises of docs/safety.md on robots other than the one of the page: a humanoid, arms, a child-sized robot."""

from __future__ import annotations

import dataclasses
from typing import Any

import numpy as np
import pytest

import hqp
from hqp import Level, Stack, Status
from hqp.declare.element import Inequality
from hqp.declare.safety import RateLimits
from hqp.robots import Robot
from hqp.tasks import Com, FixedContact, JointLimits, Position, Posture, TorqueLimits

DT = 0.002
BAD = 3
"""First evaluation with a fault."""

ROBOTS = ["g1", "ur5", *(pytest.param(name, marks=pytest.mark.slow) for name in ("icub", "romeo", "panda", "cbi"))]
FORMULATIONS = pytest.mark.parametrize(
    "formulation", [hqp.Velocity(), hqp.Acceleration(), hqp.Torque()], ids=lambda f: type(f).__name__
)


@dataclasses.dataclass(frozen=True, kw_only=True)
class FaultyTask(Position):
    """User task with a given fault."""

    kind: str = ""

    def jacobian(self, state: Any) -> Any:
        J = super().jacobian(state).copy()
        object.__setattr__(self, "_count", getattr(self, "_count", 0) + 1)
        if self._count < BAD:  # type: ignore[attr-defined]
            return J
        if self.kind == "raises":
            raise RuntimeError("the camera is gone")
        return {"nan": J * np.nan, "huge": J * 1e200, "shape": J[:1], "none": None}[self.kind]


@dataclasses.dataclass(frozen=True, kw_only=True)
class FaultyWall(Inequality):
    """User inequality with faulty bounds."""

    frame: str = ""
    kind: str = ""

    def rows(self, robot: Any) -> int:
        return 1

    def jacobian(self, state: Any) -> Any:
        return state.jacobian(self.frame)[:1]

    def drift(self, state: Any) -> Any:
        return state.drift(self.frame)[:1]

    def bounds(self, state: Any) -> Any:
        object.__setattr__(self, "_count", getattr(self, "_count", 0) + 1)
        good = self._count < BAD  # type: ignore[attr-defined]
        return (-5.0, 5.0) if good else {"crossed": (1.0, -1.0), "nan": (-1.0, np.nan)}[self.kind]


def hand_of(robot: Robot) -> str:
    return robot.landmarks["palms"][0] if "palms" in robot.landmarks else robot.frame_names[-1]


def declared(robot: Robot, formulation: Any, *, above: Any = (), under: Any = ()) -> Stack:
    soles = robot.landmarks.get("soles", ())
    limits = [TorqueLimits()] if isinstance(formulation, hqp.Torque) else [JointLimits()]
    levels = [Level(Com(name="com"))] if soles else []
    levels += [Level(task) for task in above]
    feet = [FixedContact(frame=sole) for sole in soles]
    return Stack(*levels, Level(Posture()), subject_to=[*feet, *limits, *under])


def session(robot: Robot, formulation: Any, stack: Stack, **fields: Any) -> hqp.Session:
    return hqp.Controller(stack, formulation, deadline=np.inf, **fields).session(robot, DT)


@pytest.mark.parametrize("name", ROBOTS)
@FORMULATIONS
def test_an_element_that_fails_costs_no_other_its_rows(name: str, formulation: Any) -> None:
    robot = hqp.robots.load(name)
    faulty: list[tuple[str, Any, Any]] = [
        ("hand", [FaultyTask(frame=hand_of(robot), name="hand", kind=kind)], ())
        for kind in ("raises", "nan", "huge", "shape", "none")
    ]
    faulty += [("wall", (), [FaultyWall(name="wall", frame=hand_of(robot), kind=k)]) for k in ("crossed", "nan")]
    for element, above, under in faulty:
        run = session(robot, formulation, declared(robot, formulation, above=above, under=under))
        without = session(robot, formulation, declared(robot, formulation))
        for _ in range(BAD + 3):
            tick, plain = run.step(robot.state()), without.step(robot.state())
        assert tick.status is Status.INVALID_ELEMENT
        assert [n.element for n in tick.notes if n.status is Status.INVALID_ELEMENT] == [element]
        assert np.abs(tick.command - plain.command).max() < 1e-6 * (1.0 + np.abs(plain.command).max())


@pytest.mark.parametrize("name", ROBOTS)
@FORMULATIONS
def test_states_that_are_none_are_named_and_brought_to_rest(name: str, formulation: Any) -> None:
    robot = hqp.robots.load(name)
    run = session(robot, formulation, declared(robot, formulation))
    run.step(robot.state())
    for what, number in (("q", np.nan), ("q", np.inf), ("v", np.nan), ("v", 1e30)):
        q, v = robot.home.copy(), np.zeros(robot.nv)
        (q if what == "q" else v)[-1] = number
        tick = run.step(robot.state(q, v))
        assert tick.status is Status.INVALID_STATE
        assert robot.joint_name(robot.nv - 1) in tick.notes[0].detail
    for _ in range(600):
        tick = run.step(robot.state(np.full(robot.nq, np.nan)))
    assert tick.held > 600
    if isinstance(formulation, hqp.Torque):
        assert np.all(np.abs(tick.command) <= robot.effort_limit[robot.actuated] + 1e-9)
    else:
        assert np.abs(tick.command).max() < 1e-9


@pytest.mark.parametrize("name", ROBOTS)
@FORMULATIONS
def test_feet_keep_their_hold_value_and_absurd_states_raise_nothing(name: str, formulation: Any) -> None:
    robot = hqp.robots.load(name)
    stack = declared(robot, formulation)
    run, plain = session(robot, formulation, stack), session(robot, formulation, stack)
    run.step(robot.state())
    plain.step(robot.state())
    if soles := robot.landmarks.get("soles", ()):
        foot = stack.find(soles[0], FixedContact)
        pose = foot.value(robot.state()).copy()
        pose[0, 3] = np.nan
        tick, expected = run.step(robot.state(), foot.at(pose)), plain.step(robot.state())
        assert tick.status is Status.INVALID_REFERENCE
        assert np.abs(tick.command - expected.command).max() < 1e-6 * (1.0 + np.abs(expected.command).max())
    rng = np.random.default_rng(0)
    for size in (1.0, 100.0, 900.0):
        for _ in range(3):
            q = robot.integrate(robot.home, size * rng.standard_normal(robot.nv), 1.0)
            assert np.isfinite(run.step(robot.state(q, size * rng.standard_normal(robot.nv))).command).all()


@pytest.mark.parametrize("name", ROBOTS)
@FORMULATIONS
def test_rates_hold_in_every_tick(name: str, formulation: Any) -> None:
    robot = hqp.robots.load(name)
    limits = RateLimits(velocity=2.0, acceleration=100.0, torque=500.0)
    run = session(robot, formulation, declared(robot, formulation), rates=limits)
    rate = DT * float(getattr(limits, run.program.kind))
    last = run.step(robot.state()).command
    rng = np.random.default_rng(1)
    for k in range(25):
        q = robot.integrate(robot.home, 0.05 * rng.standard_normal(robot.nv), 1.0)
        q = np.full(robot.nq, np.nan) if k % 7 == 3 else q
        tick = run.step(robot.state(q))
        assert np.abs(tick.command - last).max() <= rate * (1.0 + 1e-9)
        last = tick.command
