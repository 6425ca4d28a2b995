"""Ticks of arrays match ``step`` with a State and References to the bit, in fewer calls."""

from __future__ import annotations

import pickle
from collections.abc import Callable
from dataclasses import dataclass
from typing import Any

import numpy as np
import pytest

import hqp
from hqp import Level, Stack, Status
from hqp.errors import DeclarationError, StaleState, UnknownReference
from hqp.robots import Robot
from hqp.solvers.lexicographic import kernel
from hqp.tasks import Com, FixedContact, JointLimits, Orientation, Pose, Position, Posture, TorqueLimits

pytestmark = pytest.mark.skipif(not kernel(), reason="no native kernel here")

HAND = Pose(frame="tool0", name="hand")


@dataclass(frozen=True, kw_only=True)
class Raised(Position):
    """User task that changes its target."""

    def at(self, value: Any = None, **given: Any) -> Any:
        return super().at(np.asarray(value) + [0.0, 0.0, 0.1], **given)


def arm(formulation: Any = None, *levels: Level) -> tuple[hqp.Session, hqp.Session]:
    """Two sessions, each on its own robot."""
    limit = TorqueLimits() if isinstance(formulation, hqp.Torque) else JointLimits()
    stack = Stack(*(levels or (Level(HAND),)), Level(Posture()), subject_to=[limit])
    controller = hqp.Controller(stack, formulation or hqp.Velocity(), deadline=np.inf)
    robot = hqp.robots.load("ur5")
    return controller.session(robot, 0.002), controller.session(robot.copy(), 0.002)


def both(pair: tuple[hqp.Session, hqp.Session], q: Any, v: Any, targets: dict[str, Any]) -> tuple[Any, Any]:
    """Run one tick of arrays and one of a state and references."""
    arrays, objects = pair
    state = objects.robot.state(q, v)
    given = [objects.stack.find(name).at(value) for name, value in targets.items()]
    return arrays.tick(q, v, targets), objects.step(state, *given)


def same(one: Any, other: Any) -> None:
    assert (one.status, one.held, one.count) == (other.status, other.held, other.count)
    assert one.notes == other.notes
    np.testing.assert_array_equal(one.command, other.command)
    np.testing.assert_array_equal(one.x, other.x)
    assert one.jump == other.jump
    np.testing.assert_array_equal(one.state.q, other.state.q)
    np.testing.assert_array_equal(one.state.v, other.state.v)


def circle(robot: Robot, t: float, size: float = 0.05) -> Any:
    pose = HAND.value(robot.copy().state()).copy()
    pose[:3, 3] += size * np.array([np.sin(t), 1.0 - np.cos(t), 0.5 * np.sin(2.0 * t)])
    return pose


@pytest.mark.parametrize("size", [0.05, 2.0], ids=["within reach", "out of reach"])
@pytest.mark.parametrize("formulation", [hqp.Velocity(), hqp.Acceleration(), hqp.Torque()])
def test_bits_are_those_of_step(formulation: Any, size: float) -> None:
    pair = arm(formulation)
    q, v, native = pair[0].robot.home, np.zeros(6), 0
    for k in range(60):
        targets = {"hand": circle(pair[0].robot, 0.05 * k, size)} if k % 7 else {}
        one, other = both(pair, q, v, targets)
        native += one._state is None
        moved, expected = one.advance(), other.advance()
        same(one, other)
        for a, b in zip(moved, expected, strict=True):
            np.testing.assert_allclose(a, b, rtol=0.0, atol=1e-14)
        q, v = moved
    assert native >= 58  # the check for stuck tasks needs the state


def test_a_humanoid() -> None:
    robot = hqp.robots.load("g1")
    feet = [FixedContact(frame=sole) for sole in robot.landmarks["soles"]]
    hand = Position(frame=robot.landmarks["palms"][0], name="palm")
    head = Orientation(frame=robot.landmarks["base"][0], name="trunk")
    stack = Stack(Level(Com(name="com")), Level(hand, head), Level(Posture()), subject_to=[*feet, JointLimits()])
    controller = hqp.Controller(stack, deadline=np.inf)
    pair = controller.session(robot, 0.002), controller.session(robot.copy(), 0.002)
    there, trunk = hand.value(robot.state()) + [0.05, 0.0, 0.1], head.value(robot.state())
    q, v = robot.home, np.zeros(robot.nv)
    for k in range(30):
        one, other = both(pair, q, v, {"palm": there, "trunk": trunk} if k < 20 else {"trunk": trunk})
        q, v = one.advance()
        same(one, other)
        np.testing.assert_allclose(q, other.advance()[0], rtol=0.0, atol=1e-14)


def test_what_is_out_of_the_ordinary_is_told_as_by_step() -> None:
    pair = arm(None, Level(HAND), Level(Raised(frame="wrist_1_link", name="wrist")))
    q, v = pair[0].robot.home, np.zeros(6)
    both(pair, q, v, {})
    bad = circle(pair[0].robot, 0.1)
    bad[0, 0] += 3e-5
    with pytest.raises(DeclarationError, match="hand"):
        pair[0].tick(q, v, {"hand": bad})
    with pytest.raises(DeclarationError, match="hand"):
        pair[0].tick(q, v, {"hand": np.zeros(3)})
    with pytest.raises(UnknownReference, match="wrsit"):
        pair[0].tick(q, v, {"wrsit": np.zeros(3)})
    pair = arm(None, Level(HAND), Level(Raised(frame="wrist_1_link", name="wrist")))
    home = q
    for at, rate, targets in (
        (q, v, {}),
        (q, v, {"wrist": [0.1, 0.2, 0.3]}),
        (np.array(q.tolist()), None, {"hand": circle(pair[0].robot, 0.1).tolist()}),
        (q.astype(np.float32), v, {}),
        (q + np.nan, v, {}),
        (q, v + 1e4, {}),
        (q, v, {"hand": circle(pair[0].robot, 0.1)}),
        (q + np.nan, v, {}),
        (q + np.inf, v, {}),
        (q[::-1][::-1], v, {}),
    ):
        same(*both(pair, at, rate, targets))
    with pytest.raises(hqp.errors.ModelError, match="needs q"):
        pair[0].tick(home[:5], v, {})


STORED: dict[str, Callable[[Any], Any]] = {
    "every other number": lambda a: np.repeat(a, 2, axis=-1)[..., ::2],
    "backwards": lambda a: np.ascontiguousarray(a[..., ::-1])[..., ::-1],
    "a column": lambda a: np.stack([a, a], axis=-1)[..., 0],
    "by columns": np.asfortranarray,
    "other bytes": lambda a: a.astype(">f8"),
    "long": lambda a: a.astype(np.longdouble),
    "objects": lambda a: a.astype(object),
    "a list": lambda a: a.tolist(),
    "readable": lambda a: np.frombuffer(a.tobytes()).reshape(a.shape),
}
"""Ways to store the same numbers."""


@pytest.mark.parametrize("dt", [np.float32(0.002), np.array(0.002), np.float64(0.002)], ids=repr)
def test_the_storage_of_a_period_does_not_matter(dt: Any) -> None:
    run, _ = arm()
    assert type(run.controller.session(run.robot.copy(), dt).dt) is float


@pytest.mark.parametrize("stored", STORED)
@pytest.mark.parametrize("formulation", [hqp.Velocity(), hqp.Torque()])
def test_the_storage_of_a_tick_does_not_matter(formulation: Any, stored: str) -> None:
    pair, change = arm(formulation), STORED[stored]
    q, pose = pair[0].robot.home, circle(pair[0].robot, 0.3)
    for k in range(4):
        v = np.linspace(-0.1, 0.1, 6) * k
        plain = pair[0].tick(q + 0.01 * k, v, {"hand": pose})
        other = pair[1].tick(change(q + 0.01 * k), change(v), {"hand": change(pose)})
        np.testing.assert_array_equal(plain.command, other.command)
        assert plain.status == other.status


def test_the_callers_arrays_are_read_and_no_more() -> None:
    """A later change of the caller's arrays alters neither held references nor finished ticks."""
    pair = arm()
    q, pose = pair[0].robot.home.copy(), circle(pair[0].robot, 0.3)
    for _ in range(3):
        tick = pair[0].tick(q, None, {"hand": pose})
    kept = tick.command.copy(), tick.state.q.copy()
    q += 1.0
    pose += 1.0
    np.testing.assert_array_equal(tick.command, kept[0])
    np.testing.assert_array_equal(tick.state.q, kept[1])
    for array in (tick.x, tick.before, tick.state.q):
        assert not array.flags.writeable


def test_states_from_before_become_stale() -> None:
    run, _ = arm()
    robot, q = run.robot, run.robot.home
    for _ in range(3):
        state = robot.state(q)
        tick = run.tick(q + 0.1)
        with pytest.raises(StaleState):
            state.position("tool0")
    latest = tick.state
    np.testing.assert_allclose(latest.position("tool0"), robot.copy().state(q + 0.1).position("tool0"), atol=1e-12)
    old, tick = tick, run.tick(q + 0.2)
    assert tick.explain()["hand"].residual >= 0.0
    tick = run.tick(q + 0.3)
    current = robot.state(q)
    assert old.state.q[0] == q[0] + 0.1
    assert tick.state.q[0] == q[0] + 0.3
    assert robot.current is current


def test_a_change_of_stack_knows_the_targets_of_the_latest_tick() -> None:
    pair = arm()
    q, v = pair[0].robot.home, np.zeros(6)
    more = pair[0].stack.without("hand")
    for k in range(5):
        both(pair, q, v, {"hand": circle(pair[0].robot, 0.1 * k)})
    for run in pair:
        run.change(more, 0.05)
    while True:
        one, other = both(pair, q, v, {})
        same(one, other)
        q, v = one.advance()
        if one.transition == 1.0:
            break
    for _ in range(25):
        same(*both(pair, q, v, {}))


def test_ticks_of_arrays_are_recorded_and_pickled(tmp_path: Any) -> None:
    run, _ = arm()
    q = run.robot.home
    for _ in range(3):
        tick = run.tick(q)
    kept = pickle.loads(pickle.dumps(tick))
    np.testing.assert_array_equal(kept.command, tick.command)
    np.testing.assert_array_equal(kept.state.q, q)
    recorder = run.record(ticks=5, on="never", to=tmp_path)
    for _ in range(5):
        assert run.tick(q).status is Status.OPTIMAL
    recorder.dump()
    recorder.wait()
    assert len(recorder.files) == 1
