"""Parts of the experiments that need no simulation."""

from __future__ import annotations

import json
import math
from pathlib import Path

import numpy as np
import pytest

import hqp.robots
from benchmarks import experiments
from benchmarks.lab.curves import figure_eight, response, rms, smooth
from benchmarks.lab.outcome import Figure, Outcome, holds
from benchmarks.lab.recorder import Recorder
from benchmarks.sentis2012.experiments.ground import UP, ContactNormals, Heading, Odometry
from benchmarks.sentis2012.experiments.human import SpringHand, Walk
from hqp.robots.on_mujoco import Contacts


@pytest.mark.parametrize(
    ("figure", "passed"),
    [
        (Figure("a", 1.0, high=1.0), True),
        (Figure("a", 1.0 + 1e-12, high=1.0), False),
        (Figure("a", math.nan, high=1.0), False),
        (Figure("a", math.nan), False),
        (Figure("a", math.inf), True),
        (Figure("a", 0.5, low=0.4, high=0.6), True),
        (holds("a", True), True),
        (holds("a", True, wanted=False), False),
    ],
)
def test_a_figure_passes_only_inside_its_limits(figure: Figure, passed: bool) -> None:
    assert figure.passed is passed
    outcome = Outcome("x", [figure])
    assert outcome.passed is passed
    assert (figure.cells()[0] == "FAIL") is not passed
    assert json.loads(json.dumps(outcome.plain()))["passed"] is passed


def test_smooth_starts_and_ends_at_rest() -> None:
    s = np.linspace(0.0, 1.0, 100001)
    values = np.array([smooth(x) for x in s])
    rate = np.gradient(values, s)
    assert values[0] == 0.0
    assert values[-1] == 1.0
    assert abs(rate[0]) < 1e-4
    assert abs(rate[-1]) < 1e-4
    assert (np.diff(values) >= 0.0).all()


def test_response_finds_gain_and_lag() -> None:
    t = 0.002 * np.arange(10000)
    w = 2.0 * math.pi * 0.2
    wanted = np.sin(w * t)
    actual = 0.868 * np.sin(w * (t - 0.433)) + 0.3 * np.exp(-t)
    gain, lag = response(t, wanted, actual, 0.2)
    assert gain == pytest.approx(0.868, abs=2e-3)
    assert lag == pytest.approx(0.433, abs=2e-3)


def test_figure_eight_closes() -> None:
    np.testing.assert_allclose(figure_eight(20.0, 0.1, 0.06, 0.1), np.zeros(3), atol=1e-12)
    assert figure_eight(12.5, 0.1, 0.06, 0.1)[1] == pytest.approx(0.1)
    assert rms(np.array([[3.0, 4.0], [0.0, 0.0]])) == pytest.approx(math.sqrt(12.5))


def test_walk_is_smooth_and_returns() -> None:
    walk = Walk(speed=0.35, distance=0.9, start=1.0, easing=1.5, stop=2.0)
    t = np.linspace(0.0, walk.end + 1.0, 20001)
    x, v = np.array([walk.at(s) for s in t]).T
    np.testing.assert_allclose(np.gradient(x, t)[1:-1], v[1:-1], atol=2e-4)
    assert x.max() == pytest.approx(0.9)
    assert v.max() == pytest.approx(0.35)
    assert x[-1] == pytest.approx(0.0)
    assert np.abs(np.diff(v) / np.diff(t)).max() < 0.35 / 1.5 + 1e-6
    assert Walk(back=False).at(100.0) == (0.9, 0.0)


def test_spring_hand_pulls_in_the_plane_up_to_its_cap() -> None:
    hand, walk = SpringHand(stiffness=200.0, damping=100.0, cap=50.0), Walk(start=0.0)
    still = hand.force(walk, -1.0, np.zeros(3), np.array([0.1, -0.05, 0.3]), np.zeros(3))
    np.testing.assert_allclose(still, [-20.0, 10.0, 0.0])
    hard = hand.force(walk, -1.0, np.zeros(3), np.array([3.0, 4.0, 0.0]), np.zeros(3))
    np.testing.assert_allclose(hard, [-30.0, -40.0, 0.0])
    aside = SpringHand(direction=math.pi / 2).force(walk, 1e3, np.zeros(3), np.zeros(3), np.zeros(3))
    assert abs(aside[0]) < 1e-9


def test_odometry_inverts_rolling() -> None:
    """Wheel rates from the library's wheel constraints at a random motion on the ground reproduce the motion."""
    from hqp.tasks import OmniWheelContact

    robot = hqp.robots.load("dreamer")
    odometry, rng = Odometry(robot), np.random.default_rng(3)
    v = np.zeros(robot.nv)
    v[[0, 1, 5]] = rng.standard_normal(3)
    state = robot.state()
    for wheel, column in zip(robot.wheels, robot.joints("wheels"), strict=True):
        J = OmniWheelContact(wheel=wheel).jacobian(state)[0]
        v[column] = -(J @ v) / J[column]
    np.testing.assert_allclose(odometry.velocity(v), [v[0], v[1], 0.0], atol=1e-12)
    np.testing.assert_allclose(odometry.slip(v), 0.0, atol=1e-12)


@pytest.mark.parametrize("wheel", range(3))
def test_odometry_does_not_follow_a_wheel_that_spins(wheel: int) -> None:
    robot = hqp.robots.load("dreamer")
    odometry, wheels = Odometry(robot), robot.joints("wheels")
    v = np.zeros(robot.nv)
    for speed in np.linspace(0.0, 0.5, 100):  # along x, without rotation
        v[wheels] = [speed * np.cross(w.axle, UP)[0] / w.radius for w in robot.wheels.values()]
        np.testing.assert_allclose(odometry.velocity(v), [speed, 0.0, 0.0], atol=1e-12)
        assert odometry.contradiction < 1e-12
    v[wheels[wheel]] += 100.0
    np.testing.assert_allclose(odometry.velocity(v), [0.5, 0.0, 0.0], atol=1e-12)
    assert odometry.contradiction > 1.0
    v[wheels] += [100.0, -250.0, 400.0]  # all wheels: the last value stays
    np.testing.assert_allclose(odometry.velocity(v), [0.5, 0.0, 0.0], atol=1e-12)


def test_contact_normals_are_low_passed_by_load_and_upright_without() -> None:
    normals = ContactNormals(2, period=0.002, time_constant=0.01, least_load=10.0)
    tilted = np.array([-math.sin(0.1), 0.0, math.cos(0.1)])
    contacts = Contacts(np.zeros((2, 3)), np.array([200.0, 0.0]), np.array([tilted, [0, 0, 0]]), np.zeros((2, 3)))
    first = normals.update(contacts)
    np.testing.assert_allclose(first[1], UP)
    assert 0.0 < -first[0, 0] < math.sin(0.1)
    for _ in range(200):
        last = normals.update(contacts)
    expected = 200.0 * tilted + 10.0 * UP
    np.testing.assert_allclose(last[0], expected / np.linalg.norm(expected), atol=1e-9)
    np.testing.assert_allclose(np.linalg.norm(last, axis=1), 1.0)
    lifted = Contacts(np.zeros((2, 3)), np.zeros(2), np.zeros((2, 3)), np.zeros((2, 3)))
    for _ in range(100):
        last = normals.update(lifted)
    np.testing.assert_allclose(last, [UP, UP], atol=1e-6)


def test_heading_turns_to_where_it_is_led_and_not_backwards() -> None:
    heading = Heading(1.0, rate=0.6, period=0.002)
    rates = np.array([heading.update(np.array([0.3, 0.0])) for _ in range(4000)])
    assert rates.min() == pytest.approx(-0.6)
    assert heading.yaw == pytest.approx(0.0, abs=1e-2)
    assert 0.002 * rates.sum() == pytest.approx(heading.yaw - 1.0)
    for velocity in ([-0.3, 0.0], [0.0, 0.05]):  # backwards; too slow
        settled = Heading(0.0, rate=0.6, period=0.002)
        assert [settled.update(np.array(velocity)) for _ in range(2000)] == [0.0] * 2000
    kept = Heading(1.0, rate=0.0, period=0.002)
    assert all(kept.update(np.array([0.3, 0.0])) == 0.0 for _ in range(1000))
    assert kept.yaw == 1.0


def test_log_survives_the_disk(tmp_path: Path) -> None:
    log = Recorder()
    for i in range(3):
        log.add(t=0.1 * i, com=np.array([i, 2.0]))
        log.add_to_last(load=float(i))
    path = log.save(tmp_path / "deep" / "log.npz", {"gain": 2.0})
    with np.load(path) as stored:
        np.testing.assert_array_equal(stored["com"], log["com"])
        assert stored["load"].shape == (3,)
        assert json.loads(str(stored["parameters"])) == {"gain": 2.0}


def test_renderer_is_chosen_without_one(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.delenv("MUJOCO_GL", raising=False)
    monkeypatch.delenv("DISPLAY", raising=False)
    monkeypatch.setattr("sys.platform", "linux")
    monkeypatch.setattr("ctypes.util.find_library", lambda name: None)
    assert experiments.choose_renderer() == "disable"
    monkeypatch.delenv("MUJOCO_GL", raising=False)
    monkeypatch.setattr("ctypes.util.find_library", lambda name: "x" if name == "OSMesa" else None)
    assert experiments.choose_renderer() == "osmesa"
    monkeypatch.delenv("MUJOCO_GL", raising=False)
    monkeypatch.setenv("DISPLAY", ":0")
    assert experiments.choose_renderer() == ""
