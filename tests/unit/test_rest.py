"""Fallback commands against their equations, from the newest valid state."""

from __future__ import annotations

from dataclasses import dataclass, field, replace
from typing import Any, ClassVar

import numpy as np
import pytest

import hqp
import hqp.solvers
from hqp import Level, Stack, Status
from hqp.arrays import Vec
from hqp.declare.safety import Braking
from hqp.problem import Hierarchy, Shape, Solution
from hqp.robots import Robot
from hqp.solvers import Solver
from hqp.solvers.base import finish
from hqp.tasks import JointLimits, Posture

DT, DECELERATION, DAMPING = 0.002, 40.0, 0.3


@dataclass(frozen=True)
class Refusing(Solver):
    """The kernel; while ``switch["off"]`` is set, spoil its solutions so that they are refused."""

    name: ClassVar[str] = "refusing"
    priced: ClassVar[bool] = True
    switch: dict[str, bool] = field(default_factory=dict, compare=False)

    def workspace(self, shape: Shape) -> Any:
        inner, outer = hqp.solvers.load("lexicographic").workspace(shape), self

        class Spoiled:
            def reset(self) -> None:
                inner.reset()

            def solve(self, problem: Hierarchy) -> Solution:
                found = inner.solve(problem)
                return outer.spoiled(problem, found) if outer.switch.get("off") else found

        return Spoiled()

    def spoiled(self, problem: Hierarchy, found: Solution) -> Solution:
        return replace(found, status=Status.NOT_CERTIFIED, detail="refused")


class Arm:
    """UR5 session on a posture with refusable solutions."""

    def __init__(self, formulation: Any, **posture: Any) -> None:
        self.robot: Robot = hqp.robots.load("ur5")
        self.switch: dict[str, bool] = {}
        self.posture = Posture(**posture)
        stack = Stack(Level(self.posture))
        braking = Braking(deceleration=DECELERATION, damping=DAMPING)
        solver = Refusing(self.switch)
        self.run = hqp.Controller(stack, formulation, solver, deadline=np.inf, braking=braking).session(self.robot, DT)
        self.rng = np.random.default_rng(0)

    def state(self, speed: float = 0.3) -> tuple[Vec, Vec]:
        return self.robot.home + self.rng.uniform(-0.3, 0.3, 6), self.rng.uniform(-speed, speed, 6)

    def refused(self, q: Vec, v: Vec) -> hqp.Tick:
        self.switch["off"] = True
        tick = self.run.step(self.robot.state(q, v))
        self.switch["off"] = False
        assert tick.status is Status.NOT_CERTIFIED
        return tick

    def lost(self) -> hqp.Tick:
        tick = self.run.step(self.robot.state(np.full(6, np.nan)))
        assert tick.status is Status.INVALID_STATE
        return tick


@dataclass(frozen=True)
class Beyond(Refusing):
    """Spoil solutions to exceed a bound on x by ``off``."""

    off: float = 0.0

    def spoiled(self, problem: Hierarchy, found: Solution) -> Solution:
        x = found.x.copy()
        x[2] = problem.levels[0].upper[2] + self.off
        return finish(problem, x, Status.OPTIMAL, found.stats)


@pytest.mark.parametrize(("off", "status"), [(1e-7, Status.CONSTRAINTS_VIOLATED), (1.0, Status.NOT_CERTIFIED)])
def test_an_answer_beyond_bounds_that_always_hold_is_none(off: float, status: Status) -> None:
    robot, switch = hqp.robots.load("ur5"), dict[str, bool]()
    stack = Stack(Level(Posture()), subject_to=[JointLimits()])
    run = hqp.Controller(stack, hqp.Velocity(), Beyond(switch, off), deadline=np.inf).session(robot, DT)
    assert run.step(robot.state()).status is Status.OPTIMAL
    switch["off"] = True
    tick = run.step(robot.state())
    assert tick.status is status
    assert tick.held == (status is Status.NOT_CERTIFIED)
    assert "joint_limits" in [note.element for note in tick.notes]


def damped(robot: Robot, q: Vec, v: Vec, fade: float) -> Vec:
    """g - M qd / T within the effort limits: an arm without contacts."""
    state = robot.state(q, v)
    tau = state.gravity_force() - fade * state.mass_matrix() @ v / DAMPING
    return np.clip(tau, -robot.effort_limit, robot.effort_limit)


@pytest.mark.parametrize("speed", [0.3, 300.0], ids=["slow", "at the effort limits"])
def test_torque_holds_the_newest_state_and_damps_within_the_limits(speed: float) -> None:
    arm = Arm(hqp.Torque())
    good, limit = arm.state(speed), arm.robot.effort_limit
    arm.run.step(arm.robot.state(*good))
    clipped = 0
    for k in range(5):  # the last valid state, with a fading velocity
        sent = arm.lost().command
        np.testing.assert_allclose(sent, damped(arm.robot, *good, (1.0 - DT / DAMPING) ** k), rtol=1e-9, atol=1e-9)
        clipped += int(np.sum(np.abs(sent) == limit))
    assert (clipped > 0) == (speed > 1.0)
    for _ in range(3):  # solutions are refused, states are valid: each tick starts anew
        q, v = arm.state(speed)
        np.testing.assert_allclose(arm.refused(q, v).command, damped(arm.robot, q, v, 1.0), rtol=1e-9, atol=1e-9)
    sent = arm.lost().command
    np.testing.assert_allclose(sent, damped(arm.robot, q, v, 1.0 - DT / DAMPING), rtol=1e-9, atol=1e-9)


def test_acceleration_brakes_the_newest_velocity() -> None:
    arm = Arm(hqp.Acceleration())

    def braked(v: Vec) -> Vec:
        return -v * min(1.0 / DT, DECELERATION / np.abs(v).max())

    q, v = arm.state()
    good = arm.run.step(arm.robot.state(q, v), arm.posture.at(q + arm.rng.uniform(-0.2, 0.2, 6)))
    v = v + DT * good.command  # the velocity after the last valid command
    for _ in range(3):
        sent = arm.lost().command
        np.testing.assert_allclose(sent, braked(v), atol=1e-9)
        v = v + DT * sent
    for _ in range(3):
        q, v = arm.state()
        sent = arm.refused(q, v).command
        np.testing.assert_allclose(sent, braked(v), atol=1e-9)
    np.testing.assert_allclose(arm.lost().command, braked(v + DT * sent), atol=1e-9)


@pytest.mark.parametrize("newest", ["a state", "none"])
def test_velocity_stops_at_a_limit_seen_from_the_newest_state(newest: str) -> None:
    arm = Arm(hqp.Velocity(), joints="wrist_1_joint")
    q, rate = arm.robot.home.copy(), 2.0
    upper = float(arm.robot.upper[3])
    q[3] = upper - 0.02
    tick = arm.run.step(arm.robot.state(q), arm.posture.at(velocity=[rate]))
    assert tick.command[3] > 1.0
    if newest == "none":
        place, sent = q[3] + DT * tick.command[3], arm.lost().command[3]  # the last good command has been sent
    else:
        place = q[3] = upper - 1e-3
        sent = arm.refused(q, np.zeros(6)).command[3]
    slower = tick.command[3] - DT * DECELERATION
    assert sent == pytest.approx(min(slower, (upper - place) / DT), abs=1e-9)
    way = [place + DT * sent]
    for _ in range(200):
        way.append(way[-1] + DT * arm.lost().command[3])
    assert max(way) == pytest.approx(upper, abs=1e-9)  # exactly to the limit: the joint cannot stop before it
