"""JointLimits(jerk=) at velocity level: judged by third differences of joint positions in closed loops."""

from __future__ import annotations

from dataclasses import dataclass, field
from functools import partial
from typing import Any

import numpy as np
import pytest

import hqp
import hqp.tasks as t
from hqp import Braking, Level, P, Stack, Status
from hqp.arrays import Mat, Vec
from hqp.errors import DeclarationError
from hqp.export.loaded import LoadedSession
from hqp.loop.file import text
from hqp.solvers.lexicographic import kernel
from tests.scenes import soak

pytestmark = pytest.mark.skipif(not kernel(), reason="no native kernel here")

DT = 0.002
TOOLS = {"ur5": "tool0", "panda": "panda_hand_tcp", "g1": "right_rubber_hand"}
GAIN = 5.0


@dataclass
class Loop:
    """A hand that is sent from goal to goal, integrated exactly; keeps what was sent."""

    name: str
    jerk: float | None
    gain: float = GAIN
    limits: dict[str, Any] = field(default_factory=dict)
    more: tuple[t.FrameVelocityLimits, ...] = ()
    braking: Braking = field(default_factory=Braking)

    def __post_init__(self) -> None:
        robot = self.robot = hqp.robots.load(self.name)
        self.hand = t.Position(frame=TOOLS[self.name], name="hand", law=P(self.gain))
        feet = [t.FixedContact(frame=sole) for sole in robot.landmarks.get("soles", ())]
        balance = [Level(t.Com(name="com", law=P(self.gain)))] if feet else []
        self.limit = t.JointLimits(jerk=self.jerk, **self.limits)
        stack = Stack(
            *balance, Level(self.hand), Level(t.Posture()), subject_to=[*feet, *robot.couplings, self.limit, *self.more]
        )
        controller = hqp.Controller(stack, hqp.Velocity(), deadline=np.inf, braking=self.braking)
        self.session = controller.session(robot, DT, stuck=False)
        self.q, self.v = robot.home.copy(), np.zeros(robot.nv)
        self.commands: list[Vec] = []
        self.ticks: list[hqp.Tick] = []
        self.errors: list[float] = []
        self.outside = 0.0

    def go(self, ticks: int, goal: Vec) -> Loop:
        """Send the hand to a goal (3,)."""
        for _ in range(ticks):
            state = self.robot.state(self.q, self.v)
            tick = self.session.step(state, self.hand.at(goal))
            self.ticks.append(tick)
            self.commands.append(tick.command)
            self.errors.append(float(np.linalg.norm(state.position(self.hand.frame) - goal)))
            off = np.maximum(state.angles - self.robot.upper, self.robot.lower - state.angles)
            self.outside = max(self.outside, float(off[self.robot.actuated].max()))
            self.q, self.v = tick.advance()
        return self

    @property
    def start(self) -> Vec:
        return self.robot.state(self.robot.home).position(self.hand.frame)

    @property
    def sent(self) -> Mat:
        return np.array(self.commands)

    @property
    def largest_jerk(self) -> float:
        """[rad/s^3]"""
        rest = np.zeros((2, self.sent.shape[1]))
        return float(np.abs(np.diff(np.vstack((rest, self.sent)), 2, axis=0)).max() / DT**2)

    @property
    def acceleration(self) -> float:
        """[rad/s^2]"""
        return float(np.abs(np.diff(self.sent, axis=0)).max() / DT)

    @property
    def speed(self) -> float:
        """Share of the speed limits."""
        return float(np.abs(self.sent / self.robot.velocity_limit[self.robot.actuated]).max())

    def reversals(self, still: float = 0.02, begin: int = 0) -> int:
        """Most reversals of a joint from a tick on, without speeds below ``still``."""
        moving = [one[np.abs(one) > still] for one in self.sent[begin:].T]
        return max(int((np.diff(np.sign(one)) != 0.0).sum()) for one in moving)

    @property
    def notes(self) -> list[str]:
        return [str(note) for tick in self.ticks for note in tick.notes if note.element == "jerk"]


def judge(loop: Loop, jerk: float, acceleration: float = 50.0) -> None:
    assert loop.largest_jerk <= jerk * (1.0 + 1e-6)
    assert loop.acceleration <= acceleration * (1.0 + 1e-6)
    assert loop.speed <= 1.0 + 1e-6
    assert loop.outside <= 1e-6
    assert not loop.notes
    assert all(tick.status is Status.OPTIMAL for tick in loop.ticks)


@pytest.mark.parametrize("jerk", [500.0, 100.0])
@pytest.mark.parametrize("far", [0.2, 0.6, 3.0])
@pytest.mark.parametrize("name", ["ur5", "panda", "g1"])
def test_jerk_and_limits_hold_and_no_hand_swings(name: str, far: float, jerk: float) -> None:
    loop = Loop(name, jerk)
    goal = loop.start + far * np.array([0.3, -0.5, 0.4])
    loop.go(1000, goal)
    judge(loop, jerk)
    errors = np.array(loop.errors)
    near = np.minimum.accumulate(errors)
    assert (errors - near).max() <= 0.06 * (errors[0] - near[-1]), "the hand swings"
    assert loop.reversals() <= 6
    assert loop.reversals(0.1, begin=500) <= 2, "a joint swings"
    if far < 0.5:
        assert errors[-1] < 2e-3


@pytest.mark.slow
@pytest.mark.parametrize("seed", range(6))
@pytest.mark.parametrize("name", ["ur5", "panda", "g1"])
def test_drawn_goals_gains_and_limits(name: str, seed: int) -> None:
    rng = np.random.default_rng(seed)
    jerk, gain = float(np.exp(rng.uniform(np.log(50.0), np.log(3000.0)))), float(rng.uniform(2.0, 20.0))
    acceleration = float(rng.uniform(5.0, 50.0))
    loop = Loop(name, jerk, gain, {"acceleration": acceleration})
    for _ in range(4):
        loop.go(int(rng.integers(300, 1200)), loop.start + rng.uniform(-0.8, 0.8, 3))
    assert loop.outside <= 1e-6
    assert loop.speed <= 1.0 + 1e-6
    assert loop.acceleration <= acceleration * (1.0 + 1e-6)
    lost = len(loop.notes)
    assert lost <= 0.01 * len(loop.ticks)
    assert lost or loop.largest_jerk <= jerk * (1.0 + 1e-6)


@pytest.mark.parametrize("jerk", [30.0, 300.0, 3000.0])
@pytest.mark.parametrize("gain", [2.0, 8.0, 25.0])
def test_a_joint_never_passes_its_goal(gain: float, jerk: float) -> None:
    robot = hqp.robots.load("ur5")
    posture = t.Posture(law=P(gain))
    stack = Stack(Level(posture), subject_to=[t.JointLimits(jerk=jerk)])
    session = hqp.Controller(stack, hqp.Velocity(), deadline=np.inf).session(robot, DT, stuck=False)
    for far in (0.01, 0.5, 2.5):
        q, v = robot.home.copy(), np.zeros(robot.nv)
        goal = robot.home.copy()
        goal[1] += far
        session.begin(command=np.zeros(6))
        last, passed, jerks = np.zeros((2, 6)), 0.0, 0.0
        for _ in range(1500):
            tick = session.step(robot.state(q, v), posture.at(goal))
            jerks = max(jerks, float(np.abs(tick.command - 2.0 * last[1] + last[0]).max()) / DT**2)
            last = np.array((last[1], tick.command))
            q, v = tick.advance()
            passed = max(passed, float(q[1] - goal[1]))
        assert jerks <= jerk * (1.0 + 1e-6)
        assert passed <= 1e-4 * far, f"from {far} rad"
        assert goal[1] - q[1] < far


def test_without_it_nothing_changes() -> None:
    plain, none, other = (
        Loop("ur5", None, limits=limits).go(50, np.array([0.5, 0.2, 0.4]))
        for limits in ({}, {"acceleration": 50.0}, {"acceleration": 40.0})
    )
    np.testing.assert_array_equal(plain.sent, none.sent)
    assert np.any(plain.sent != other.sent)
    assert plain.largest_jerk > 1e4


def test_files_and_batches_send_the_same_bits() -> None:
    loop = Loop("g1", 200.0)
    robot, goal = loop.robot, loop.start + np.array([0.15, -0.1, 0.2])
    file = LoadedSession(text(loop.session))
    batch = hqp.Batch(loop.session.controller, robot, 3, DT, threads=2)
    other = LoadedSession(text(loop.session))
    qs = [robot.home.copy() for _ in range(3)]
    vs = [np.zeros(robot.nv) for _ in range(3)]
    for i in range(150):
        state = robot.state(qs[0], vs[0])
        tick = loop.session.step(state, loop.hand.at(goal))
        if i == 0:
            for name, value in loop.session.hold_values.items():
                if name in file.names:
                    file.hold(name, value)
        found = file.step(qs[0], vs[0], {"hand": goal})
        np.testing.assert_array_equal(found.x, tick.x)
        alone = other.step(qs[1], vs[1], {"hand": goal})
        worlds = batch.step(np.array(qs), np.array(vs), {"hand": np.array([goal, goal, goal - 0.2])})
        np.testing.assert_array_equal(worlds.x[1], alone.x)
        for k, x in enumerate((tick.x, alone.x, worlds.x[2])):
            qs[k], vs[k] = robot.integrate(qs[k], x, DT), x
    assert np.abs(vs[0]).max() > 0.01


def test_limits_win_and_a_note_says_which() -> None:
    loop = Loop("ur5", 100.0)
    column = 2
    loop.q[column] = loop.robot.upper[column] - 0.1
    command = np.zeros(6)
    command[column] = 1.5  # the jerk stops it in 0.24 s and 0.18 rad, the acceleration in 0.03 s and 0.02 rad
    loop.v = command
    loop.session.begin(command=command, state=loop.robot.state(loop.q, command))
    loop.go(400, loop.start)
    assert loop.outside <= 1e-6
    assert np.abs(np.diff(np.vstack((command, loop.sent)), axis=0)).max() / DT <= 50.0 * (1.0 + 1e-6)
    assert loop.notes, "nobody was told"
    assert loop.robot.joint_name(column) in loop.notes[0]
    assert "allowed 100/s^3" in loop.notes[0]
    assert np.abs(loop.sent[:, column]).max() <= 1.5 + 1e-9, "an enforced deceleration went on"


def test_other_inequalities_win() -> None:
    def fastest(jerk: float) -> tuple[float, list[str]]:
        loop = Loop("ur5", jerk, more=(t.FrameVelocityLimits(frame="tool0", linear=0.25, name="slow"),))
        loop.go(700, loop.start + np.array([0.2, -0.4, 0.3]))
        most = 0.0
        q = loop.robot.home.copy()
        for tick in loop.ticks:
            before = loop.robot.state(q).position("tool0")
            q = loop.robot.integrate(q, tick.x, DT)
            most = max(most, float(np.linalg.norm(loop.robot.state(q).position("tool0") - before)) / DT)
        return most, loop.notes

    for jerk in (1000.0, 20.0):
        most, notes = fastest(jerk)
        assert most <= 0.25 * 1.001, f"at {jerk} rad/s^3"
        assert all("'slow'" in note for note in notes)


def test_a_stop_is_not_continued_by_what_follows() -> None:
    loop = Loop("ur5", 60.0, braking=Braking(deceleration=30.0))
    goal = loop.start + np.array([0.2, -0.6, 0.3])
    loop.go(300, goal)
    fast = np.abs(loop.commands[-1]).max()
    assert fast > 0.5
    loop.session.stop("test")
    loop.go(8, goal)
    assert 0.1 < np.abs(loop.commands[-1]).max() < fast, "it stands already, or does not brake"
    loop.session.resume()
    before = loop.commands[-1].copy()
    loop.go(300, goal)
    after = np.vstack((before, before, loop.sent[308:]))
    assert np.abs(np.diff(after, 2, axis=0)).max() / DT**2 <= 60.0 * (1.0 + 1e-6)
    assert np.abs(after).max() <= max(1.0, 1.2 * fast)
    assert loop.errors[-1] < loop.errors[308]


def test_a_change_of_stack_keeps_the_jerk() -> None:
    loop = Loop("ur5", 200.0)
    goal = loop.start + np.array([0.1, -0.4, 0.2])
    loop.go(200, goal)
    old = loop.session.stack
    turned = Level(t.Orientation(frame="tool0", name="turn"))
    loop.session.change(Stack(old.levels[0], turned, *old.levels[1:], subject_to=old.subject_to), over=0.2)
    loop.go(800, goal)
    assert loop.ticks[-1].transition is None or loop.ticks[-1].transition >= 1.0
    assert loop.largest_jerk <= 200.0 * (1.0 + 1e-6)
    assert loop.errors[-1] < 5e-3


@pytest.mark.parametrize("formulation", [hqp.Acceleration(), hqp.Torque()])
def test_levels_above_refuse_it(formulation: Any) -> None:
    stack = Stack(Level(t.Posture()), subject_to=[t.JointLimits(jerk=100.0)])
    with pytest.raises(DeclarationError, match="jerk"):
        hqp.Controller(stack, formulation).session(hqp.robots.load("ur5"), DT)


@pytest.mark.parametrize("jerk", [-1.0, np.nan, np.inf, "fast"])
def test_what_is_no_jerk_is_refused(jerk: Any) -> None:
    with pytest.raises(DeclarationError, match="jerk"):
        t.JointLimits(jerk=jerk)


@pytest.mark.slow
@pytest.mark.parametrize("name", soak.ROBOTS)
def test_hostile_events_break_no_limit(name: str, monkeypatch: pytest.MonkeyPatch) -> None:
    """NaN, kicks, changes of stack, conflicts and goals out of reach; with rates the soak judges each change."""
    rng, record = np.random.default_rng(len(name)), soak.Record()
    jerk = float(np.exp(rng.uniform(np.log(30.0), np.log(3000.0))))
    monkeypatch.setattr(soak, "JointLimits", partial(t.JointLimits, jerk=jerk))
    for rates in (soak.RATES, None):
        sent = soak.soak(soak.load(name), "velocity", 300, rng, record, rates)
        commands = np.array([np.frombuffer(one) for one in sent])
        robot = soak.load(name)
        assert np.all(np.abs(commands) <= (1.0 + 1e-5) * robot.velocity_limit[robot.actuated])
    assert record.ticks == 600


@pytest.mark.long
@pytest.mark.parametrize(
    "name", ["ur5", pytest.param("panda", marks=pytest.mark.slow), pytest.param("g1", marks=pytest.mark.slow)]
)
def test_behind_servos_delay_and_noise_it_is_as_exact_as_without(name: str, monkeypatch: pytest.MonkeyPatch) -> None:
    """MuJoCo, position servos, states of three ticks ago with noise of 0.02 rad/s."""
    pytest.importorskip("mujoco")
    from tests.scenes import following

    def off(jerk: float | None) -> float:
        monkeypatch.setattr(following, "JointLimits", partial(t.JointLimits, jerk=jerk))
        loop = following.Loop(name, "velocity", seed=3, late=3, noise=0.02, ticks=900).run()
        sent = np.array(loop.commands)
        if jerk is not None:
            assert np.abs(np.diff(sent, 2, axis=0)).max() / DT**2 <= jerk * (1.0 + 1e-6)
            assert max(int((np.diff(np.sign(c[np.abs(c) > 0.1])) != 0).sum()) for c in sent.T) <= 2
        assert set(loop.statuses) == {Status.OPTIMAL}
        return float(np.linalg.norm(loop.place() - loop.goal))

    assert off(100.0) < off(None) + 1e-3
