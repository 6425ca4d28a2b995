"""Footsteps within reach, a continuous plan of the DCM that ends at rest, smooth swing feet."""

from __future__ import annotations

import copy
import math
from dataclasses import FrozenInstanceError
from itertools import pairwise
from typing import Any

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from hqp.errors import DeclarationError
from hqp.walking import (
    Command,
    DcmPlan,
    Foothold,
    Footsteps,
    Gait,
    Landing,
    Piece,
    Reach,
    Swing,
    adjust,
    natural_frequency,
)
from hqp.walking.footsteps import LEFT, RIGHT, rotation
from hqp.walking.stacks import Laws
from hqp.walking.swing import FALLS, FOLLOWS, LEAD, RISE, SINKS

REACH = Reach(forward=0.3, least=0.12, most=0.35, turn=0.4)
STEPS = Footsteps(period=0.75, width=0.17, reach=REACH)
numbers = st.floats(-2.0, 2.0)


def walked(command: Command, count: int, steps: Footsteps = STEPS) -> list[Foothold]:
    """Two feet side by side, then ``count`` steps."""
    found = [Foothold(LEFT, 0.0, 0.085), Foothold(RIGHT, 0.0, -0.085)]
    for _ in range(count):
        found.append(steps.next(found[-1], command))
    return found


def seen_from(stance: Foothold, other: Foothold) -> Any:
    return rotation(-stance.yaw) @ (other.xy - stance.xy)


# ---------------------------------------------------------------------------------------------- footsteps


@pytest.mark.parametrize(
    ("command", "each"),
    [
        (Command(forward=0.2), (0.3, 0.0, 0.0)),
        (Command(forward=-0.1), (-0.15, 0.0, 0.0)),
        (Command(left=0.05), (0.0, 0.075, 0.0)),
        (Command(left=-0.05), (0.0, -0.075, 0.0)),
        (Command(turn=0.2), (0.0, 0.0, 0.3)),
        (Command(turn=-0.2), (0.0, 0.0, -0.3)),
        (Command(), (0.0, 0.0, 0.0)),
    ],
)
def test_two_steps_go_as_far_as_the_velocity_says(command: Command, each: tuple[float, float, float]) -> None:
    """v 2 T; one foot of two steps sideways; one foot opens a turn and the other closes it."""
    found = walked(command, 8)
    for one, other in zip(found[3:], found[5:], strict=False):
        if not each[2]:
            np.testing.assert_allclose(other.xy - one.xy, each[:2], atol=1e-12)
    assert found[-1].yaw - found[-3].yaw == pytest.approx(each[2])
    assert abs(found[-1].side - found[-2].side) == 1


@settings(max_examples=40)
@given(numbers, numbers, numbers)
def test_steps_are_within_reach(forward: float, left: float, turn: float) -> None:
    found = walked(Command(forward, left, turn), 6)
    for stance, foot in pairwise(found[1:]):
        x, y = seen_from(stance, foot)
        out = 1.0 if foot.side == LEFT else -1.0
        assert abs(x) <= REACH.forward + 1e-9
        assert REACH.least - 1e-9 <= out * y <= REACH.most + 1e-9
        assert abs(foot.yaw - stance.yaw) <= REACH.turn + 1e-9


OMEGA = 3.4


def planned(left: float = 0.3) -> Landing:
    """A stance foot on the right, a left foot that lands beside it, and the DCM of an even walk."""
    stance = Foothold(RIGHT, 0.3, -0.1, 0.0, 0.5)
    foothold = STEPS.next(stance, Command(0.1))
    offset = stance.turn @ np.array([0.02, -0.06])
    return Landing(stance=stance, foothold=foothold, offset=offset, left=left)


def answer(plan: Landing, error: Any, ankle: Any = (0.0, 0.0), **changed: Any) -> tuple[Foothold, float]:
    """Error and ankle in the axes of the stance foot."""
    turn = plan.stance.turn
    fields: dict[str, Any] = {"soonest": 0.08, "latest": 0.6, "usual": plan.left, "speed": 10.0, **changed}
    return adjust(plan, STEPS, turn @ error, turn @ ankle, OMEGA, now=plan.foothold.xy, **fields)


def missed(plan: Landing, error: Any, ankle: Any, found: tuple[Foothold, float]) -> Any:
    """Error of the DCM at the landing, ``(2,)`` in the axes of the stance foot."""
    foot, left = found
    turn, zmp = plan.stance.turn, plan.stance.xy + plan.stance.turn @ ankle
    xi = plan.dcm(OMEGA, plan.left) + turn @ error
    landing = zmp + (xi - zmp) * math.exp(OMEGA * left)
    return turn.T @ (landing - foot.xy - plan.offset)


@settings(max_examples=60)
@given(st.floats(-0.05, 0.05), st.floats(-0.05, 0.05), st.floats(0.1, 0.5), st.floats(-0.02, 0.02))
def test_a_step_is_within_reach_and_no_other_is_better(x: float, y: float, left: float, ankle: float) -> None:
    """Compare with footholds and times on a grid: the choice misses by hardly more than the best of them."""
    plan, error, dz = planned(left), np.array([x, y]), np.array([0.0, ankle])
    found = answer(plan, error, dz)
    np.testing.assert_allclose(STEPS.within(found[0], plan.stance).xy, found[0].xy, atol=1e-12)
    assert 0.08 <= found[1] <= 0.6
    if ankle * y >= -1e-9 and abs(ankle) >= abs(y):  # the ankle alone suffices
        return
    wide = np.array([REACH.forward, REACH.most - REACH.least])
    steps = [(x, y) for x in np.linspace(-0.3, 0.3, 7) for y in np.linspace(0.12, 0.35, 5)]
    feet = [Foothold(LEFT, *(plan.stance.xy + plan.stance.turn @ step)) for step in steps]
    others = [missed(plan, error, dz, (foot, t)) / wide for t in np.linspace(0.08, 0.6, 6) for foot in feet]
    best = float(np.linalg.norm(others, axis=1).min())
    assert float(np.linalg.norm(missed(plan, error, dz, found) / wide)) <= best + 0.06


def test_a_push_outwards_lands_sooner_and_wider_one_inwards_later() -> None:
    plan = planned()
    seen = [plan.stance.turn.T @ (answer(plan, (0.0, y))[0].xy - plan.stance.xy) for y in (0.0, 0.03, 0.06)]
    assert seen[0][1] < seen[1][1] <= seen[2][1] <= REACH.most + 1e-12
    times = [answer(plan, (0.0, y))[1] for y in (-0.03, 0.0, 0.08)]
    assert times[0] > times[1] + 0.05
    assert times[2] < times[1] - 0.05


def test_what_an_ankle_does_needs_no_step() -> None:
    """A ZMP beyond the DCM leads it back; with small errors, or a foot without time, the step stays as planned."""
    plan = planned()
    for error, ankle, least in (
        ((0.0, 0.02), (0.0, 0.03), 0.0),
        ((-0.01, 0.0), (-0.02, 0.0), 0.0),
        ((0.003, 0.002), (0.0, 0.0), 0.02),
    ):
        foot, left = answer(plan, error, ankle, least=least)
        np.testing.assert_allclose(foot.xy, plan.foothold.xy, atol=1e-12)
        assert left == plan.left
    foot, left = answer(plan, (0.1, 0.0), speed=0.2)
    assert np.linalg.norm(foot.xy - plan.foothold.xy) <= math.sqrt(2.0) * 0.2 * left + 1e-9


# ------------------------------------------------------------------------------------------------ pendulum


@st.composite
def plans(draw: Any) -> tuple[list[Piece], float]:
    rng = np.random.default_rng(draw(st.integers(0, 10_000)))
    points = [rng.normal(size=2)]
    pieces = []
    for _ in range(int(rng.integers(1, 8))):
        points.append(points[-1] if rng.uniform() < 0.4 else rng.normal(size=2))
        pieces.append(Piece(float(rng.uniform(0.05, 1.0)), points[-2], points[-1]))
    return pieces, float(rng.uniform(2.0, 6.0))


@settings(max_examples=40)
@given(plans())
def test_the_dcm_follows_its_equation_and_ends_at_rest(made: tuple[list[Piece], float]) -> None:
    """d xi/dt = omega (xi - p), continuous at every joint, p on the pieces, xi = p from the end on."""
    pieces, omega = made
    plan, h = DcmPlan(pieces, omega), 1e-6
    size = max(np.abs(p.end).max() for p in pieces) + np.abs(pieces[0].start).max()
    start = 0.0
    for piece in pieces:
        for share in (0.1, 0.5, 0.9):
            t = start + share * piece.duration
            zmp, dcm = plan.at(t)
            np.testing.assert_allclose(zmp, (1 - share) * piece.start + share * piece.end, atol=1e-9)
            rate = (plan.at(t + h)[1] - plan.at(t - h)[1]) / (2 * h)
            np.testing.assert_allclose(rate, omega * (dcm - zmp), atol=1e-6 * omega**2 * size)
        start += piece.duration
        before, after = plan.at(start - 1e-9), plan.at(start + 1e-9)
        np.testing.assert_allclose(before, after, atol=1e-6 * size)
    for t in (plan.duration, plan.duration + 3.0):
        zmp, dcm = plan.at(t)
        np.testing.assert_allclose(zmp, pieces[-1].end, atol=1e-12)
        np.testing.assert_allclose(dcm, zmp, atol=1e-12)


@settings(max_examples=40)
@given(plans())
def test_the_dcm_stays_where_the_zmp_goes(made: tuple[list[Piece], float]) -> None:
    """xi is a mean of future ZMPs: within their box."""
    pieces, omega = made
    corners = np.array([p.start for p in pieces] + [pieces[-1].end])
    plan = DcmPlan(pieces, omega)
    for t in np.linspace(0.0, plan.duration, 40):
        dcm = plan.at(t)[1]
        assert np.all(dcm >= corners.min(axis=0) - 1e-9)
        assert np.all(dcm <= corners.max(axis=0) + 1e-9)


# --------------------------------------------------------------------------------------------------- swing


@st.composite
def swings(draw: Any) -> tuple[Swing, Any, Any]:
    rng = np.random.default_rng(draw(st.integers(0, 10_000)))
    start = rng.normal(size=4) * [0.5, 0.5, 0.02, 0.5]
    goal = start + rng.uniform(-1.0, 1.0, 4) * [0.4, 0.2, 0.05, 0.4]
    return Swing(start, goal, float(rng.uniform(0.3, 1.0)), 0.05, search=0.1), start, goal


@settings(max_examples=15)
@given(swings())
def test_a_foot_is_smooth_arrives_and_stays_in_bounds(made: tuple[Swing, Any, Any]) -> None:
    """The path matches its velocity and acceleration, from start to goal, over the top, then down."""
    swing, start, goal = made
    dt, path = 0.001, []
    for _ in range(math.ceil((swing.duration - LEAD) / dt)):
        path.append(swing.step(dt))
    x, v, a = (np.array(part) for part in zip(*path, strict=True))
    speed, bend = 4.0 * 0.4 / swing.duration, 30.0 * 0.4 / swing.duration**2
    assert np.abs(v).max() < speed + 1.0
    assert np.abs(np.diff(x, axis=0) - 0.5 * dt * (v[1:] + v[:-1])).max() < 2e-2 * dt * speed
    assert np.abs(np.diff(v, axis=0) - 0.5 * dt * (a[1:] + a[:-1])).max() < 5e-2 * dt * (bend + 50.0)
    assert np.abs(np.diff(a, axis=0)).max() < 0.15 * (bend + 50.0)
    np.testing.assert_allclose(x[-1][[0, 1, 3]], goal[[0, 1, 3]], atol=1e-9)
    assert x[-1][2] == pytest.approx(goal[2], abs=1e-3)
    assert v[-1][2] == pytest.approx(-0.1, abs=1e-2)
    low, high = np.minimum(start, goal), np.maximum(start, goal)
    assert np.all(x[:, [0, 1, 3]] >= (low - 1e-9)[[0, 1, 3]])
    assert np.all(x[:, [0, 1, 3]] <= (high + 1e-9)[[0, 1, 3]])
    assert x[:, 2].max() == pytest.approx(max(start[2], goal[2]) + 0.05, abs=2e-3)
    assert x[:, 2].min() > low[2] - 5e-3


@settings(max_examples=15)
@given(swings(), st.floats(0.003, 0.012))
def test_two_half_ticks_are_one_tick(made: tuple[Swing, Any, Any], dt: float) -> None:
    """Until the landing the path does not depend on the period, over its top either."""
    one, two = made[0], copy.deepcopy(made[0])
    while one.left > LEAD + 2.0 * dt:
        whole = one.step(dt)
        two.step(0.5 * dt)
        for found, expected in zip(two.step(0.5 * dt), whole, strict=True):
            np.testing.assert_allclose(found, expected, atol=1e-7)


def test_a_foot_is_at_rest_without_acceleration_at_its_top() -> None:
    for after in (-1e-6, 1e-6):
        swing = Swing(np.zeros(4), np.array([0.2, 0.0, 0.0, 0.0]), 0.5, 0.05)
        x, v, a = swing.step(RISE * swing.duration + after)
        assert (x[2], v[2], a[2]) == (pytest.approx(0.05), pytest.approx(0.0, abs=1e-4), pytest.approx(0.0, abs=1e-3))


def test_the_laws_of_a_walk_are_critically_damped() -> None:
    laws = Laws()
    for law in (laws.height, laws.swing, laws.trunk, laws.posture):
        assert law.kd == pytest.approx(2.0 * math.sqrt(law.kp), rel=0.03)


def test_a_goal_that_moves_late_is_followed_without_a_jump() -> None:
    swing = Swing(np.zeros(4), np.array([0.2, 0.0, 0.0, 0.0]), 0.5, 0.05)
    dt, x = 0.002, []
    for k in range(300):
        if 240 <= k < 255:  # from just before the landing on
            swing.retarget(np.array([0.2, 0.04, 0.0, 0.0]), 1.5, dt)
        x.append(swing.step(dt)[0])
    speed = np.diff(np.array(x)[:, 1]) / dt
    assert np.abs(np.diff(speed)).max() < 0.1
    assert x[254 + round(FOLLOWS / dt) + 1][1] == pytest.approx(0.04, abs=1e-6)


def test_a_foot_that_finds_no_ground_goes_down_so_far() -> None:
    swing = Swing(np.zeros(4), np.array([0.2, 0.0, 0.0, 0.0]), 0.5, 0.05, search=0.1, depth=0.06)
    z = [swing.step(0.002)[0][2] for _ in range(600)]
    assert z[260] < -0.001
    assert z[-1] == pytest.approx(-0.06)
    falls = np.diff(z, 2)[237:272] / 0.002**2  # faster and faster, LEAD before the landing
    assert np.diff(falls)[:20] == pytest.approx(-SINKS * 0.002, rel=1e-3)
    assert falls[-5:] == pytest.approx(-FALLS, rel=1e-6)
    x, v, _ = swing.step(0.002)
    assert x[0] == pytest.approx(0.2)
    assert not v.any()


@settings(max_examples=25)
@given(swings(), st.integers(0, 10_000))
def test_a_landing_that_moves_does_not_throw_the_foot(made: tuple[Swing, Any, Any], seed: int) -> None:
    """Whenever the landing time moves, to no sooner than the foot can follow, its vertical acceleration is bounded."""
    swing, rng, dt = made[0], np.random.default_rng(seed), 0.002
    latest = swing.duration * 1.6
    change = 1.0
    undisturbed, found = copy.deepcopy(swing), []
    bound = max(5.0 * FALLS, 1.5 * max(abs(undisturbed.step(dt)[2][2]) for _ in range(int(swing.duration / dt))))
    for _ in range(int(latest / dt)):
        if rng.uniform() < 0.02:
            change = float(rng.uniform())
        wanted = max(change * latest, swing.time + swing._path.soonest)
        if swing.left > 0.08:
            step = float(np.clip(wanted - swing.duration, -3.0 * dt, 3.0 * dt))
            swing.duration = max(swing.duration + step, swing.time + 0.08)
        found.append(swing.step(dt)[2][2])
    assert np.abs(found).max() < bound


@pytest.mark.parametrize("seed", range(12))
def test_a_foot_has_the_time_to_rise_to_a_goal_above_it(seed: int) -> None:
    """Its landing moves as soon as it can, at any time: the foot below its goal needs the time of the way up."""
    rng, dt = np.random.default_rng(seed), 0.002
    goal = np.array([*rng.uniform(-0.3, 0.3, 2), rng.uniform(0.03, 0.08), 0.2])
    swing = Swing(np.zeros(4), goal, float(rng.uniform(0.25, 1.0)), 0.05)
    begins, rest, found = rng.uniform(0.0, 0.2) * swing.duration, 1.0, []
    bound = max(abs(part.step(dt)[2][2]) for part in [copy.deepcopy(swing)] for _ in range(int(swing.duration / dt)))
    for _ in range(int(2.0 * swing.duration / dt)):
        if swing.time > begins and rest > 0.08:
            soonest = swing.time + max(swing._path.soonest, 0.08)
            swing.duration = max(soonest, swing.duration - 3.0 * dt)
        rest = swing.left
        found.append(swing.step(dt)[2][2])
    assert np.abs(found).max() < max(5.0 * FALLS, 1.5 * bound)


def test_a_goal_that_moves_bends_the_path_without_a_jump() -> None:
    swing = Swing(np.zeros(4), np.array([0.3, 0.0, 0.0, 0.0]), 0.6, 0.05)
    dt, x, v, a = 0.002, [], [], []
    for k in range(300):
        if 100 < k < 250:
            swing.retarget(np.array([0.2, 0.1, 0.0, 0.2]), 1.0, dt)
        for into, part in zip((x, v, a), swing.step(dt), strict=True):
            into.append(part)
    assert np.abs(np.diff(x, axis=0)).max() < 2.0 * dt
    assert np.abs(np.diff(v, axis=0)).max() < 40.0 * dt
    np.testing.assert_allclose(x[-1][[0, 1, 3]], [0.2, 0.1, 0.2], atol=1e-6)
    assert swing.left == pytest.approx(0.0, abs=LEAD)


# ----------------------------------------------------------------------------------------------- bad input


def test_steps_and_commands_are_values() -> None:
    for value, field in ((STEPS, "period"), (Command(), "forward"), (REACH, "forward"), (Gait(), "single")):
        with pytest.raises(FrozenInstanceError):
            setattr(value, field, 1.0)


def test_what_is_no_number_is_refused() -> None:
    with pytest.raises(DeclarationError, match="single"):
        Gait(single=0.0)
    with pytest.raises(DeclarationError, match="lower"):
        Gait(lower=1.0)
    with pytest.raises(DeclarationError, match="most below least"):
        Reach(forward=0.3, least=0.3, most=0.1)
    with pytest.raises(DeclarationError, match="width"):
        Footsteps(period=0.7, width=0.05, reach=REACH)
    with pytest.raises(DeclarationError, match="forward"):
        Command(forward=math.nan)
    with pytest.raises(DeclarationError, match="zero duration"):
        DcmPlan([], 3.0)
    with pytest.raises(DeclarationError, match="not continuous"):
        DcmPlan([Piece(1.0, np.zeros(2), np.zeros(2)), Piece(1.0, np.ones(2), np.ones(2))], 3.0)
    with pytest.raises(DeclarationError, match="height"):
        natural_frequency(0.0)
    with pytest.raises(DeclarationError, match="goal"):
        Swing(np.zeros(4), np.zeros(3), 0.5, 0.05)
    with pytest.raises(DeclarationError, match="duration"):
        Swing(np.zeros(4), np.zeros(4), 0.01, 0.05)
