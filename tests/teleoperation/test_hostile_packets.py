"""Streams of random packets, most of them bad: the loop that follows them continues at bounded speed."""

from __future__ import annotations

import itertools
from typing import Any

import numpy as np
import pytest

import hqp
from hqp import Follow
from hqp.tasks import Com, LookAt, Orientation, Pose, Position, Posture
from hqp.teleoperation.spaces import Space
from hqp.teleoperation.track import WINDOW, Cubic, Sample

DT = 0.002
ELEMENTS: tuple[Any, ...] = (
    Pose(frame="tool0"), Position(frame="tool0"), Orientation(frame="tool0"), Position(frame="tool0", axes="xz"),
    Orientation(frame="tool0", axes=("yaw", "pitch")), Com(axes="xy"), Posture(), LookAt(frame="tool0"),
)  # fmt: skip
NUMBERS: tuple[Any, ...] = (
    0.0, -1.0, 1e-300, 1e12, -1e12, 1e15, 1e308, -1e308, float("nan"), float("inf"), -float("inf"), 10**400, "abc",
    "1.0", "", b"x", None, True, [], [1.0], [1.0, 2.0], {}, np.zeros(2), np.float32(0.1), 1j, object(),
)  # fmt: skip
VALUES: tuple[Any, ...] = (
    *NUMBERS, np.zeros(3), np.full(3, 1e308), np.full(3, 1e200), np.full((4, 4), np.nan), np.zeros((4, 4)),
    [[1], [2, 3]],
    np.eye(3), np.eye(4), np.diag([1.0, -1.0, -1.0, 1.0]), np.diag([-1.0, 1.0, 1.0, 1.0]), (np.zeros(3), np.zeros(4)),
    (np.full(3, 1e150), [0, 0, 0, 1e-160]), [10**400] * 3, np.full(6, 1e9), "x" * 1000, {"position": 1}, [None] * 3,
)  # fmt: skip


@pytest.fixture(scope="module")
def robot() -> Any:
    return hqp.robots.load("ur5")


def run(robot: Any, seed: int) -> None:
    """One stream of 40 ticks and 0 to 3 packets a tick; times jump now and then, by up to years."""
    rng = np.random.default_rng((seed, 48))
    element = ELEMENTS[rng.integers(len(ELEMENTS))]
    clutched = bool(rng.random() < 0.5)
    follow = Follow(element, clutch=clutched, max_age=float(rng.choice([0.01, 0.1, 2.0])))
    state = robot.state(robot.home)
    bad, far = rng.choice([0.05, 0.3, 0.9]), rng.choice([0.0, 0.05])
    space, home = Space(element), np.array(element.value(state))
    k = space.minus(home, home).size
    shown, now, clock, before = home, 0.0, float(rng.choice([0.0, -77.0, 1.7e9])), None
    for _ in range(40):
        step = DT if rng.random() > far else float(rng.choice([0.2, 1.0, 60.0, 1e5, -0.5, -1e5]))
        now += step
        for _ in range(rng.integers(4)):
            shown = space.plus(shown, 0.01 * rng.standard_normal(k))
            told: dict[str, Any] = {"value": shown, "sent": now + clock, "received": now, "engaged": rng.random() < 0.7}
            told["engaged"] = bool(told["engaged"])
            if rng.random() < 0.2:
                told["age"], told["sent"] = 0.01, None
            for key, kinds in (("value", VALUES), *((key, NUMBERS) for key in ("sent", "age", "received", "engaged"))):
                if rng.random() < bad / 3.0:
                    told[key] = kinds[rng.integers(len(kinds))]
            follow.receive(told.pop("value"), **told)
        at = now if rng.random() > 0.1 * bad else NUMBERS[rng.integers(len(NUMBERS))]
        reference = follow.reference(state, now=at)
        assert reference.value is not None
        assert np.isfinite(reference.value).all()
        assert reference.velocity is not None
        assert np.linalg.norm(reference.velocity) < 1.01 * np.hypot(2.0, 2.0 * np.pi)
        if before is not None and not isinstance(element, Orientation):
            assert np.linalg.norm(space.minus(reference.value, before)) < 0.1 * 1.01 * np.hypot(2.0, 2.0 * np.pi)
        before = reference.value


@pytest.mark.long
@pytest.mark.filterwarnings("error")
def test_no_stream_ends_the_loop(robot: Any) -> None:
    for seed in range(100):
        run(robot, seed)


@pytest.mark.slow
@pytest.mark.filterwarnings("error")
def test_no_stream_of_two_thousand_ends_the_loop(robot: Any) -> None:
    for seed in range(2000):
        run(robot, seed)


def test_samples_older_than_the_window_count_for_nothing() -> None:
    """Older samples do not change the cubic, and its normal matrix has no negative weight."""
    space, rng = Space(Position(frame="tool0")), np.random.default_rng(0)
    for _ in range(50):
        new = [Sample(float(t), rng.normal(size=3)) for t in np.sort(rng.uniform(5.0 - 0.99 * WINDOW, 5.0, 4))]
        limit = new[-1].time - 1.001 * WINDOW
        old = [Sample(float(limit - t), rng.normal(size=3)) for t in np.sort(rng.choice([0.0, 0.1, 2.0, 1e9], 3))[::-1]]
        assert np.array_equal(Cubic(space, [*old, *new]).motion, Cubic(space, new).motion)


@pytest.mark.parametrize("first", [0.0, 60.0, -1e5, 1e5])
def test_a_hand_is_followed_after_one_packet_and_silence(robot: Any, first: float) -> None:
    """One packet with a distant stamp, a minute of silence, then regular packets: the hand arrives within 0.5 s."""
    hand, state = Position(frame="tool0"), robot.state(robot.home)
    follow, home = Follow(hand), hand.value(state)
    follow.receive(home, sent=60.0 - first, received=0.0)
    follow.reference(state, now=0.0)
    for i in range(36):
        t = 60.0 + i / 72.0
        follow.receive(home + [0.0, 0.0, 0.01], sent=t, received=t)
        reference = follow.reference(state, now=t)
    assert reference.value == pytest.approx(home + [0.0, 0.0, 0.01], abs=1e-3)


def test_a_hand_that_moved_is_found_again_after_a_silence(robot: Any) -> None:
    """The motion before a minute of silence is not extrapolated: the hand is accepted at its new place."""
    hand, state = Position(frame="tool0"), robot.state(robot.home)
    follow, home = Follow(hand), hand.value(state)
    rng = np.random.default_rng(0)
    for i, t in itertools.chain(enumerate(np.arange(0.0, 0.5, 1 / 72)), enumerate(np.arange(60.0, 61.0, 1 / 72))):
        follow.receive(home + (t < 1.0) * 0.01 * i * rng.standard_normal(3), sent=float(t), received=float(t))
        reference = follow.reference(state, now=float(t))
    assert reference.value == pytest.approx(home, abs=1e-3)


def test_a_packet_of_the_future_holds_up_no_other(robot: Any) -> None:
    hand, state = Position(frame="tool0"), robot.state(robot.home)
    follow, home = Follow(hand), hand.value(state)
    for received in (1e300, float("nan"), "x", 5.0):
        follow.receive(home, sent=0.0, received=received)
    for i in range(3):
        follow.receive(home, sent=0.01 * i, received=0.01 * i)
    remarks = follow.reference(state, now=0.02).remarks
    assert len(remarks) == 2
    assert all("received" in remark for remark in remarks)


def test_a_loop_goes_on_after_a_time_that_is_none(robot: Any) -> None:
    hand, state = Position(frame="tool0"), robot.state(robot.home)
    follow, home = Follow(hand), hand.value(state)
    for i in range(200):
        t = i * DT
        follow.receive(home + [0.0, 0.0, 0.01], sent=t, received=t)
        now: Any = {50: float("nan"), 60: 1e308, 70: "abc", 80: -1e308}.get(i, t)
        reference = follow.reference(state, now=now)
        assert any("now=" in remark for remark in reference.remarks) == (i in (50, 70))
    assert reference.value == pytest.approx(home + [0.0, 0.0, 0.01], abs=1e-4)


def test_an_invalid_first_state_keeps_the_hold_value(robot: Any) -> None:
    hand = Position(frame="tool0")
    follow, home = Follow(hand), hand.value(robot.state(robot.home))
    assert follow.reference(robot.state(np.full(robot.nq, np.nan)), now=0.0).value is None
    assert follow.reference(robot.state(robot.home), now=DT).value == pytest.approx(home)


def squeeze(follow: Follow, state: Any, begin: float, end: float, engaged: Any, home: Any) -> Any:
    """Packets at 72 Hz of a hand that moves ahead at 0.1 m/s; return the last reference."""
    for t in np.arange(begin, end, 1.0 / 72.0).tolist():
        told = {} if engaged is None else {"engaged": engaged}
        follow.receive(home + [0.1 * t, 0.0, 0.0], sent=t, received=t, **told)
        reference = follow.reference(state, now=t)
    return reference


@pytest.mark.parametrize("engaged", [None, False, "false", "true", 1, 0, [True], np.ones(2), object()])
def test_only_true_engages(robot: Any, engaged: Any) -> None:
    hand, state = Position(frame="tool0"), robot.state(robot.home)
    follow, home = Follow(hand, clutch=True), hand.value(state)
    assert squeeze(follow, state, 0.0, 0.5, engaged, home).value == pytest.approx(home)
    for begin, true in ((0.5, True), (1.2, np.bool_(True))):
        squeeze(follow, state, begin, begin + 0.1, False, home)
        assert squeeze(follow, state, begin + 0.1, begin + 0.7, true, home).value[0] > home[0] + 0.03


@pytest.mark.parametrize("silence", [0.15, 1.0, 100.0])
def test_silence_opens_the_clutch_until_a_new_squeeze(robot: Any, silence: float) -> None:
    hand, state = Position(frame="tool0"), robot.state(robot.home)
    follow, home = Follow(hand, clutch=True), hand.value(state)
    assert squeeze(follow, state, 0.0, 0.5, True, home).value[0] > home[0] + 0.03
    for t in np.arange(0.5, 0.5 + silence, max(0.01, silence / 100.0)).tolist():
        held = follow.reference(state, now=t)
    again = 0.5 + silence
    still = squeeze(follow, state, again, again + 0.5, True, home)
    assert still.value == pytest.approx(held.value, abs=1e-3)
    assert any("new squeeze" in remark for remark in still.remarks)
    squeeze(follow, state, again + 0.5, again + 0.6, False, home)
    assert squeeze(follow, state, again + 0.6, again + 1.2, True, home).value[0] > home[0] + 0.03


def test_a_clutch_that_is_disengaged_from_elsewhere_needs_a_new_squeeze(robot: Any) -> None:
    hand, state = Position(frame="tool0"), robot.state(robot.home)
    follow, home = Follow(hand, clutch=True), hand.value(state)
    held = squeeze(follow, state, 0.0, 0.5, True, home).value
    follow.disengage("another operator took over")
    assert "another operator took over" in follow.reference(state, now=0.5).remarks
    assert squeeze(follow, state, 0.51, 1.0, True, home).value == pytest.approx(held, abs=5e-3)
    squeeze(follow, state, 1.0, 1.1, False, home)
    assert squeeze(follow, state, 1.1, 1.6, True, home).value[0] > home[0] + 0.03
