"""Two feet share their load: one number determines twelve components without effect on the motion."""

from __future__ import annotations

from typing import Any

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

import hqp.robots
from hqp import PD, Level, Stack, Status, serial
from hqp.arrays import Vec
from hqp.declare.robot import Robot
from hqp.errors import DeclarationError
from hqp.tasks import CenterOfPressure, Com, FixedContact, LoadShare, Orientation, PointContact, Posture

RECTANGLES = {"l_sole": (-0.065, 0.18, -0.04, 0.06), "r_sole": (-0.065, 0.18, -0.06, 0.04)}
SOLES = tuple(RECTANGLES)
SHARE = LoadShare(contacts=SOLES)


@pytest.fixture(scope="module")
def robot() -> Robot:
    return hqp.robots.load("cbi")


def stack(*more: Any, law: Any = None) -> Stack:
    within = [CenterOfPressure(contact=f, rectangle=RECTANGLES[f]) for f in SOLES] if not more else []
    return Stack(
        Level(Com(name="com", law=PD(0.0, 0.0))),
        Level(Orientation(frame="pelvis", name="trunk")),
        Level(Posture()),
        Level(SHARE, price=0),
        subject_to=[*(FixedContact(frame=f) for f in SOLES), *within, *more],
    )


def wrenches(session: Any, state: Any, x: Vec, middles: Any) -> tuple[Vec, Vec]:
    """Wrench of each foot about its middle, in world axes."""
    forces = session.program.contact_forces(x, world=True)
    found = []
    for frame, (x0, y0) in zip(SOLES, middles, strict=True):
        f, m = np.split(forces[frame], 2)
        arm = state.rotation(frame) @ [x0, y0, 0.0]
        found.append(np.concatenate((f, m - np.cross(arm, f))))
    return found[0], found[1]


@pytest.mark.long
@settings(max_examples=15)
@given(share=st.floats(0.0, 1.0), seed=st.integers(0, 1000))
def test_each_foot_bears_its_share(share: float, seed: int) -> None:
    """(1 - s) w_2 = s w_1 about the middles, for any demands of the levels above."""
    robot, rng = hqp.robots.load("cbi"), np.random.default_rng(seed)
    declared = Stack(*stack().levels, subject_to=[FixedContact(frame=f) for f in SOLES])
    element = LoadShare(contacts=SOLES, middles=((0.05, 0.01), (0.05, -0.01)))
    declared = Stack(*declared.levels[:-1], Level(element, price=0), subject_to=declared.subject_to)
    run = hqp.Controller(declared, hqp.Torque(holding=None, effort_limits=False), deadline=np.inf).session(robot, 0.002)
    base = rng.normal(size=6) * 0.1
    q = robot.integrate(robot.home, np.concatenate((base, 0.1 * rng.normal(size=robot.nv - 6))), 1.0)
    for k in range(3):
        state = robot.state(q)
        push = [0.3, -0.4, 0.1 * k]
        refs = [element.at(share), Com(name="com", law=PD(0.0, 0.0)).at(state.com(), acceleration=push)]
        tick = run.step(state, *refs)
        assert tick.status.solved, tick.notes
    one, other = wrenches(run, state, tick.solution.x, element.middles)
    np.testing.assert_allclose((1.0 - share) * other, share * one, atol=1e-5 * np.abs(one + other).max())
    a = state.com_jacobian() @ run.program.acceleration(tick.solution.x) + state.com_drift()
    np.testing.assert_allclose((one + other)[:3], robot.mass * (a - robot.gravity), atol=1e-6 * robot.mass)


def test_the_motion_is_that_of_the_stack_without(robot: Robot) -> None:
    """The level has six components that no motion needs: all residuals above it stay zero."""
    run = hqp.Controller(stack(), hqp.Torque(holding=None), deadline=np.inf).session(robot, 0.002)
    state = robot.state(robot.home)
    run.step(state)
    for share in (0.3, 0.5, 0.7):
        tick = run.step(state, SHARE.at(share))
        assert tick.status is Status.OPTIMAL
        assert all(np.abs(w).max(initial=0.0) < 1e-6 for w in tick.solution.residuals)


def test_a_share_beyond_the_limits_gives_way_to_them(robot: Robot) -> None:
    """With the centre of mass between the feet, one foot cannot bear the whole load: it bears up to the limit of its
    sole."""
    run = hqp.Controller(stack(), hqp.Torque(holding=None), deadline=np.inf).session(robot, 0.002)
    state = robot.state(robot.home)
    run.step(state)
    tick = run.step(state, SHARE.at(0.0))
    assert tick.status is Status.OPTIMAL
    found = run.program.contact_forces(tick.solution.x)
    right, left = found["r_sole"][2], found["l_sole"][2]
    assert 0.0 < right < 0.45 * left
    assert all(np.abs(w).max(initial=0.0) < 1e-6 for w in tick.solution.residuals[:-1])
    assert np.abs(tick.solution.residuals[-1]).max() > 1.0


def test_middles_are_those_of_the_soles(robot: Robot) -> None:
    (found,) = [e for e in stack() if isinstance(e, LoadShare)]
    ready = found.among(tuple(stack()))
    assert isinstance(ready, LoadShare)
    np.testing.assert_allclose(ready.middles, ((0.0575, 0.01), (0.0575, -0.01)))


def test_what_is_no_share_is_refused_or_told(robot: Robot) -> None:
    for wrong in (("a",), ("a", "a"), "ab", ("a", 3)):
        with pytest.raises(DeclarationError, match="two contacts"):
            LoadShare(contacts=wrong)  # type: ignore[arg-type]
    with pytest.raises(DeclarationError, match="from 0 up, at most 1"):
        LoadShare(contacts=SOLES, share=1.5)
    with pytest.raises(DeclarationError, match="share"):
        SHARE.at([0.1, 0.2])
    nowhere = Stack(Level(LoadShare(contacts=("l_sole", "hand"))), subject_to=[FixedContact(frame=f) for f in SOLES])
    with pytest.raises(DeclarationError, match="hand"):
        hqp.Controller(nowhere, hqp.Torque()).session(robot, 0.002)
    point = [FixedContact(frame="l_sole"), FixedContact(frame="r_sole"), PointContact(frame="r_palm")]
    pair = Stack(Level(LoadShare(contacts=("l_sole", "r_palm"))), subject_to=point)
    with pytest.raises(DeclarationError, match="a face"):
        hqp.Controller(pair, hqp.Torque()).session(robot, 0.002)
    run = hqp.Controller(stack(), hqp.Torque(holding=None), deadline=np.inf).session(robot, 0.002)
    run.step(robot.state(robot.home))
    tick = run.step(robot.state(robot.home), hqp.Reference("load_share", np.array([np.nan])))
    assert tick.status is Status.INVALID_REFERENCE
    assert np.isfinite(tick.command).all()


def test_it_is_written_and_read() -> None:
    declared = stack()
    assert serial.loads(serial.dumps(declared)) == declared


@pytest.mark.parametrize("angle", [0.2, 1.0, 1.57])
def test_below_a_trunk_far_off_posture_and_share_are_at_their_best(robot: Robot, angle: float) -> None:
    """Two unpriced levels below an unmet one: the share must not take motion from the posture."""
    trunk = Orientation(frame="pelvis", name="trunk")
    session = hqp.Controller(stack(), hqp.Torque(), deadline=np.inf).session(robot, dt=0.002)
    turned = np.array([[np.cos(angle), -np.sin(angle), 0.0], [np.sin(angle), np.cos(angle), 0.0], [0.0, 0.0, 1.0]])
    goal = turned @ robot.state().rotation("pelvis")
    for _ in range(3):
        tick = session.step(robot.state(), trunk.at(goal))
    assert tick.status.solved
    assert tick.solution is not None
    points = tick.solution.stage_points
    assert hqp.certificate(session.problem, tick.solution.x, 1e-8, points).ok


def test_targets_of_forces_go_into_native_ticks(robot: Robot) -> None:
    """The answer is that of a first tick with this share; without a reference it is s again."""
    session = hqp.Controller(stack(), hqp.Torque(), deadline=np.inf).session(robot, 0.002)
    for _ in range(3):
        session.step(robot.state())
    for share in (0.2, 0.8, None, 0.3):
        given = [] if share is None else [SHARE.at(share)]
        tick = session.step(robot.state(), *given)
        first = hqp.Controller(stack(), hqp.Torque(), deadline=np.inf).session(robot, 0.002)
        np.testing.assert_allclose(tick.x, first.step(robot.state(), *given).x, atol=1e-6)
    told = session.step(robot.state(), SHARE.at(np.nan))
    assert told.status is Status.INVALID_REFERENCE
