"""Changes of stack in the loop: hold values, the cache, and transitions without a jump."""

from __future__ import annotations

import gc
from itertools import pairwise
from typing import Any

import numpy as np
import pytest

import hqp
from hqp import PD, Level, P, Stack, Status
from hqp.errors import DeclarationError, FrameNotFound, ModelError
from hqp.robots import Robot
from hqp.tasks import (
    Com,
    FixedContact,
    FrictionCone,
    JointLimits,
    Orientation,
    Pose,
    Position,
    Posture,
    TorqueLimits,
)
from hqp.transition import LARGEST_CHANGE, Transition, inverse, smooth, unloaded

DT = 0.002
SECOND = [hqp.Acceleration(), hqp.Torque(contact_law=PD(0.0, 40.0))]
FORMULATIONS = pytest.mark.parametrize("formulation", [hqp.Velocity(), *SECOND], ids=lambda f: type(f).__name__)


@pytest.fixture
def robot() -> Robot:
    return hqp.robots.load("talos")


def stack(robot: Robot, formulation: Any = None) -> Stack:
    left, right = robot.landmarks["soles"]
    torque = isinstance(formulation, hqp.Torque)
    forces = [FrictionCone(contact=frame, mu=0.6) for frame in (left, right)] if torque else []
    forces += [TorqueLimits()] if torque else []
    return Stack(
        Level(Com(name="com")),
        Level(Position(frame=robot.landmarks["palms"][1], name="hand")),
        Level(Orientation(frame=robot.landmarks["base"][0], name="trunk")),
        Level(Posture()),
        subject_to=[
            FixedContact(frame=left),
            FixedContact(frame=right),
            *forces,
            JointLimits(),
        ],
    )


def session(robot: Robot, declared: Stack, formulation: Any = None) -> hqp.Session:
    return hqp.Controller(declared, formulation or hqp.Velocity(), deadline=np.inf).session(robot, DT)


# hold values --------------------------------------------------------------------------------------------------------


@pytest.mark.parametrize(
    ("old", "new"),
    [
        (Com(axes="xy", name="task"), Com(axes="yz", name="task")),
        (Com(name="task"), Com(relative_to="base_link", name="task")),
        (Position(frame="gripper_right_base_link", name="task"), Pose(frame="gripper_right_base_link", name="task")),
        (Position(frame="gripper_right_base_link", name="task"), Position(frame="gripper_left_base_link", name="task")),
        (Com(name="task"), Com(subtree="torso_1_joint", name="task")),
        (Posture(joints="head_1_joint", name="task"), Posture(joints="head_2_joint", name="task")),
    ],
    ids=["axes", "observer", "class", "frame", "subtree", "joints"],
)
def test_a_hold_value_of_another_quantity_is_not_kept(robot: Robot, old: Any, new: Any) -> None:
    feet = [FixedContact(frame=frame) for frame in robot.landmarks["soles"]]
    run = session(robot, Stack(Level(old), Level(Posture()), subject_to=feet))
    run.step(robot.state())
    run.change(Stack(Level(new), Level(Posture()), subject_to=feet))
    tick = run.step(robot.state())
    assert tick.status is Status.OPTIMAL
    assert np.abs(tick.command).max() < 1e-9


def test_laws_weights_and_places_do_not_touch_a_hold_value(robot: Robot) -> None:
    run = session(robot, Stack(Level(Com(name="com", law=P(2.0)))))
    run.step(robot.state())
    run.change(Stack(Level(Posture()), Level(Com(name="com", law=P(4.0), weight=2.0))))
    q = robot.home.copy()
    q[2] += 0.01
    held = run._holds["com"].value
    run.step(robot.state(q))
    assert run._holds["com"].value is held


def test_an_element_that_returns_takes_a_fresh_hold_value(robot: Robot) -> None:
    whole = stack(robot)
    run = session(robot, whole)
    run.step(robot.state())
    run.change(whole.without("hand"))
    run.change(whole)  # before any step
    q = robot.integrate(robot.home, 0.02 * np.ones(robot.nv), 1.0)
    state = robot.state(q)
    palm = state.position(robot.landmarks["palms"][1])
    run.step(state)
    assert np.allclose(run._holds["hand"].value, palm)
    assert not np.allclose(run._holds["com"].value, robot.state(q).com())  # that of home


def test_a_change_that_cannot_work_changes_nothing(robot: Robot) -> None:
    whole = stack(robot)
    run, twin = session(robot, whole), session(robot, whole)
    q = robot.integrate(robot.home, 0.02 * np.ones(robot.nv), 1.0)
    for each in (run, twin):
        each.step(robot.state())
    for bad, error in (
        (Stack(Level(Position(frame="nowhere"))), FrameNotFound),
        (Stack(Level(Position(frame=robot.landmarks["palms"][1], law=PD(1.0)))), DeclarationError),
        (Stack(Level(TorqueLimits())), DeclarationError),
    ):
        for over in (0.0, 0.1):
            with pytest.raises(error):
                run.change(bad, over)
    for over in (-1.0, np.nan, np.inf, "soon"):
        with pytest.raises(DeclarationError, match="over"):
            run.change(whole, over)  # type: ignore[arg-type]
    assert run.stack == whole
    assert np.array_equal(run.step(robot.state(q)).command, twin.step(robot.state(q)).command)


# the cache ----------------------------------------------------------------------------------------------------------


def test_a_stack_seen_before_is_not_compiled_again(robot: Robot, monkeypatch: pytest.MonkeyPatch) -> None:
    whole = stack(robot)
    run = session(robot, whole)
    run.prepare(whole.without("hand"))
    compiled: list[Stack] = []
    kind = type(run.controller.formulation)
    original = kind.compile
    monkeypatch.setattr(kind, "compile", lambda *args: compiled.append(args[1]) or original(*args))
    for _ in range(3):
        run.change(whole.without("hand"))
        run.change(whole, 0.1)
    assert not compiled
    run.change(whole.without("trunk"))
    assert len(compiled) == 1


def test_changes_leave_nothing_behind(robot: Robot) -> None:
    whole = stack(robot)
    run = session(robot, whole)
    run.prepare(whole.without("hand"))
    gc.collect()
    gc.disable()
    try:
        before = len(gc.get_objects())
        for k in range(1000):
            run.change(whole.without("hand") if k % 2 == 0 else whole, 0.01 if k % 3 else 0.0)
            run.step(robot.state())
        grown = len(gc.get_objects()) - before
        assert gc.collect() == 0
    finally:
        gc.enable()
    assert grown < 200


# transitions --------------------------------------------------------------------------------------------------------


def test_the_schedule_is_smooth_and_has_an_inverse() -> None:
    s = np.linspace(0.0, 1.0, 101)
    h = np.array([smooth(x) for x in s])
    assert h[0] == 0.0
    assert h[-1] == 1.0
    assert np.all(np.diff(h) > 0.0)
    assert np.abs([inverse(x) for x in h] - s).max() < 1e-7


def test_a_transition_slows_down_rather_than_jump() -> None:
    transition = Transition([None, None], 0.02, DT, "velocity")  # type: ignore[list-item]
    a, b, x, changes = np.zeros(2), np.array([0.5, -0.4]), np.zeros(2), []
    while not transition.done:
        new = transition.blend(a, b, x, np.arange(2))
        changes.append(float(np.abs(new - x).max()))
        x = new
        assert len(changes) < 100
    assert max(changes) <= 0.02 * (1.0 + 1e-9)
    assert np.array_equal(x, b)
    assert len(changes) >= 25


class Loop:
    """A closed loop on the exact integrator."""

    def __init__(self, robot: Robot, declared: Stack, formulation: Any) -> None:
        self.robot, self.run = robot, session(robot, declared, formulation)
        self.q, self.v = robot.home.copy(), np.zeros(robot.nv)
        start = robot.state()
        left = robot.landmarks["soles"][0]
        self.hand = start.position(robot.landmarks["palms"][1]) + [0.05, 0.02, 0.05]
        self.above = np.array([*start.position(left)[:2], start.com()[2]])
        self.com = start.com()
        self.ticks: list[hqp.Tick] = []

    def go(self, ticks: int, goals: Any) -> list[hqp.Tick]:
        found = []
        for _ in range(ticks):
            tick = self.run.step(self.robot.state(self.q, self.v), *goals)
            found.append(tick)
            self.q, self.v = tick.advance()
        self.ticks += found
        return found

    @property
    def changes(self) -> np.ndarray:
        sent = [tick.command for tick in self.ticks]
        return np.abs(np.diff(sent, axis=0)).max(axis=1)


def events(robot: Robot, formulation: Any) -> dict[str, tuple[Stack, Stack]]:
    whole = stack(robot, formulation)
    right = robot.landmarks["soles"][1]
    com, hand, trunk, posture = whole.levels
    swapped = Stack(com, trunk, hand, posture, subject_to=whole.subject_to)
    lifted = whole.without(*(e.name for e in whole.subject_to if right in (e.name, getattr(e, "contact", ""))))
    if isinstance(formulation, hqp.Torque):  # limits of joints only where a leg swings: with both feet they cost time
        free = whole.without("joint_limits")
        swapped = Stack(com, trunk, hand, posture, subject_to=free.subject_to)
        return {
            "add": (free.without("hand"), free), "remove": (free, free.without("hand")), "swap": (free, swapped),
            "release": (whole, lifted), "take up": (lifted, whole),
        }  # fmt: skip
    bare = whole.without("hand")
    return {
        "add": (bare, whole), "remove": (whole, bare), "swap": (whole, swapped),
        "release": (whole, lifted), "take up": (lifted, whole),
    }  # fmt: skip


EVENTS = [
    pytest.param(name, f, event, id=f"{name}-{event}-{f.__name__}", marks=[pytest.mark.slow] * slow)
    for name in ("talos", "g1", "cbi")
    for f, chosen in ((hqp.Velocity, ""), (hqp.Acceleration, ""), (hqp.Torque, "release take up"))
    for event in ("add", "remove", "swap", "release", "take up")
    for slow in (event in chosen or name != "talos",)
    if not (name == "cbi" and event == "release" and f is hqp.Torque)  # CBi on one foot falls, whoever commands it
]


@pytest.mark.parametrize(("name", "kind", "event"), EVENTS)
def test_no_tick_of_a_transition_jumps(name: str, kind: Any, event: str) -> None:
    robot = hqp.robots.load(name)
    formulation = kind() if kind is not hqp.Torque else hqp.Torque(contact_law=PD(0.0, 40.0))
    before, after = events(robot, formulation)[event]
    loop = Loop(robot, before, formulation)
    one_foot = event in ("release", "take up")
    goals = [Com(name="com").at(loop.above if one_foot else loop.com)]
    hand = Position(frame=robot.landmarks["palms"][1], name="hand").at(loop.hand)
    settled = [*goals, hand] if event != "add" else goals
    settle = 700 if one_foot else 60 if kind is hqp.Torque else 250
    loop.go(settle, settled)
    loop.run.change(after, 0.25)
    moving, count = [*goals, hand], len(loop.ticks)
    during: list[hqp.Tick] = []
    while loop.run._transition is not None:
        during += loop.go(1, moving)
        assert len(during) < 1000
    assert len(during) >= 0.25 / DT - 1
    h = [tick.transition for tick in during]
    assert all(a <= b for a, b in pairwise(h))
    assert h[0] < 0.01
    assert h[-1] == 1.0
    loop.go(50, goals if event == "remove" else moving)
    level = loop.run.program.kind
    second_before, second = loop.changes[max(0, count - 501) : count - 1].max(), loop.changes[count - 1 :].max()
    loaded = 3.0 if one_foot and level == "torque" else LARGEST_CHANGE[level]
    assert second <= max(1.2 * second_before, loaded) * (1.0 + 1e-9)
    abrupt = Loop(robot, before, formulation)
    abrupt.go(settle, settled)
    abrupt.run.change(after)
    abrupt.go(1, goals if event == "remove" else moving)
    if event != "swap":
        assert abrupt.changes[-1] > 3.0 * loop.changes[count - 1]  # the change would have been felt


@FORMULATIONS
def test_levels_above_a_change_do_not_notice_it(robot: Robot, formulation: Any) -> None:
    before, after = events(robot, formulation)["add"]
    loop = Loop(robot, before, formulation)
    goals = [Com(name="com").at(loop.com + [0.01, 0.01, 0.0])]
    loop.go(50, goals)
    loop.run.change(after, 0.1)
    hand = Position(frame=robot.landmarks["palms"][1], name="hand").at(loop.hand)
    for _ in range(60):
        (tick,) = loop.go(1, [*goals, hand])
        problem = loop.run.problem
        if tick.transition < 1.0:
            assert tick.solution is not None
            shared = problem.constraints + 1  # subject_to, then com
            limits = loop.run.program.places.get("joint_limits")  # at velocity level with a window about each own x
            own = -1 if limits is None else limits.level
            for k, (w, alone) in enumerate(zip(problem.slacks(tick.x)[:shared], tick.solution.residuals, strict=False)):
                if k != own or loop.run.program.kind != "velocity":
                    assert float(np.abs(w - alone).max(initial=0.0)) < 1e-9
            if loop.run.program.kind == "velocity":
                assert np.all(np.abs(tick.command) <= robot.velocity_limit[robot.actuated] * (1.0 + 1e-9))


def test_the_unloaded_contact_bears_nothing(robot: Robot) -> None:
    formulation = hqp.Torque()
    whole = stack(robot, formulation)
    right = robot.landmarks["soles"][1]
    contact = whole.find(right, FixedContact)
    empty = unloaded(whole, [contact], robot)
    run = session(robot, empty, formulation)
    tick = run.step(robot.state())
    program: Any = run.program
    assert tick.status is Status.OPTIMAL
    assert np.abs(program.contact_forces(tick.x)[right]).max() < 1e-6


def test_references_of_either_stack_are_taken_in_a_transition(robot: Robot) -> None:
    whole = stack(robot)
    run = session(robot, whole)
    hand = Position(frame=robot.landmarks["palms"][1], name="hand")
    state = robot.state()
    goal = hand.at(state.position(hand.frame) + 0.01)
    run.step(state, goal)
    run.change(whole.without("hand"), 0.01)
    assert run.step(robot.state(), goal).transition < 1.0
    for _ in range(10):
        run.step(robot.state())
    with pytest.raises(hqp.errors.UnknownReference):
        run.step(robot.state(), goal)


def test_a_change_within_a_change_is_continuous_too(robot: Robot) -> None:
    whole = stack(robot)
    loop = Loop(robot, whole.without("hand"), hqp.Velocity())
    hand = Position(frame=robot.landmarks["palms"][1], name="hand").at(loop.hand)
    com = Com(name="com").at(loop.com)
    loop.go(20, [com])
    loop.run.change(whole, 0.2)
    loop.go(30, [com, hand])
    loop.run.change(whole.without("trunk"), 0.2)
    loop.go(20, [com, hand])
    loop.run.change(whole.without("hand"), 0.2)
    loop.go(250, [com])
    assert loop.run._transition is None
    assert loop.changes[:68].max() <= LARGEST_CHANGE["velocity"] * (1.0 + 1e-9)
    assert (
        loop.changes.max() <= 50.0 * DT * 1.05
    )  # the hand's reference ends with the last change: a step of its target


def test_a_bad_state_in_a_transition_comes_to_rest(robot: Robot) -> None:
    for formulation in (hqp.Velocity(), *SECOND):
        before, after = events(robot, formulation)["add"]
        loop = Loop(robot, before, formulation)
        loop.go(5, ())
        loop.run.change(after, 0.1)
        loop.go(5, ())
        tick = loop.run.step(robot.state(np.full(robot.nq, np.nan)))
        assert tick.status is Status.INVALID_STATE
        assert tick.held == 1
        assert np.isfinite(tick.command).all()
        assert loop.go(200, ())[-1].transition == 1.0


def test_a_change_of_contacts_that_leaves_the_robot_undetermined_is_refused(robot: Robot) -> None:
    run = session(robot, stack(robot, hqp.Torque()), hqp.Torque())
    run.step(robot.state())
    with pytest.raises((DeclarationError, ModelError), match="determine"):
        run.change(Stack(Level(Posture())), 0.2)
    assert run.step(robot.state()).status.usable
