"""Changes of stack in the loop: hold values, cache, and transitions without a jump."""

from __future__ import annotations

import gc
from pathlib import Path
from typing import Any

import numpy as np
import pytest

import hqp
from hqp import PD, Level, P, Stack, Status
from hqp.commands.arguments import formulation
from hqp.declare.reference import Reference
from hqp.errors import DeclarationError, FrameNotFound, ModelError
from hqp.loop import compiled
from hqp.loop.guards import largest_change
from hqp.loop.way import path, unloaded
from hqp.recorder import load as load_recording
from hqp.robots import Robot
from hqp.tasks import (
    CenterOfPressure,
    Com,
    FixedContact,
    PointContact,
    Pose,
    Position,
    Posture,
    TorqueLimits,
    UnilateralContact,
)
from hqp.viewer.session_view import View
from tests.scenes.changes import DT, LEVELS, ROBOTS, Loop, lifted, measure, smooth, stack

EVERY_LEVEL = pytest.mark.parametrize("level", LEVELS)


@pytest.fixture
def robot() -> Robot:
    return hqp.robots.load("talos")


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
    held = robot.state().com()
    run.step(robot.state(q))
    np.testing.assert_allclose(run.hold_values["com"], held, atol=1e-12)


def test_an_element_that_returns_takes_a_fresh_hold_value(robot: Robot) -> None:
    whole = stack(robot, "velocity")
    run = session(robot, whole)
    run.step(robot.state())
    run.change(whole.without("hand"))
    run.change(whole)  # before any step
    q = robot.integrate(robot.home, 0.02 * np.ones(robot.nv), 1.0)
    state = robot.state(q)
    palm = state.position(robot.landmarks["palms"][1])
    run.step(state)
    assert np.allclose(run.hold_values["hand"], palm)
    assert not np.allclose(run.hold_values["com"], robot.state(q).com())  # the hold value at home


def test_a_change_that_cannot_work_changes_nothing(robot: Robot) -> None:
    whole = stack(robot, "velocity")
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
    whole = stack(robot, "velocity")
    run = session(robot, whole)
    run.prepare(whole.without("hand"))
    seen: list[Stack] = []
    kind = type(run.controller.formulation)
    original = kind.compile
    monkeypatch.setattr(kind, "compile", lambda *args: seen.append(args[1]) or original(*args))
    for _ in range(3):
        run.change(whole.without("hand"))
        run.change(whole, 0.1)
    assert not seen
    run.change(whole.without("trunk"))
    assert len(seen) == 1


@EVERY_LEVEL
def test_a_change_to_a_stack_seen_before_is_quick(robot: Robot, level: str, monkeypatch: pytest.MonkeyPatch) -> None:
    """Release a foot, at torque level through four stacks: nothing is compiled, and the path is not searched again."""
    whole = stack(robot, level)
    one = lifted(whole, robot)
    run = hqp.Controller(whole, formulation(level), deadline=np.inf).session(robot, DT)
    run.step(robot.state())
    run.prepare(one)
    done: list[str] = []
    kind = type(run.controller.formulation)
    for where, name in ((compiled, "path"), (kind, "compile")):
        original = getattr(where, name)
        monkeypatch.setattr(where, name, lambda *given, f=original, n=name: done.append(n) or f(*given))
    for _ in range(3):
        run.change(whole)
        run.step(robot.state())
        run.change(one, 0.25)
        run.step(robot.state())
    assert done == []
    run.change(one.without("hand"), 0.25)
    assert set(done) == {"path", "compile"}


@pytest.mark.long
def test_changes_leave_nothing_behind(robot: Robot) -> None:
    whole = stack(robot, "velocity")
    run = session(robot, whole)
    run.prepare(whole.without("hand"))
    while gc.collect():  # robots of other tests, then their cached copies
        pass
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


def test_a_transition_goes_at_an_even_pace(robot: Robot) -> None:
    """h = 3 s^2 - 2 s^3 with s from 0 to 1 in as many ticks as it takes, if no command has to wait."""
    run, whole = session(robot, stack(robot, "velocity")), stack(robot, "velocity")
    run.step(robot.state())
    run.change(whole.without("hand"), 20 * DT)
    came = [run.step(robot.state()).transition for _ in range(20)]
    np.testing.assert_allclose(came, [smooth((k + 1) / 20) for k in range(20)], atol=1e-12)
    assert came[-1] == 1.0


def test_a_transition_slows_down_rather_than_jump() -> None:
    """The arm would gain 0.5 rad/s: at 0.02 rad/s in a tick it takes 25 ticks, more than the requested ten."""
    arm = hqp.robots.load("ur5")
    posture, aimed = Posture(), Posture(law=P(5.0), name="aimed")
    run = session(arm, Stack(Level(posture)))
    state = arm.state()
    last, changes = run.step(state).command, []
    run.change(Stack(Level(aimed)), 10 * DT)
    goal = aimed.at(state.angles + [0.1, -0.08, 0.0, 0.0, 0.0, 0.0])
    while (tick := run.step(state, goal)).transition < 1.0:
        changes.append(float(np.abs(tick.command - last).max()))
        last = tick.command
        assert len(changes) < 100
    assert max(changes) <= 0.02 * (1.0 + 1e-9)
    np.testing.assert_allclose(tick.command, [0.5, -0.4, 0.0, 0.0, 0.0, 0.0], atol=1e-6)
    assert len(changes) >= 24


CHANGES = [
    pytest.param(name, level, id=f"{name}-{level}", marks=[pytest.mark.slow] * (name != "talos"))
    for name in ROBOTS
    for level in LEVELS
]


@pytest.mark.long
@pytest.mark.parametrize(("name", "level"), CHANGES)
def test_no_tick_of_a_transition_jumps(name: str, level: str) -> None:
    for change in measure(hqp.robots.load(name), level):
        assert change.calm, str(change)
        assert 0.25 / DT <= change.ticks <= 260, str(change)
        assert not change.notes
        if change.event != "swap" and change.before < largest_change(level, DT):
            assert change.abrupt > 3.0 * change.during, str(change)  # without easing there would be a jump


@pytest.mark.long
def test_a_heavy_foot_is_released_without_a_jump() -> None:
    """CBi fell: a foot in the air got 432 N m, the torque that holds it on the ground."""
    (change,) = measure(hqp.robots.load("cbi"), "torque", ["release"])
    assert change.during <= 1.0 + 1e-9, str(change)
    assert change.after <= 3.0, str(change)


def test_a_kick_in_a_transition_is_followed_by_the_largest_change_at_most(robot: Robot) -> None:
    whole = stack(robot, "torque")
    loop = Loop(robot, whole, "torque")
    loop.shift(300)
    loop.run.change(lifted(whole, robot), 0.1)
    loop.go(5, loop.goals(1.0))
    kicked = robot.state(loop.q, loop.v + 0.05 * np.sin(np.arange(robot.nv)))
    tick = loop.run.step(kicked, *loop.goals(1.0))
    most = largest_change("torque", DT)
    assert np.abs(tick.command - loop.ticks[-1].command).max() == pytest.approx(most, rel=1e-9)
    assert tick.transition < 1.0
    (note,) = [note for note in tick.notes if note.element == "transitions"]
    assert "allowed 500/s" in note.detail


def on_small_soles(robot: Robot) -> Stack:
    """Stack with a centre of pressure within small soles and a minimum load on the feet."""
    whole = stack(robot, "torque")
    extra = [CenterOfPressure(contact=f, rectangle=(-0.08, 0.1, -0.04, 0.04)) for f in robot.landmarks["soles"]]
    least = [UnilateralContact(contact=f, minimum=20.0) for f in robot.landmarks["soles"]]
    return Stack(*whole.levels, subject_to=[*whole.subject_to, *extra, *least])


@pytest.mark.long
def test_a_foot_that_cannot_be_unloaded_keeps_the_change_waiting(robot: Robot) -> None:
    whole, right = on_small_soles(robot), robot.landmarks["soles"][1]
    loop = Loop(robot, whole, "torque")
    between = loop.goals(0.0)
    loop.go(50, between)
    loop.run.change(lifted(whole, robot), 0.1)
    waiting = loop.go(200, between)  # the CoM is between the feet
    assert all(tick.transition <= 0.5 and tick.status is Status.OPTIMAL for tick in waiting)
    tick = waiting[-1]
    program: Any = tick.program
    wrench = program.contact_forces(tick.x)[right]
    bears = np.linalg.norm(wrench[:3])
    assert bears > 100.0
    assert [(n.element, n.detail) for n in tick.notes] == [
        (
            right,
            f"cannot be released: it still carries {bears:.3g} N and {np.linalg.norm(wrench[3:]):.3g} N m; "
            "unload it first",
        )
    ]
    assert np.abs(robot.state(loop.q).com() - loop.com).max() < 1e-5
    borne = []
    for k in range(900):  # a user shifts the weight off it
        (tick,) = loop.go(1, loop.goals(smooth(min(1.0, k / 700))))
        program = tick.program
        forces = program.contact_forces(tick.x)
        if right in forces:
            borne.append(float(np.linalg.norm(forces[right][:3])))
    assert borne[-1] < 5.0  # less than 2 N disappear in one tick
    assert loop.ticks[-1].transition == 1.0
    assert loop.changes[50:].max() <= 3.0
    assert right not in loop.run.stack


def test_the_way_of_a_change_of_contacts(robot: Robot) -> None:
    formulation = hqp.Torque(contact_law=PD(0.0, 40.0))
    whole = stack(robot, "torque")
    left, right = robot.landmarks["soles"]
    one = lifted(whole, robot)
    out = path(whole, one, robot, formulation.contact_law)
    back = path(one, whole, robot, formulation.contact_law)
    assert [point.switch for point in out] == [False, True, False, False]
    assert [point.switch for point in back] == [False, True, False, False]
    assert out[1].released == (right,)
    assert out[1].stack.levels[-1].elements[0].contact == right  # below all tasks
    assert f"{right}_friction" in out[1].stack
    assert right not in out[2].stack
    assert f"{right} carried" in out[2].stack.levels[0].elements[0].name
    point = Stack(*whole.levels, subject_to=[PointContact(frame=right, name=right), *whole.without(right).subject_to])
    both = path(whole, point, robot, formulation.contact_law)
    assert [p.switch for p in both] == [False, True, False, True, False, False]
    softer = whole.with_laws({left: PD(0.0, 10.0), right: PD(0.0, 10.0)})
    assert len(path(whole, softer, robot, formulation.contact_law)) == 2  # another law does not make another contact
    points = Stack(
        *whole.levels,
        subject_to=[*(PointContact(frame=f, name=f) for f in (left, right)), *whole.without(left, right).subject_to],
    )
    run = session(robot, whole, formulation)
    before = run.stack
    with pytest.raises(DeclarationError, match="would pass a stack without contacts"):
        run.change(points, 0.2)
    assert run.stack == before


@pytest.mark.parametrize(("load", "unloads"), [(None, True), (300.0, True), (20.0, False)])
def test_a_contact_that_was_measured_to_bear_little_is_let_go_as_it_is(
    robot: Robot, load: float | None, unloads: bool
) -> None:
    """Release it at once, without a stack that unloads it first, even if the model predicts a load."""
    whole, right = on_small_soles(robot), robot.landmarks["soles"][1]
    loop = Loop(robot, whole, "torque")
    loop.go(50, loop.goals(0.0))
    loop.run.change(lifted(whole, robot), 0.1)
    felt = [] if load is None else [Reference(right).loaded(load)]
    (tick,) = loop.go(1, [*loop.goals(0.0), *felt])
    assert (f"{right} bears nothing" in {account.element for account in tick.explain().accounts}) is unloads
    assert loop.changes[-1] <= 1.2


class Unserved(View):
    """View without a server: the part that runs in the loop."""

    def _start(self, host: str, port: int, title: str) -> None:
        self._hurry, self.period = True, 0.0

    def close(self) -> None:
        """Nothing is served."""


@pytest.mark.long
def test_every_tick_of_a_change_tells_of_its_own_rows(robot: Robot, tmp_path: Path) -> None:
    """Explain, record and show stacks on the path, although their rows differ from those of the last stack."""
    whole = stack(robot, "torque")
    loop = Loop(robot, whole, "torque")
    loop.shift(100)
    recorder = loop.run.record(ticks=120, on="never", to=tmp_path)
    view = Unserved(loop.run)
    loop.run.change(lifted(whole, robot), 0.02)
    names, start = [], len(loop.ticks)
    while len(loop.ticks) == start or loop.ticks[-1].transition < 1.0:
        state = robot.state(loop.q, loop.v)
        if len(loop.ticks) == start + 3:
            tick = loop.run.step(robot.state(np.full(robot.nq, np.nan)), *loop.goals(1.0))
            view.show(state, tick)
        (tick,) = loop.go(1, loop.goals(1.0))
        view.show(state, tick, *loop.goals(1.0))
        names.append({account.element for account in tick.explain().accounts})
        assert set(tick.account().elements) == names[-1]
    view._flush()
    right = robot.landmarks["soles"][1]
    assert f"{right} bears nothing" in names[0]
    assert f"{right} carried" not in names[0]
    assert right not in names[-1]
    recorder.dump()
    recorder.wait()
    for recorded in load_recording(recorder.files[0]):
        if recorded.solution is not None:
            slacks = recorded.problem.slacks(recorded.solution.x)
            assert all(
                np.allclose(w, own, atol=1e-9) for w, own in zip(slacks, recorded.solution.residuals, strict=True)
            )


def test_what_is_told_while_a_foot_is_released_is_held_on_the_feet_that_stand(robot: Robot) -> None:
    """With an invalid state while both feet stand, hold with the torque of both feet."""
    whole = stack(robot, "torque")
    loop = Loop(robot, whole, "torque")
    loop.shift(300)
    goals = loop.goals(1.0)
    kept = session(robot, whole, hqp.Torque(contact_law=PD(0.0, 40.0)))
    kept.step(robot.state(loop.q, loop.v), *goals)
    loop.run.change(lifted(whole, robot), 0.5)
    loop.go(2, goals)
    bad = np.full(robot.nq, np.nan)
    held, alone = loop.run.step(robot.state(bad)), kept.step(robot.state(bad))
    assert held.held == 1
    assert np.abs(held.command - alone.command).max() < 1.0


@EVERY_LEVEL
def test_levels_above_a_change_do_not_notice_it(robot: Robot, level: str) -> None:
    after = stack(robot, level)
    before = after.without("hand")
    loop = Loop(robot, before, level)
    goals = [Com(name="com").at(loop.com + [0.01, 0.01, 0.0])]
    loop.go(50, goals)
    loop.run.change(after, 0.25)
    hand = Position(frame=robot.landmarks["palms"][1], name="hand").at(loop.hand)
    for _ in range(130):
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
    whole = stack(robot, "torque")
    right = robot.landmarks["soles"][1]
    contact = whole.find(right, FixedContact)
    empty = unloaded(whole, [contact], robot)
    run = session(robot, empty, formulation)
    tick = run.step(robot.state())
    program: Any = run.program
    assert tick.status is Status.OPTIMAL
    assert np.abs(program.contact_forces(tick.x)[right]).max() < 1e-6


def test_references_of_either_stack_are_taken_in_a_transition(robot: Robot) -> None:
    whole = stack(robot, "velocity")
    run = session(robot, whole)
    hand = Position(frame=robot.landmarks["palms"][1], name="hand")
    state = robot.state()
    goal = hand.at(state.position(hand.frame) + 0.01)
    run.step(state, goal)
    run.change(whole.without("hand"), 0.01)
    assert run.step(robot.state(), goal).transition < 1.0
    while run.step(robot.state()).transition < 1.0:
        assert run.count < 100
    with pytest.raises(hqp.errors.UnknownReference):
        run.step(robot.state(), goal)


def test_a_change_within_a_change_is_continuous_too(robot: Robot) -> None:
    whole = stack(robot, "velocity")
    loop = Loop(robot, whole.without("hand"), "velocity")
    hand = Position(frame=robot.landmarks["palms"][1], name="hand").at(loop.hand)
    com = Com(name="com").at(loop.com)
    loop.go(20, [com])
    loop.run.change(whole, 0.2)
    loop.go(30, [com, hand])
    loop.run.change(whole.without("trunk"), 0.2)
    loop.go(20, [com, hand])
    loop.run.change(whole.without("hand"), 0.2)
    loop.go(250, [com])
    assert loop.run.line.transition is None
    assert loop.changes[19:].max() <= largest_change("velocity", DT) * (1.0 + 1e-9)


def test_a_bad_state_in_a_transition_comes_to_rest(robot: Robot) -> None:
    for level in LEVELS:
        after = stack(robot, level)
        before = after.without("hand")
        loop = Loop(robot, before, level)
        loop.go(5, ())
        loop.run.change(after, 0.1)
        loop.go(5, ())
        tick = loop.run.step(robot.state(np.full(robot.nq, np.nan)))
        assert tick.status is Status.INVALID_STATE
        assert tick.held == 1
        assert np.isfinite(tick.command).all()
        assert loop.go(200, ())[-1].transition == 1.0


@pytest.mark.long
def test_a_change_of_contacts_that_leaves_the_robot_undetermined_is_refused(robot: Robot) -> None:
    run = session(robot, stack(robot, "torque"), hqp.Torque())
    run.step(robot.state())
    with pytest.raises((DeclarationError, ModelError), match="determine"):
        run.change(Stack(Level(Posture())), 0.2)
    assert run.step(robot.state()).status.usable


@pytest.mark.parametrize("over", [0.0, 0.1])
def test_a_change_in_the_midst_of_another_starts_from_what_was_sent(over: float) -> None:
    """The stack that is blended in has sent no command of its own: rates count from the blend."""
    robot = hqp.robots.load("cbi")
    feet = [FixedContact(frame=f) for f in robot.landmarks["soles"]]
    hand = Position(frame=robot.landmarks["palms"][1], name="hand")
    stacks = [Stack(*levels, subject_to=feet) for levels in ([Level(hand), Level(Posture())], [Level(Posture())])]
    controller = hqp.Controller(stacks[0], rates=hqp.RateLimits(velocity=5.0), deadline=np.inf)
    session, state = controller.session(robot, 0.002), robot.state()
    aim, last = hand.at(hand.value(state) + [0.4, -0.4, 0.3]), np.zeros(len(robot.joint_names))
    for k in range(150):
        if k in (100, 120):
            session.change(stacks[k == 100], over=0.5 if k == 100 else over)
        tick = session.step(state, *([aim] if "hand" in session else []))
        assert np.abs(tick.command - last).max() <= 0.01 * (1.0 + 1e-9), k
        last = tick.command.copy()
    assert np.abs(last).max() > 0.5
