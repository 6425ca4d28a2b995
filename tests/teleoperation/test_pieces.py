"""Parts of Follow alone: motion fitted to packets, pursuit of a target, values that can be followed."""

from __future__ import annotations

import math
from types import SimpleNamespace
from typing import Any

import numpy as np
import pytest

import hqp
from hqp import Follow
from hqp.errors import DeclarationError
from hqp.tasks import JointLimits, Orientation, Pose, Position, Posture
from hqp.teleoperation.pursuit import Pursuit
from hqp.teleoperation.spaces import Space
from hqp.teleoperation.track import ABRUPT, SLACK, Cubic, Sample, Track

VECTOR = Space(Position(frame="tool0"))


@pytest.mark.parametrize("jerk", [0.0, 20.0, -40.0])
def test_a_motion_of_constant_jerk_is_predicted(jerk: float) -> None:
    def path(t: float) -> Any:
        return np.array([0.3 * t, 0.5 * t * t, jerk * t**3 / 6.0])

    times = np.arange(0.0, 0.4, 1.0 / 90.0).tolist()
    motion = Cubic(VECTOR, [Sample(t, path(t)) for t in times])
    for ahead in (0.0, 0.03, 0.06):
        x, _, _ = motion.after(ahead)
        assert np.abs(motion.value + x - path(times[-1] + ahead)).max() < 2e-3 * (1.0 + abs(jerk)) * (0.05 + ahead)


@pytest.mark.parametrize("seed", range(5))
def test_the_fit_is_that_of_weighted_least_squares(seed: int) -> None:
    """Judged by ``lstsq`` over Taylor's coefficients: weights that fall to 0 at 0.3 s, ordinary rates."""
    draw = np.random.default_rng(seed)
    times = np.sort(draw.uniform(0.0, 0.28, draw.integers(4, 12)))
    values = draw.normal(size=(times.size, 3))
    motion = Cubic(VECTOR, [Sample(float(t), y) for t, y in zip(times, values, strict=True)])
    tau = times - times[-1]
    columns = np.stack([tau**k / math.factorial(k) for k in range(4)], axis=1)
    root = np.sqrt(1.0 + tau / 0.3)[:, None]
    prior = np.diag([0.0, 1e-3 / 2.0, 1e-3 / 10.0, 1e-3 / 300.0])
    left, right = np.vstack([root * columns, prior]), np.vstack([root * (values - values[-1]), np.zeros((4, 3))])
    fitted = np.linalg.lstsq(left, right, rcond=None)[0]
    assert np.allclose(motion.motion, fitted, rtol=1e-5, atol=1e-5 * np.abs(fitted).max())
    for ahead in (-0.05, 0.0, 0.08):
        x, v, a = motion.after(ahead)
        assert np.allclose(
            x, [ahead**k / math.factorial(k) for k in range(4)] @ fitted, atol=1e-4 * np.abs(fitted).max()
        )
        after, before = motion.after(ahead + 1e-4), motion.after(ahead - 1e-4)
        assert np.allclose(v, (after[0] - before[0]) / 2e-4, atol=1e-6 * np.abs(fitted).max())
        assert np.allclose(a, (after[1] - before[1]) / 2e-4, atol=1e-6 * np.abs(fitted).max())


def test_a_pursuit_that_stops_brakes_within_its_limits() -> None:
    pursuit = Pursuit(VECTOR, np.zeros(3), (1.0, 1.0), (4.0, 4.0))
    target, speed, still = np.array([2.0, 0.0, 0.0]), np.zeros(3), np.zeros(3)
    for _ in range(150):
        pursuit.step(0.002, target, speed, still)
    begun, fast = pursuit.value.copy(), pursuit.v[0]
    assert fast > 0.3
    for _ in range(1000):
        before = pursuit.v.copy()
        pursuit.stop(0.002)
        assert np.abs(pursuit.v - before).max() <= 4.0 * 0.002 + 1e-12
    assert np.abs(pursuit.v).max() < 1e-6
    assert begun[0] < pursuit.value[0] < begun[0] + 3.0 * fast * fast / 4.0


@pytest.mark.parametrize("element", [JointLimits(), SimpleNamespace(at=print), object(), None])
def test_only_tasks_with_a_reference_are_followed(element: Any) -> None:
    with pytest.raises(DeclarationError, match="cannot be followed"):
        Space(element)


def test_a_clutch_that_closes_in_a_tick_without_a_state_takes_the_reference() -> None:
    robot = hqp.robots.load("ur5")
    hand = Pose(frame="tool0")
    follow = Follow(hand, clutch=True)
    state = robot.state(robot.home)
    follow.reference(state, now=0.0)
    first = np.array(hand.value(state))
    for k in range(1, 60):
        t = 0.01 * k
        value = first.copy()
        value[0, 3] += 0.1 * t
        follow.receive(value, sent=t, received=t, engaged=k > 10)
        state = robot.state(np.full(robot.nq, np.nan) if 5 < k < 40 else robot.home)
        found = follow.reference(state, now=t).value
        assert found is not None
        assert np.isfinite(found).all()
        assert np.abs(found - first).max() < 0.1
        last = np.array(found)
    assert math.dist(last[:3, 3], first[:3, 3]) > 0.01


@pytest.mark.parametrize(
    ("element", "turning"),
    [
        (Position(frame="tool0"), [False] * 3),
        (Orientation(frame="tool0"), [True] * 3),
        (Pose(frame="tool0"), [False] * 3 + [True] * 3),
        (Posture(), [True] * 3),
    ],
)
def test_rows_that_turn_are_those_in_radians(element: Any, turning: list[bool]) -> None:
    assert Space(element).turns(len(turning)).tolist() == turning


@pytest.mark.parametrize("share", [0.9, 1.1])
def test_a_hand_reaches_what_an_abrupt_acceleration_reaches(share: float) -> None:
    """A resting hand, then a packet off by share (slack + a tau^2 / 2): taken inside, a rival outside."""
    track, tau = Track(VECTOR, (1.0, 1.0)), 0.05
    for k in range(10):
        assert track.take(Sample(0.01 * k, np.zeros(3))) == 0.0
    off = share * (SLACK[0] + 0.5 * ABRUPT[0] * tau**2)
    found = track.take(Sample(0.09 + tau, np.array([0.0, off, 0.0])))
    assert found == (0.0 if share < 1.0 else pytest.approx(off))


@pytest.mark.parametrize("distance", [0.2, 1.0, 3.0])
def test_a_pursuit_arrives_soon_and_does_not_pass_its_target(distance: float) -> None:
    """From rest to rest at an acceleration a it takes at least 2 sqrt(d / a); braking counts on a share of a."""
    most, still, dt = 4.0, np.zeros(3), 0.002
    pursuit, target = Pursuit(VECTOR, np.zeros(3), (100.0, 100.0), (most, most)), np.array([distance, 0.0, 0.0])
    least = 2.0 * math.sqrt(distance / most)
    way = []
    for _ in range(math.ceil((1.4 * least + 0.3) / dt)):
        pursuit.step(dt, target, still, still)
        way.append(pursuit.value[0])
    assert max(way) < 1.01 * distance
    assert way[-1] == pytest.approx(distance, rel=0.02)


@pytest.mark.parametrize("period", [0.01, 0.033, 0.1])
def test_a_pursuit_in_long_periods_is_that_in_short_ones(period: float) -> None:
    """A target that accelerates; periods are divided, so that both paths differ by their integration alone."""
    acceleration = np.array([0.4, -0.2, 0.1])
    coarse, fine = (Pursuit(VECTOR, np.zeros(3), (2.0, 2.0), (6.0, 6.0)) for _ in range(2))
    for k in range(1, round(1.0 / period) + 1):
        for pursuit, parts in ((coarse, 1), (fine, round(period / 0.001))):
            for i in range(1, parts + 1):
                t = (k - 1 + i / parts) * period
                target = np.array([0.1, 0.05, 0.0]) + 0.5 * acceleration * t * t
                pursuit.step(period / parts, target, acceleration * t, acceleration)
        assert np.abs(coarse.value - fine.value).max() < 2e-3
    assert np.abs(coarse.v - fine.v).max() < 0.02
