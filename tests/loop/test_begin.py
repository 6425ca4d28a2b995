"""A session with the robot's present command continues from it; without it, no robot drops."""

from __future__ import annotations

from collections.abc import Callable
from typing import Any

import numpy as np
import pinocchio as pin
import pytest

import hqp
import hqp.tasks as t
from hqp import PD, Level, RateLimits, Stack, Status
from hqp.arrays import Vec
from hqp.errors import DeclarationError
from hqp.export.loaded import LoadedSession
from hqp.loop.file import text
from hqp.solvers.lexicographic import kernel

pytestmark = pytest.mark.skipif(not kernel(), reason="no native kernel here")

DT = 0.002
RATES = RateLimits(velocity=3.0, acceleration=200.0, torque=200.0)
RATE = {"velocity": 3.0, "acceleration": 200.0, "torque": 200.0}
FORMULATIONS: dict[str, Callable[[], Any]] = {
    "velocity": hqp.Velocity,
    "acceleration": hqp.Acceleration,
    "torque": lambda: hqp.Torque(contact_law=PD(0.0, 40.0)),
}


def tool(robot: Any) -> str:
    """The frame of a hand or a tool."""
    marks = robot.landmarks
    return str((marks.get("palms") or marks.get("tools") or robot.frame_names[-1:])[-1])


def session(name: str, kind: str, rates: RateLimits | None = RATES, **more: Any) -> hqp.Session:
    """Session with a hand, a posture and the feet of a robot."""
    robot = hqp.robots.load(name)
    frame = tool(robot)
    feet = [t.FixedContact(frame=sole) for sole in robot.landmarks.get("soles", ())]
    levels = [Level(t.Position(frame=frame, name="hand")), *([Level(t.Com(axes="xy"))] if feet else [])]
    limits = [t.JointLimits()] if kind == "velocity" else []
    stack = Stack(*levels, Level(t.Posture()), subject_to=[*feet, *robot.couplings, *limits])
    return hqp.Controller(stack, FORMULATIONS[kind](), rates=rates, deadline=np.inf, **more).session(robot, DT)


def standing(name: str) -> Vec:
    """A posture with bent joints, so that gravity loads all of them; home for a robot with feet or fingers."""
    robot = hqp.robots.load(name)
    if robot.floating or robot.couplings:
        return robot.home.copy()
    q: Vec = robot.integrate(robot.home, 0.3 * np.cos(np.arange(robot.nv)), 1.0)
    return q


def holding(robot: Any, q: Vec) -> Vec:
    """Gravity torque of the motors of a fixed base, by Pinocchio."""
    gravity: Vec = pin.computeGeneralizedGravity(robot.model, robot.model.createData(), q)
    held: Vec = gravity[robot.actuated]
    return held


class Physics:
    """Pinocchio's forward dynamics under torques, with the soles of a robot held on the ground."""

    def __init__(self, robot: Any, q: Vec) -> None:
        self.model, self.q, self.v = robot.model, q.copy(), np.zeros(robot.nv)
        self.data, self.motors = self.model.createData(), robot.actuated
        self.soles = [self.model.getFrameId(sole) for sole in robot.landmarks.get("soles", ())]

    def step(self, torques: Vec) -> None:
        tau = np.zeros(self.model.nv)
        tau[self.motors] = torques
        for _ in range(2):
            self.v = self.v + 0.5 * DT * self._acceleration(tau)
            self.q = pin.integrate(self.model, self.q, 0.5 * DT * self.v)

    def _acceleration(self, tau: Vec) -> Vec:
        model, data, q, v = self.model, self.data, self.q, self.v
        if not self.soles:
            return np.array(pin.aba(model, data, q, v, tau))
        pin.forwardKinematics(model, data, q, v, np.zeros(model.nv))
        pin.computeJointJacobians(model, data, q)
        pin.updateFramePlacements(model, data)
        local = pin.ReferenceFrame.LOCAL
        J = np.vstack([pin.getFrameJacobian(model, data, k, local) for k in self.soles])
        drift = np.concatenate([pin.getFrameAcceleration(model, data, k, local).vector for k in self.soles])
        return np.array(pin.forwardDynamics(model, data, q, v, tau, J, drift + 50.0 * (J @ v), 1e-9))


def first_torques(name: str, q: Vec) -> Vec:
    """The torques of a session without rates."""
    run = session(name, "torque", None)
    return run.step(run.robot.state(q)).command


def fallen(run: hqp.Session, q: Vec, ticks: int) -> float:
    """Largest displacement of the hand [m]."""
    physics, robot = Physics(run.robot, q), run.robot
    frame, far = run.stack.find("hand").frame, 0.0  # type: ignore[attr-defined]
    start = robot.state(q).position(frame).copy()
    for _ in range(ticks):
        state = robot.state(physics.q, physics.v)
        far = max(far, float(np.linalg.norm(state.position(frame) - start)))
        tick = run.step(state)
        assert tick.status is Status.OPTIMAL, tick.notes
        physics.step(tick.command)
    return far


@pytest.mark.parametrize("begun", [False, True])
@pytest.mark.parametrize("rate", [500.0, 200.0])
@pytest.mark.parametrize("name", ["ur5", "panda", "kinova", "cbi"])
def test_a_held_robot_does_not_fall_at_power_up(name: str, rate: float, begun: bool) -> None:
    run, q = session(name, "torque", RateLimits(torque=rate)), standing(name)
    robot = run.robot
    if begun:
        sent = holding(robot, q) if not robot.floating else first_torques(name, q)
        run.begin(command=sent, state=robot.state(q))
    assert fallen(run, q, 100) < 1e-3


def test_the_judge_sees_a_fall() -> None:
    run = session("ur5", "torque", RateLimits(torque=500.0))
    run.begin(command=np.zeros(6))
    assert fallen(run, standing("ur5"), 100) > 0.05


def told(tick: hqp.Tick) -> list[str]:
    return [note.detail for note in tick.notes if note.element == "session"]


def test_a_torque_session_that_knows_of_no_command_says_so_once() -> None:
    for rates, begun, says in ((RATES, False, 1), (RATES, True, 0), (None, False, 0)):
        run = session("ur5", "torque", rates)
        q = standing("ur5")
        if begun:
            run.begin(command=holding(run.robot, q))
        state = run.robot.state(q)
        first, second = run.step(state), run.step(run.robot.state(q))
        assert len(told(first)) == says
        assert all("begin(command=" in text for text in told(first))
        assert not told(second)
    run = session("ur5", "velocity")
    assert told(run.step(run.robot.state())) == []


@pytest.mark.parametrize("kind", FORMULATIONS)
@pytest.mark.parametrize("name", ["ur5", "cbi"])
def test_rates_start_from_what_is_sent_now(name: str, kind: str) -> None:
    rng = np.random.default_rng(0)
    for seed in range(3):
        run = session(name, kind)
        robot, q = run.robot, standing(name)
        sent = rng.uniform(-0.5, 0.5, robot.actuated.size) * (1.0 if kind == "velocity" else 20.0)
        if seed:
            run.begin(command=sent, state=robot.state(q))
        else:
            run.begin(command=sent)
        last = sent
        for k in range(4):
            bad = k == 1 + seed % 2
            tick = run.step(robot.state(np.full(robot.nq, np.nan) if bad else q))
            assert np.abs(tick.command - last).max() <= RATE[kind] * DT * (1.0 + 1e-9)
            if k == 0:
                np.testing.assert_allclose(run.program.command(tick.before), sent, atol=1e-12)
            last = tick.command


def test_the_window_of_acceleration_stands_around_what_is_sent_now() -> None:
    for name in ("ur5", "cbi"):
        run = session(name, "velocity", None)
        robot, q = run.robot, standing(name)
        v = np.zeros(robot.nv)
        if not robot.floating:
            v[robot.actuated] = 0.2  # a base with standing feet does not move
        run.begin(command=v[robot.actuated], state=robot.state(q, v))
        tick = run.step(robot.state(q))  # an encoder without speeds
        most = next(e.acceleration or 0.0 for e in run.stack if isinstance(e, t.JointLimits)) * DT
        assert np.abs(tick.command - v[robot.actuated]).max() <= most * (1.0 + 1e-6), name


@pytest.mark.parametrize("known", [False, True])
def test_braking_starts_from_what_is_sent_now(known: bool) -> None:
    deceleration = 5.0
    run = session("ur5", "velocity", None, braking=hqp.Braking(deceleration=deceleration))
    robot, q, sent = run.robot, standing("ur5"), 0.2 * np.cos(np.arange(6.0))
    run.begin(command=sent, state=robot.state(q) if known else None)
    last = sent
    for k in range(30):
        tick = run.step(robot.state(np.full(robot.nq, np.nan)))
        assert tick.status is Status.INVALID_STATE
        assert not any("no valid state so far" in note.detail for note in tick.notes)
        factor = max(0.0, 1.0 - deceleration * DT / np.abs(last).max()) if np.abs(last).max() else 0.0
        np.testing.assert_allclose(tick.command, last * factor, atol=1e-12, err_msg=str(k))
        last = tick.command
    assert np.abs(last).max() == 0.0
    run = session("ur5", "torque", None)
    run.begin(command=(torque := holding(run.robot, q) + 3.0))
    np.testing.assert_array_equal(run.step(robot_nan(run)).command, torque)


def robot_nan(run: hqp.Session) -> Any:
    return run.robot.state(np.full(run.robot.nq, np.nan))


@pytest.mark.parametrize("kind", FORMULATIONS)
@pytest.mark.parametrize("begun", [False, True])
def test_files_and_batches_begin_with_the_same_bits(kind: str, begun: bool) -> None:
    run = session("ur5", kind)
    robot, q = run.robot, standing("ur5")
    file = LoadedSession(text(run))
    batch = hqp.Batch(run.controller, robot, 3, DT, threads=2)
    hand = robot.state(q).position(tool(robot)) + 0.2
    sent = 0.1 * np.cos(np.arange(6.0))
    if begun:
        run.begin(command=sent, state=robot.state(q))
        file.begin(sent, q)
        batch.begin(np.tile(sent, (3, 1)), np.tile(q, (3, 1)))
    for _ in range(5):
        tick = run.step(robot.state(q), t.Position(frame=tool(robot), name="hand").at(hand))
        found = file.step(q, None, {"hand": hand})
        many = batch.step(np.tile(q, (3, 1)), None, {"hand": np.tile(hand, (3, 1))})
        np.testing.assert_array_equal(found.x, tick.x)
        assert [note.detail for note in found.notes] == [
            note.detail for note in tick.notes if not note.detail.startswith("requested ")
        ]
        np.testing.assert_array_equal(many.x, np.tile(tick.x, (3, 1)))


def test_a_change_of_stack_before_the_first_tick_starts_from_there_too() -> None:
    q = standing("ur5")
    for begun in (False, True):
        run = session("ur5", "torque", None)
        held = holding(run.robot, q)
        if begun:
            run.begin(command=held, state=run.robot.state(q))
        run.change(Stack(Level(t.Posture())), over=0.1)
        tick = run.step(run.robot.state(q))
        assert np.abs(tick.command - held).max() < 1.0 + 1e-9  # GRADUAL: 1 N m in a tick of 2 ms
        run.begin(command=held - 30.0)
        tick = run.step(run.robot.state(q))
        assert np.abs(tick.command - (held - 30.0)).max() < 1.0 + 1e-9


def test_what_is_no_command_is_refused() -> None:
    run = session("ur5", "torque")
    other = hqp.robots.load("panda")
    for command in (np.zeros(5), np.full(6, np.nan), "abc", None, np.zeros((1, 6))):
        with pytest.raises(DeclarationError, match=r"begin"):
            run.begin(command=command)  # type: ignore[arg-type]
    with pytest.raises(DeclarationError, match=r"begin"):
        run.begin(command=np.zeros(6), state=robot_nan(run))
    with pytest.raises(hqp.errors.ModelError):
        run.begin(command=np.zeros(6), state=other.state())
    file, batch = LoadedSession(text(run)), hqp.Batch(run.controller, run.robot, 2, DT)
    wrong: tuple[tuple[Vec, ...], ...] = ((np.zeros(5),), (np.zeros(6), np.zeros(5)), (np.full(6, np.nan),))
    for given in wrong:
        with pytest.raises(DeclarationError, match=r"begin"):
            file.begin(*given)
        with pytest.raises(DeclarationError, match=r"begin"):
            batch.begin(*(np.tile(each, (2, 1)) for each in given))
    with pytest.raises(DeclarationError, match=r"begin"):
        batch.begin(np.zeros((3, 6)))
