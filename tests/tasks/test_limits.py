"""The box of the joint limits: never empty, never leads out, returns from outside; limits of motors."""

from __future__ import annotations

import math
from collections.abc import Callable
from types import SimpleNamespace
from typing import Any

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

import hqp
import hqp.robots
from hqp import PD, Level, P, Stack
from hqp.errors import DeclarationError, JointNotFound
from hqp.programs.formulation import Formulation
from hqp.tasks import JointLimits, Position, Posture, TorqueLimits
from hqp.tasks.limits import APPROACH


def robot_of(low: Any, high: Any, speed: Any) -> Any:
    """Minimal robot for limits: independent joints."""
    k = len(low)
    return SimpleNamespace(
        name="joints",
        nv=k,
        lower=np.array(low, dtype=float),
        upper=np.array(high, dtype=float),
        velocity_limit=np.array(speed, dtype=float),
        joints=lambda names: np.arange(k),
    )


def box(limits: JointLimits, robot: Any, dt: float, order: int = 1) -> Callable[[Any, Any], tuple[Any, Any]]:
    """(q, v) -> (lower, upper)."""

    def run(q: Any, v: Any) -> tuple[Any, Any]:
        state: Any = SimpleNamespace(
            robot=robot, angles=np.array(q, dtype=float), v=np.array(v, dtype=float), commanded=None
        )
        return limits.step_bounds(state, dt, order)

    return run


SCENES = st.fixed_dictionaries(
    {
        "dt": st.sampled_from([1e-3, 2e-3, 1e-2]),
        "speed": st.floats(0.1, 20.0) | st.just(math.inf),
        "span": st.floats(0.05, 6.0),
        "acceleration": st.none() | st.floats(0.5, 500.0).filter(lambda a: a != 50.0),
        "braking": st.none() | st.floats(0.5, 500.0),
        "margin": st.floats(0.0, 0.02),
        "order": st.sampled_from([1, 2]),
        "seed": st.integers(0, 2**32 - 1),
    }
)


def controls(rng: np.random.Generator, k: int, steps: int) -> Any:
    """Positions inside the box, 0 to 1: held at an end for a while, or random; the ends test the limits most."""
    held = rng.choice([0.0, 1.0], size=(steps // 20 + 1, k)).repeat(20, axis=0)[:steps]
    return np.where(rng.random((1, k)) < 0.7, held, rng.random((steps, k)))


def share(rng: np.random.Generator, k: int) -> Any:
    """The drawn value for the first of k joints, half of it or more for the others."""
    return np.concatenate(([1.0], rng.uniform(0.5, 1.0, k - 1)))


@pytest.mark.long
@settings(max_examples=40)
@given(SCENES)
def test_from_a_viable_state_limits_are_never_crossed(scene: dict[str, Any]) -> None:
    """Each joint has its own range and speed, up to the drawn ones."""
    rng, k, dt, a = np.random.default_rng(scene["seed"]), 24, scene["dt"], scene["acceleration"]
    b = min(a or math.inf, scene["braking"] or math.inf)
    high, speed = np.maximum(0.5 * scene["span"] * share(rng, k), 0.025), scene["speed"] * share(rng, k)
    low = -high
    limits = JointLimits(margin=scene["margin"], acceleration=a, braking=scene["braking"])
    bounds = box(limits, robot_of(low, high, speed), dt, scene["order"])
    low, high = low + scene["margin"], high - scene["margin"]
    q = rng.uniform(low, high)
    up = rng.random(k) < 0.5
    way = np.where(up, high - q, q - low)  # viable: on the braking curve, for any acceleration
    T, most = max(dt, 1.0 / APPROACH), min(b, 1e3)
    v = np.where(up, 1.0, -1.0) * np.minimum(most * (np.sqrt(T * T + 2.0 * way / most) - T), speed)
    for control in controls(rng, k, 400):
        lower, upper = bounds(q, v)
        if scene["order"] == 2:
            lower, upper = v + dt * lower, v + dt * upper
        rounding = 1e-12 * (1.0 + np.abs(v))
        assert np.all(lower <= upper + rounding), "the box is empty"
        lower, upper = np.maximum(lower, -1e3), np.minimum(upper, 1e3)
        u = lower + control * (upper - lower)
        assert np.all(np.abs(u) <= speed + 1e-9)
        if a is not None:
            assert np.all(np.abs(u - v) <= a * dt + 1e-9), "an acceleration beyond its limit"
        pushed = (control == 1.0) & (v >= 0.0) & (u < v) | (control == 0.0) & (v <= 0.0) & (u > v)
        assert np.all(np.abs(u - v)[pushed] <= b * dt + 1e-9), "a limit is met harder than the curve says"
        q, v = q + dt * u, u
        assert np.all((q >= low - 1e-9) & (q <= high + 1e-9)), "a position limit is crossed"


@pytest.mark.long
@settings(max_examples=30)
@given(SCENES, st.floats(0.2, 1.0))
def test_from_outside_joints_come_back_at_bounded_speed(scene: dict[str, Any], back: float) -> None:
    rng, k, dt, a = np.random.default_rng(scene["seed"]), 24, scene["dt"], scene["acceleration"]
    speed = scene["speed"] * share(rng, k)
    low, high = np.full(k, -1.0), np.full(k, 1.0)
    b = min(a or math.inf, scene["braking"] or math.inf)
    limits = JointLimits(acceleration=a, braking=scene["braking"], return_velocity=back)
    bounds = box(limits, robot_of(low, high, speed), dt)
    q, v = rng.choice([-1.0, 1.0], k) * rng.uniform(1.0, 1.05, k), np.zeros(k)
    settled = 0.05 / min(back, float(speed.min())) + (0.0 if a is None else 2.0 * back / a) + back / b
    settled += 16.0 * max(dt, 1.0 / APPROACH)  # the last part decays at the rate of approach
    for _ in range(int(settled / dt) + 20):
        lower, upper = bounds(q, v)
        assert np.all(lower <= upper)
        u = np.clip(0.0, lower, upper)  # the slowest velocity in the box
        assert np.all(np.abs(u) <= back + 1e-12)
        assert np.all((np.abs(v) - np.abs(u)) <= b * dt + 1e-12), "it comes to rest harder than the curve says"
        q, v = q + dt * u, u
    assert np.all(np.abs(q) <= 1.0 + 1e-7)


def test_box_by_hand() -> None:
    robot = robot_of([-1.0] * 4, [1.0] * 4, [2.0, 2.0, 2.0, math.inf])
    lower, upper = box(JointLimits(acceleration=None, braking=0), robot, 0.01)([0.0, 0.995, 1.1, -1.0], np.zeros(4))
    np.testing.assert_allclose(upper, [2.0, 0.5, -0.5, 200.0], atol=1e-12)
    np.testing.assert_allclose(lower, [-2.0, -2.0, -2.0, 0.0], atol=1e-12)
    lower, upper = box(JointLimits(acceleration=10.0, approach=0), robot, 0.01)(
        [0.0, 0.995, 1.1, -1.0], [1.0, 1.0, 1.0, 0.0]
    )
    viable = 10.0 * (math.sqrt(1e-4 + 2 * 0.005 / 10.0) - 0.01)
    # second joint: too fast to stop in time, so the end of the window nearest to the box; third: also outside
    np.testing.assert_allclose(upper, [1.1, max(viable, 0.9), 0.9, 0.1], atol=1e-12)
    np.testing.assert_allclose(lower, [0.9, 0.9, 0.9, 0.0], atol=1e-12)
    assert viable < 0.9
    slow = 2.0 * (math.sqrt(1e-4 + 2 * 0.005 / 2.0) - 0.01)
    lower, upper = box(JointLimits(acceleration=20.0, braking=2.0, approach=0), robot, 0.01)(
        [0.0, 0.995, 1.1, -1.0], np.zeros(4)
    )
    np.testing.assert_allclose(upper, [0.2, slow, -0.2, 0.2], atol=1e-12)
    np.testing.assert_allclose(lower, [-0.2, -0.2, -0.2, 0.0], atol=1e-12)
    for approach, T in ((0, 0.01), (20.0, 0.05), (1000.0, 0.01)):
        limits = JointLimits(acceleration=None, braking=2.0, approach=approach)
        lower, upper = box(limits, robot, 0.01)([0.0, 0.995, 1.001, 0.0], np.ones(4))
        near, slow, back = (2.0 * (math.sqrt(T * T + d) - T) for d in (1.0, 0.005, 0.001))
        np.testing.assert_allclose(upper, [near, slow, -back, near], atol=1e-12)


@pytest.mark.parametrize(("formulation", "most"), [(hqp.Acceleration(), 4.0), (hqp.Torque(), 2.0)])
def test_noise_at_a_limit_moves_the_command_a_little(formulation: Formulation, most: float) -> None:
    """Encoder noise of 0.1 mrad on a joint at its limit: a curve as steep as sqrt(d) would demand 50 rad/s^2."""
    robot, rng = hqp.robots.load("panda"), np.random.default_rng(0)
    posture = Posture(law=PD(25.0, 10.0))
    session = hqp.Controller(Stack(Level(posture), subject_to=[JointLimits()]), formulation, deadline=math.inf)
    run, (q, v), commands = session.session(robot, 0.001), (robot.home.copy(), np.zeros(robot.nv)), []
    beyond = robot.home.copy()
    beyond[1] = robot.upper[1] + 0.5
    for _ in range(4000):
        measured = q + rng.normal(0.0, 1e-4, q.size)
        tick = run.step(robot.state(measured, v), posture.at(beyond))
        commands.append(tick.command.copy())
        (_, after), before = tick.advance(), v
        v = before + (after - before)
        q = robot.integrate(q, v, 0.001)
    assert abs(q[1] - robot.upper[1]) < 1e-2
    assert np.abs(np.diff(commands[2000:], axis=0)).max() < most


@pytest.mark.parametrize("seed", range(20))
def test_noise_of_rates_reaches_no_acceleration_bound_with_more_than_twice_the_approach(seed: int) -> None:
    """Drawn joints inside, at and beyond a limit: a finger of a walker at its stop had the gain 1/dt."""
    rng = np.random.default_rng(seed)
    k, approach, dt = 50, rng.uniform(5.0, 100.0), 0.002
    way = rng.choice([-1.0, 0.0, 1.0], k) * 10.0 ** rng.uniform(-6.0, 0.0, k)
    robot = robot_of(np.full(k, -10.0), way, 10.0 ** rng.uniform(-1.0, 2.0, k))
    limits = JointLimits(acceleration=None, braking=rng.uniform(1.0, 100.0), approach=approach, noise=0.06)
    run, v = box(limits, robot, dt, order=2), rng.choice([-1.0, 1.0], k) * 10.0 ** rng.uniform(-4.0, -2.0, k)
    noise = rng.normal(0.0, 4e-3, k)
    change = run(np.zeros(k), v + noise)[1] - run(np.zeros(k), v)[1]
    assert np.all(np.abs(change) <= 2.0 * approach * np.abs(noise) + 1e-9)


def test_braking_from_top_speed_sets_in_gradually() -> None:
    """Without a gradual bound, the change to braking on the curve is b = 5 rad/s^2 in one tick."""
    robot = hqp.robots.load("panda")
    posture = Posture(law=PD(100.0, 20.0))
    stack = Stack(Level(posture), subject_to=[JointLimits()])
    session = hqp.Controller(stack, hqp.Acceleration(), deadline=math.inf).session(robot, 0.002)
    elbow, q, v = robot.joints("panda_joint4")[0], robot.home.copy(), np.zeros(robot.nv)
    goal, found = q.copy(), []
    q[elbow] = robot.lower[elbow] + 0.1
    goal[elbow] = robot.upper[elbow] + 2.0
    top = 0.0
    for _ in range(2000):
        tick = session.step(robot.state(q, v), posture.at(goal))
        found.append(tick.command[elbow])
        q, v = tick.advance()
        top = max(top, v[elbow])
    assert top > 0.95 * robot.velocity_limit[elbow]
    assert robot.upper[elbow] - q[elbow] < 0.01
    assert np.abs(np.diff(found[300:])).max() < 1.0


def test_defaults_follow_the_robot() -> None:
    """50 and 5 rad/s^2, less for a weak motor or a slow joint; explicit numbers are kept."""
    robot = hqp.robots.load("talos")
    picked = JointLimits().selection(robot)
    inertia = np.diag(robot.state(robot.home).mass_matrix())[picked]
    a, b = JointLimits().rates(robot)
    expected = np.minimum(50.0, robot.effort_limit[picked] / inertia)
    np.testing.assert_allclose(a, np.minimum(expected, robot.velocity_limit[picked] / 0.02))
    np.testing.assert_array_equal(b, np.minimum(5.0, a))
    assert 10.0 < a.min() < 20.0
    assert np.median(a) == 50.0
    a, b = JointLimits(acceleration=60.0, braking=70.0).rates(robot)
    assert np.all(a == 60.0)
    assert np.all(b == 60.0)
    a, b = JointLimits(acceleration=None, braking=0).rates(robot)
    assert np.all(np.isinf(a))
    assert np.all(np.isinf(b))
    assert JointLimits(acceleration=None) == JointLimits(acceleration=0.0)  # the notation of files


def test_unlimited_joints_are_free() -> None:
    robot = robot_of([-math.inf], [math.inf], [math.inf])
    for acceleration in (None, 5.0):
        lower, upper = box(JointLimits(acceleration=acceleration, braking=3.0), robot, 0.1)([3.0], [1.0])
        assert (lower[0], upper[0]) == ((-math.inf, math.inf) if acceleration is None else (0.5, 1.5))


def test_the_window_stands_around_the_last_command() -> None:
    """At velocity level a measured velocity lags or is missing: the command does not depend on it."""
    robot = hqp.robots.load("panda")
    hand = Position(frame="panda_hand_tcp", law=P(5.0))
    stack = Stack(Level(hand), Level(Posture(law=P(1.0))), subject_to=[JointLimits()])
    rng = np.random.default_rng(0)
    goal = hand.at(robot.state().position("panda_hand_tcp") + (0.1, 0.2, 0.1))
    commands = []
    for measured in (lambda v: v, lambda v: None, lambda v: v + rng.normal(size=v.size)):
        session = hqp.Controller(stack, deadline=math.inf).session(robot, 0.002)
        q, v = robot.home.copy(), np.zeros(robot.nv)
        ticks = []
        for i in range(40):
            tick = session.step(robot.state(q, measured(v) if i else v), goal)
            q, v = tick.advance()
            ticks.append(tick.command)
        commands.append(np.array(ticks))
    assert np.abs(commands[0]).max() > 0.3
    assert np.abs(np.diff(commands[0], axis=0)).max() <= 0.1 + 1e-12
    np.testing.assert_array_equal(commands[0], commands[1])
    np.testing.assert_array_equal(commands[0], commands[2])


def test_fields() -> None:
    for bad in (
        {"margin": -0.1},
        {"margin": math.nan},
        {"acceleration": -1.0},
        {"braking": -1.0},
        {"braking": math.nan},
        {"acceleration": math.inf},
        {"return_velocity": 0.0},
        {"joints": ()},
        {"joints": ["a", "a"]},
        {"joints": 3},
        {"weight": 0.0},
    ):
        with pytest.raises(DeclarationError, match=next(iter(bad))):
            JointLimits(**bad)  # type: ignore[arg-type]
    with pytest.raises(DeclarationError, match="margin"):
        box(JointLimits(margin=1.5, acceleration=5.0), robot_of([-1.0], [1.0], [1.0]), 0.01)([0.0], [0.0])
    assert JointLimits(joints=["b", "a"]).joints == ("b", "a")
    assert hash(JointLimits(joints=["b"])) == hash(JointLimits(joints=("b",)))


def test_torque_limits() -> None:
    robot = hqp.robots.load("dreamer")
    limits = TorqueLimits(joints="arm", scale=0.5)
    picked = limits.selection(robot)
    assert [robot.joint_names[i] for i in picked] == [f"arm_j{i}" for i in range(7)]
    n = robot.actuated.size
    lower, upper = limits.bounds(robot.state())
    np.testing.assert_array_equal(upper, 0.5 * robot.effort_limit[robot.actuated][picked])
    np.testing.assert_array_equal(lower, -np.array(upper))
    np.testing.assert_array_equal(limits.jacobian(robot.state()), np.eye(n)[picked])
    plan = limits.plan(robot)
    np.testing.assert_array_equal(plan.lower, lower)
    np.testing.assert_array_equal(plan.upper, upper)
    assert TorqueLimits().rows(robot) == n
    with pytest.raises(DeclarationError, match="with a motor"):
        TorqueLimits(joints="torso_thorax").rows(robot)
    with pytest.raises(JointNotFound, match="torso_hip"):
        TorqueLimits(joints="torso_hipp").rows(robot)
    with pytest.raises(DeclarationError, match="do not overlap"):
        TorqueLimits(joints=["arm", "arm_j0"]).rows(robot)


@pytest.mark.parametrize("formulation", [hqp.Velocity(), hqp.Acceleration(), hqp.Torque()])
def test_a_declared_speed_holds_in_closed_loop(formulation: Formulation) -> None:
    """Joints driven from range to range reach the declared speed and pass neither it nor that of the robot."""
    robot, dt, order = hqp.robots.load("ur5"), 0.005, 1 if isinstance(formulation, hqp.Velocity) else 2
    limits, law = JointLimits(speed=1.2), P(20.0) if order == 1 else PD(400.0, 40.0)
    limits_of = np.minimum(robot.velocity_limit, 1.2)
    np.testing.assert_array_equal(limits.speeds(robot), limits_of)
    np.testing.assert_array_equal(JointLimits(speed=1e3).speeds(robot), robot.velocity_limit)
    posture = Posture(law=law)
    session = hqp.Controller(Stack(Level(posture), subject_to=[limits]), formulation, deadline=math.inf).session(
        robot, dt, stuck=False
    )
    q, v, fastest = robot.home.copy(), np.zeros(robot.nv), 0.0
    for k in range(300):
        goal = robot.home + (1.5 if (k // 150) % 2 == 0 else -1.5)
        q, v = session.step(robot.state(q, v), posture.at(goal)).advance()
        assert (np.abs(v) <= limits_of + 1e-6).all()
        fastest = max(fastest, float(np.abs(v).max()))
    assert fastest > 1.15
