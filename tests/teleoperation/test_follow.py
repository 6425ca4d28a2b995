"""References that Follow computes from packets, without a moving robot."""

from __future__ import annotations

import itertools
import math
import threading
from typing import Any

import numpy as np
import pytest

import hqp
from hqp import Follow, Level, Stack
from hqp.errors import DeclarationError
from hqp.estimation.rotations import exponential, quaternion_of
from hqp.tasks import Com, FixedContact, JointLimits, LookAt, Orientation, Pose, Position, Posture
from hqp.teleoperation.packets import Clock, packet
from hqp.teleoperation.spaces import Space, logarithm

DT = 0.002


@pytest.fixture(scope="module")
def robot() -> Any:
    return hqp.robots.load("ur5")


def drive(follow: Follow, state: Any, packets: list[tuple[float, Any, bool]], until: float) -> list[Any]:
    """References of all ticks; packets: time, value, true if engaged."""
    found, waiting = [], list(packets)
    for k in range(round(until / DT)):
        while waiting and waiting[0][0] <= k * DT:
            t, value, engaged = waiting.pop(0)
            follow.receive(value, sent=t, received=t, engaged=engaged)
        found.append(follow.reference(state, now=k * DT))
    return found


def stream(f: Any, until: float, begin: float = 0.0, rate: float = 72.0, engaged: bool = True) -> list[Any]:
    return [(t, f(t), engaged) for t in np.arange(begin, until, 1.0 / rate).tolist()]


def test_rotations_come_back_from_their_logarithm() -> None:
    rng = np.random.default_rng(0)
    for _ in range(200):
        w = rng.standard_normal(3)
        w *= rng.choice([1e-9, 1e-7, 1e-3, 1.0, np.pi - 1e-7, np.pi]) / np.linalg.norm(w)
        R = exponential(w)
        assert np.abs(exponential(np.array(logarithm(R.tolist()))) - R).max() < 1e-7


@pytest.mark.parametrize(
    "element",
    [
        Pose(frame="tool0"), Position(frame="tool0"), Position(frame="tool0", axes="xz"), Orientation(frame="tool0"),
        Orientation(frame="tool0", axes=("yaw", "pitch")), Com(axes="xy"), Pose(frame="tool0", relative_to="base_link"),
    ],
    ids=lambda e: f"{type(e).__name__} {getattr(e, 'axes', '')}",
)  # fmt: skip
def test_any_task_with_a_value_is_followed(robot: Any, element: Any) -> None:
    """The reference reaches the operator, its velocity is the rate of its value."""
    state = robot.state(robot.home)
    space, start = Space(element), element.value(state)
    k = space.minus(start, start).size
    goal = space.plus(start, np.linspace(0.02, 0.1, k))
    found = drive(Follow(element), state, stream(lambda t: goal, 1.5), 1.5)
    assert np.abs(space.minus(found[-1].value, goal)).max() < 1e-3
    for before, after in itertools.pairwise(found):
        rate = space.minus(after.value, before.value) / DT
        assert np.abs(rate - 0.5 * (before.velocity + after.velocity)).max() < 1e-3
        step = np.linalg.norm(after.velocity - before.velocity)
        assert step < 1.01 * DT * np.hypot(10.0, 10.0 * np.pi)
    stack = Stack(Level(element), subject_to=[JointLimits()])
    tick = hqp.Controller(stack, deadline=np.inf).session(robot, DT).step(state, found[-1])
    assert tick.status is hqp.Status.OPTIMAL


def test_an_angle_goes_the_short_way_round(robot: Any) -> None:
    yaw = Orientation(frame="tool0", axes="yaw")
    follow, state = Follow(yaw), robot.state(robot.home)
    drive(follow, state, stream(lambda t: 3.1, 1.5), 1.5)
    for k in range(100):
        t = 1.5 + 0.02 * k
        follow.receive(-3.1, sent=t, received=t)
        reference = follow.reference(state, now=t)
    assert np.remainder(reference.value[0] + 3.1 + np.pi, 2 * np.pi) - np.pi == pytest.approx(0.0, abs=1e-3)
    assert reference.value[0] > 3.0


def test_speed_and_acceleration_are_bounded(robot: Any) -> None:
    """A target accepted 1 m away: the speed keeps its limit, and the reference arrives without overshoot."""
    hand, state = Position(frame="tool0"), robot.state(robot.home)
    home = hand.value(state)
    follow = Follow(hand, largest_speed=0.5, largest_acceleration=2.0)
    found = drive(follow, state, stream(lambda t: home + [1.0, 0.0, 0.0], 4.0), 4.0)
    speeds = np.array([np.linalg.norm(r.velocity) for r in found])
    way = np.array([r.value[0] - home[0] for r in found])
    assert 0.49 < speeds.max() < 0.51
    assert np.abs(np.diff(speeds)).max() < 1.01 * 2.0 * DT
    assert way.max() < 1.002
    assert way[-1] == pytest.approx(1.0, abs=1e-3)
    assert any("faster than the reference may be" in remark for r in found for remark in r.remarks)


def test_a_clutch_holds_and_takes_up_without_a_jump(robot: Any) -> None:
    """Released, the hand moves 0.4 m away and turns; after it is engaged again, only later motion counts."""
    hand, state = Pose(frame="tool0"), robot.state(robot.home)
    home = hand.value(state)

    def operator(t: float) -> Any:
        pose = np.eye(4)
        pose[:3, 3] = (5.0, 1.0 * max(0.0, min(t, 1.6) - 1.0) ** 2, 0.1 * max(0.0, t - 2.0) ** 2)
        pose[:3, :3] = exponential(np.array([0.0, 0.0, 0.5 * max(0.0, min(t, 1.6) - 1.0)]))
        return pose

    packets = [(t, x, t < 0.9 or t >= 2.0) for t, x, _ in stream(operator, 3.0)]
    follow = Follow(hand, clutch=True)
    found = drive(follow, state, packets, 3.0)
    steps = [np.abs(after.velocity - before.velocity).max() for before, after in itertools.pairwise(found)]
    assert max(steps) < 5e-3
    for reference in found[:1000]:
        assert np.abs(reference.value - home).max() < 1e-3
    moved = found[-1].value
    assert moved[2, 3] - home[2, 3] == pytest.approx(0.1, abs=2e-3)
    assert np.abs(moved[:2, 3] - home[:2, 3]).max() < 1e-3
    assert np.abs(moved[:3, :3] - home[:3, :3]).max() < 1e-3
    assert any("clutch is open" in remark for remark in found[700].remarks)


@pytest.mark.parametrize("mirror", [False, True])
def test_scale_and_frame_of_the_operator(robot: Any, mirror: bool) -> None:
    """Half the distance, seen from the side, or in a mirror, which reverses the sense of rotations."""
    hand, state = Pose(frame="tool0"), robot.state(robot.home)
    home, F = hand.value(state), exponential(np.array([0.0, 0.0, 0.5 * np.pi]))
    if mirror:
        F = np.diag([1.0, -1.0, 1.0])
    shift, turn = np.array([0.1, 0.2, -0.1]), np.array([0.0, 0.0, 0.4])

    def operator(t: float) -> Any:
        u = min(max(t - 0.2, 0.0), 1.0)
        pose = np.eye(4)
        pose[:3, 3], pose[:3, :3] = (3.0 * u * u - 2.0 * u**3) * shift, exponential((3.0 * u * u - 2.0 * u**3) * turn)
        return pose

    follow = Follow(hand, clutch=True, scale=0.5, frame=F)
    last = drive(follow, state, stream(operator, 2.0), 2.0)[-1].value
    assert np.abs(last[:3, 3] - home[:3, 3] - 0.5 * F @ shift).max() < 1e-3
    want = exponential((-F if mirror else F) @ turn) @ home[:3, :3]
    assert np.abs(last[:3, :3] - want).max() < 1e-3


def test_absolute_poses_are_seen_in_the_operators_frame(robot: Any) -> None:
    hand, state = Pose(frame="tool0"), robot.state(robot.home)
    frame = np.eye(4)
    frame[:3, :3], frame[:3, 3] = exponential(np.array([0.0, 0.0, 0.7])), (0.1, 0.2, 0.3)
    pose = np.linalg.inv(frame) @ hand.value(state)
    pose[:3, 3] *= 2.0
    last = drive(Follow(hand, scale=0.5, frame=frame), state, stream(lambda t: pose, 0.5), 0.5)[-1]
    assert np.abs(last.value - hand.value(state)).max() < 1e-9


def test_the_sign_of_a_quaternion_says_nothing(robot: Any) -> None:
    hand, state = Pose(frame="tool0"), robot.state(robot.home)
    home = hand.value(state)
    q, signs = quaternion_of(home[:3, :3]), np.random.default_rng(0).choice([-1.0, 1.0], 200)
    packets = [(t, (home[:3, 3], signs[i] * q), True) for i, (t, _, _) in enumerate(stream(lambda t: None, 1.0))]
    for reference in drive(Follow(hand), state, packets, 1.0):
        assert np.abs(reference.value - home).max() < 1e-9
        assert not reference.remarks or reference.remarks == ("fewer than three consistent packets: held",)


@pytest.mark.parametrize(
    "value",
    [
        None,
        "left",
        np.zeros(3),
        np.full((4, 4), np.inf),
        np.diag([-1.0, 1.0, 1.0, 1.0]),
        (np.zeros(3), np.zeros(4)),
        {},
    ],
)
def test_what_is_no_pose_is_left_out_and_told(robot: Any, value: Any) -> None:
    hand, state = Pose(frame="tool0"), robot.state(robot.home)
    follow = Follow(hand)
    for t in (-0.03, -0.02, -0.01, 0.0):
        follow.receive(hand.value(state), sent=t, received=t)
    follow.receive(value, sent=0.01, received=0.01)
    follow.receive(hand.value(state), sent=float("nan"), received=0.02)
    reference = follow.reference(state, now=0.02)
    assert [remark[:16] for remark in reference.remarks] == ["packet discarded"] * 2
    assert np.abs(reference.value - hand.value(state)).max() < 1e-9
    tick = hqp.Controller(Stack(Level(hand)), deadline=np.inf).session(robot, DT).step(state, reference)
    assert [note.detail for note in tick.notes] == list(reference.remarks)


def test_a_clock_that_begins_anew_is_taken_up(robot: Any) -> None:
    hand, state = Position(frame="tool0"), robot.state(robot.home)
    home = hand.value(state)
    follow = Follow(hand)
    remarks: list[str] = []
    for k in range(1000):
        t = k * DT
        if k % 7 == 0:
            follow.receive(home + [0.0, 0.1 * t, 0.0], sent=t if t < 1.0 else t - 0.9, received=t)
        reference = follow.reference(state, now=t)
        remarks += reference.remarks
        assert abs(reference.value[1] - home[1] - 0.1 * t) < 0.02
    assert remarks.count("the sender's clock restarted") == 1


def test_clocks_that_drift_are_followed() -> None:
    rng, clock, hand = np.random.default_rng(0), Clock(), Position(frame="tool0")
    for k in range(6000):
        t = k / 72.0
        sent = 1.001 * t + 50.0
        late = t + 0.005 + rng.exponential(0.01)
        clock.take(packet(hand, np.zeros(3), sent, None, late, True))
        if k > 100:
            assert abs(clock.behind - (t + 0.005 - sent)) < 0.008


def test_packets_may_come_from_another_thread(robot: Any) -> None:
    hand, state = Position(frame="tool0"), robot.state(robot.home)
    follow, home = Follow(hand), hand.value(state)
    threads = [
        threading.Thread(target=lambda: [follow.receive(home, sent=0.001 * i) for i in range(2000)]) for _ in range(3)
    ]
    for thread in threads:
        thread.start()
    while any(thread.is_alive() for thread in threads):
        follow.reference(state)
    for thread in threads:
        thread.join()
    assert np.abs(follow.reference(state).value - home).max() < 1e-9


@pytest.mark.parametrize(
    ("element", "options", "told"),
    [
        (JointLimits(), {}, "cannot be followed"),
        (FixedContact(frame="tool0"), {"max_age": 0.0}, "max_age"),
        (Pose(frame="tool0"), {"largest_speed": -1.0}, "largest_speed"),
        (Pose(frame="tool0"), {"scale": float("nan")}, "scale"),
        (Pose(frame="tool0"), {"frame": np.ones((3, 3))}, "frame"),
        (Pose(frame="tool0"), {"frame": np.diag([1.0, -1.0, 1.0])}, "clutch=True"),
        (Pose(frame="tool0"), {"latency": -1.0}, "latency"),
        (LookAt(frame="tool0"), {"frame": "left"}, "frame"),
    ],
)
def test_declarations_are_checked(robot: Any, element: Any, options: dict[str, Any], told: str) -> None:
    with pytest.raises(DeclarationError, match=told):
        Follow(element, **options).reference(robot.state(robot.home), now=0.0)


FOLLOWED = [f(frame="tool0") for f in (Pose, Position, Orientation, LookAt)] + [Posture()]
BAD = (0.0, -1.0, math.nan, math.inf, "1")
NUMBERS = [{name: bad} for name in ("scale", "max_age", "largest_speed") for bad in BAD]
FRAMES = [np.eye(2), np.ones((3, 3)), np.full((3, 3), math.nan), np.diag([1.0, -1.0, 1.0]), "left"]


@pytest.mark.parametrize("element", FOLLOWED)
@pytest.mark.parametrize("options", [*NUMBERS, *({"frame": frame} for frame in FRAMES)])
def test_numbers_and_frames_are_refused_before_the_loop(element: Any, options: dict[str, Any]) -> None:
    with pytest.raises(DeclarationError):
        Follow(element, **options)
