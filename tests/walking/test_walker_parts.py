"""A native walker on states without a robot: yaw, share, height, landing, load, plan, swing reference, phases."""

from __future__ import annotations

import copy
import math
from functools import cache
from itertools import pairwise
from typing import Any

import numpy as np
import pytest

import hqp.robots
from hqp import _session
from hqp.angles import wrapped
from hqp.estimation.rotations import about_vertical
from hqp.tasks.polygons import nearest
from hqp.tasks.support_polygon import hull
from hqp.walking import Command, DcmPlan, Foothold, Gait, Landing, Piece, Reach, Walker, adjust
from hqp.walking.footsteps import LEFT, RIGHT, Footsteps
from hqp.walking.walker import PHASES

DT, HEIGHT, WEIGHT = 0.004, 0.7, 400.0
GAIT = Gait(single=0.5, double=0.2, first=0.7, patience=0.3)
REACH = Reach(forward=0.3, least=0.12, most=0.35)
STAND, SHIFT, SWING = range(3)
PACE = Command(0.2)
SQUARE = np.array([(-1.0, -1.0), (-1.0, 1.0), (1.0, -1.0), (1.0, 1.0)])
HERE = ((0.0, 0.1, 0.0, 0.0), (0.0, -0.1, 0.0, 0.0))
EARLY, TOUCH, LATE, TAKE = (getattr(_session.Walker, name) for name in ("EARLY", "TOUCH", "LATE", "TAKE"))
SAG, HEAVIER, SETTLES = (getattr(_session.Walker, name) for name in ("SAG", "HEAVIER", "SETTLES"))
FADE, SLEW = _session.Walker.FADE, _session.Walker.SLEW
AHEAD, CORRECTION, CREEPS, LAST = (getattr(_session.Walker, name) for name in ("AHEAD", "CORRECTION", "CREEPS", "LAST"))


@cache
def made() -> Walker:
    return Walker(hqp.robots.load("g1", rotors=True), dt=DT, deadline=math.inf)


@cache
def parts() -> dict[str, Any]:
    return made().tree(made().robot.copy())


class Alone:
    """A native walker on soles of a size [m] whose frames are in their middles; it has started at HERE."""

    def __init__(self, size: float = 5.0, **changed: Any) -> None:
        corners = [(x, y) for x in (-size, size) for y in (-size, size)]
        soles = [{**sole, "middle": (0.0, 0.0), "corners": corners} for sole in parts()["soles"]]
        self.tree = {
            **parts(), "soles": soles, "dt": DT, "gait": GAIT.numbers, "reach": (0.3, 0.12, 0.35, 0.4), "planned": 0.24,
            "width": 0.2, "height": HEIGHT, "omega": 3.5, "pendulum": 3.5, "k": 3.0, "weight": WEIGHT,
            "upright": np.eye(3).ravel().tolist(), "limits": [100.0, 50.0, 20.0], "friction": [],
        }  # fmt: skip
        self.native = _session.Walker(self.tree)
        self.at()
        self.set(**changed)

    @property
    def state(self) -> Any:
        return self.native.state

    def set(self, **changed: Any) -> None:
        for name, value in changed.items():
            setattr(self.state, name, value)

    def at(
        self, soles: Any = HERE, com: Any = (0.0, 0.0, HEIGHT), velocity: Any = (0.0, 0.0, 0.0), loads: Any = None
    ) -> None:
        """One step with soles (x, y, z, yaw)."""
        placed = [(*sole[:3], *about_vertical(sole[3]).ravel().tolist()) for sole in soles]
        self.native.step_on(com, velocity, placed, None if loads is None else np.array(loads))


def place(side: int, x: float, y: float, yaw: float = 0.0, z: float = 0.0) -> tuple[int, float, float, float, float]:
    return side, x, y, z, yaw


def swing(start: Any, goal: Any, duration: float = 0.5, time: float = 0.0) -> Any:
    found = _session.Swing(tuple(start), tuple(goal), duration, 0.05, 0.1, 0.06)
    found.time = time
    return found


# ---------------------------------------------------------------------------------------------------- yaw


@pytest.mark.parametrize("stance", [LEFT, RIGHT])
@pytest.mark.parametrize(("one", "other"), [(0.1, 0.5), (-0.3, 0.2), (3.0, -3.0), (-2.9, 3.1)])
@pytest.mark.parametrize("phase", [STAND, SWING])
def test_the_trunk_aims_half_way_between_the_feet(phase: int, one: float, other: float, stance: int) -> None:
    """In a swing to where the foot is to be, the short way, at a bounded rate."""
    there, elsewhere = place(1 - stance, 0.2, 0.2, other), place(1 - stance, 0.2, 0.2, 1.3)
    holds = [elsewhere if phase == SWING else there] * 2
    holds[stance] = place(stance, 0.0, 0.0, one)
    walker = Alone(
        phase=phase, stance=stance, holds=tuple(holds), target=there if phase == SWING else elsewhere, yaw=one,
        duration=9.0, swing=swing((0.0, 0.0, 0.0, 0.0), (0.1, 0.0, 0.0, 0.0)),
    )  # fmt: skip
    way = 0.5 * wrapped(other - one)
    for k in range(1, 200):
        walker.at()
        expected = math.copysign(min(abs(way), 0.8 * DT * k), way)
        assert wrapped(walker.state.yaw - one) == pytest.approx(expected, abs=1e-9)
        np.testing.assert_allclose(walker.native.trunk.reshape(3, 3), about_vertical(walker.state.yaw), atol=1e-12)


# -------------------------------------------------------------------------------------------------- share


def towards(walker: Alone, zmp: Any) -> Any:
    """The CoM, at rest, with which the balance leads the ZMP there, from a plan that rests below HERE."""
    return (*(np.asarray(zmp) / (1.0 + 3.0 / 3.5)), HEIGHT)


@pytest.mark.parametrize(("along", "expected"), [(0.3, 0.3), (0.75, 0.75), (-0.4, 0.0), (1.2, 1.0)])
def test_a_foot_bears_as_much_as_the_zmp_is_near_it(along: float, expected: float) -> None:
    one, other = np.array([0.2, 0.4]), np.array([0.5, -0.1])
    walker = Alone(holds=(place(LEFT, *one), place(RIGHT, *other)), share=0.5)
    shares = [0.5]
    for _ in range(60):
        walker.set(sum=(0.0, 0.0))
        walker.at(com=towards(walker, one + along * (other - one) + 0.07 * np.array([0.5, 0.3])))
        shares.append(walker.native.share)
    assert shares[-1] == pytest.approx(expected, abs=1e-9)
    steps = np.diff(shares)
    assert np.abs(steps).max() == pytest.approx(min(DT / TAKE, abs(expected - 0.5)))
    assert steps[0] == pytest.approx(math.copysign(np.abs(steps).max(), expected - 0.5))


@pytest.mark.parametrize("stance", [LEFT, RIGHT])
def test_a_shift_ends_with_all_on_the_stance_foot(stance: int) -> None:
    for left, expected in ((2.0 * TAKE + 0.01, 0.4), (1.5 * TAKE, 0.4 + 0.5 * (stance - 0.4)), (0.5 * TAKE, stance)):
        walker = Alone(phase=SHIFT, stance=stance, duration=0.6, t=0.6 - left, share=expected)
        walker.at(com=towards(walker, (0.0, 0.1 - 0.4 * 0.2)))
        assert walker.native.share == pytest.approx(expected, abs=1e-9)


# ------------------------------------------------------------------------------------------------- height


@pytest.mark.parametrize(("phase", "ground"), [(SWING, 0.06), (STAND, 0.02), (SHIFT, 0.02)])
def test_the_height_rises_slowly_to_that_above_the_feet(phase: int, ground: float) -> None:
    holds = (place(LEFT, 0.0, 0.1, z=-0.02), place(RIGHT, 0.0, -0.1, z=0.06))
    for start in (0.6, 0.9):
        walker = Alone(phase=phase, stance=RIGHT, holds=holds, z=start, duration=9.0)
        for k in range(1, 1800):
            walker.at(com=(0.0, 0.0, walker.state.z))  # no deficit but that of this tick's rise
            way = ground + HEIGHT - start
            expected = start + math.copysign(min(abs(way), 0.05 * HEIGHT * DT * k), way)
            assert walker.state.z == pytest.approx(expected, abs=1e-9)
            assert walker.native.height == walker.state.z + walker.state.raised
        assert walker.state.z == pytest.approx(ground + HEIGHT)


def test_a_deficit_raises_the_height_by_its_integral_up_to_a_limit() -> None:
    for deficit in (0.003, -0.002):
        walker, found = Alone(z=HEIGHT, raised=0.001), []
        for _ in range(round(20.0 / DT)):
            walker.at(com=(0.0, 0.0, HEIGHT - deficit))
            found.append(walker.native.height - HEIGHT)
        np.testing.assert_allclose(found[:10], 0.001 + 2.0 * DT * deficit * np.arange(1, 11), atol=1e-12)
        assert found[-1] == pytest.approx(math.copysign(SAG, deficit))


# ------------------------------------------------------------------------------------------------ landing


def landing(*, share: float, t: float, z: float, path: float, goal: float = 0.0, stance: int = RIGHT) -> Alone:
    """After a step: the left foot swings, at a height, on a path towards a goal, and bears a share of the weight."""
    walker = Alone(
        phase=SWING, stance=stance, t=t, duration=0.5, walking=True,
        swing=swing((0.0, 0.0, path, 0.0), (0.0, 0.0, goal, 0.0), time=t),
    )  # fmt: skip
    walker.at(((0.0, 0.1, z, 0.0), (0.0, -0.1, 9.0, 0.0)), loads=(share * WEIGHT, 9000.0))
    return walker


def test_a_foot_lands_with_load_near_its_path_or_its_goal() -> None:
    early, before, after = 0.5 * EARLY - 0.01, 0.4, 0.51
    held: dict[str, Any] = {"z": 0.03, "path": 0.03}
    for share, t, lands in (
        (0.9, early, False), (TOUCH + 0.01, before, True), (TOUCH - 0.01, before, False), (LATE + 0.001, after, True),
        (LATE - 0.001, after, False), (0.0, 0.81, True), (0.0, 0.79, False), (math.nan, before, False),
    ):  # fmt: skip
        state = landing(share=share, t=t, **held).state
        assert (state.phase == SHIFT and state.entered) == lands


@pytest.mark.parametrize(
    ("z", "path", "goal", "lands"),
    [(0.0165, 0.021, 0.0, True), (0.0155, 0.021, 0.0, False), (0.0, 0.019, 0.0, True), (0.0, 0.021, 0.0, False),
     (0.02, 0.039, 0.02, True)],
)  # fmt: skip
def test_a_loaded_foot_far_from_both_has_scuffed_and_rises(z: float, path: float, goal: float, lands: bool) -> None:
    assert landing(share=0.2, t=0.4, z=z, path=path, goal=goal).state.phase == SHIFT, "no time to rise again"
    found = landing(share=0.2, t=0.28, z=z, path=path, goal=goal)
    assert (found.state.phase == SHIFT) == lands
    if not lands:
        foot, heights = copy.deepcopy(found.state.swing), []
        while foot.left > 0.0:
            foot.step(0.001)
            heights.append(foot.x[2])
        assert max(heights) > path + 1e-4


def test_without_loads_a_foot_lands_in_time() -> None:
    for t, lands in ((0.499, False), (0.5, True), (0.6, True)):
        walker = Alone(phase=SWING, t=t, duration=0.5, walking=True, swing=swing((0.0,) * 4, (0.0,) * 4, time=t))
        walker.at()
        assert walker.state.entered == lands


# --------------------------------------------------------------------------------------------------- load


@pytest.mark.parametrize(("share", "expected"), [(1.1, 1.1), (0.9, 0.9), (1.4, 1.0 + HEAVIER), (0.6, 1.0 - HEAVIER)])
def test_the_load_says_how_heavy_a_robot_is(share: float, expected: float) -> None:
    walker, torques = Alone(), np.zeros(3)
    for _ in range(5000):
        walker.native.finish(torques, np.array([0.4, 0.6]) * share * WEIGHT)
    assert walker.state.heavier == pytest.approx(expected, abs=1e-3)
    before = walker.state.felt, walker.state.due, walker.state.heavier
    walker.native.finish(torques, np.array([math.nan, 0.0]))
    assert (walker.state.felt, walker.state.due, walker.state.heavier) == before


@pytest.mark.parametrize("seed", range(6))
def test_impacts_and_flights_do_not_change_the_weight(seed: int) -> None:
    """Drawn forces from nothing to a blow of six times the weight, and the motion of the CoM that they cause."""
    rng = np.random.default_rng(seed)
    walker, torques, share, rate = Alone(), np.zeros(3), rng.uniform(0.8, 1.2), 0.0
    for k in range(1500):
        kind, force = rng.uniform(), share * rng.uniform(0.5, 1.5)
        force = 0.0 if kind < 0.05 else share * 6.0 if kind > 0.98 else force
        if k:
            rate += (force / share - 1.0) * 9.81 * DT
        walker.at(velocity=(0.0, 0.0, rate))
        walker.native.finish(torques, np.array([0.3, 0.7]) * force * WEIGHT)
        if k * DT > 5.0 * SETTLES:
            assert walker.state.heavier == pytest.approx(share, abs=0.02)
    assert walker.state.heavier == pytest.approx(share, abs=2e-3)


@pytest.mark.parametrize("share", [0.0, 0.2, 0.4])
def test_loads_that_the_feet_do_not_feel_change_no_weight(share: float) -> None:
    """Sensors that are dead, or another link that bears the rest, while the CoM stays where it is."""
    walker, torques = Alone(), np.zeros(3)
    for k in range(5000):
        walker.native.finish(torques, np.array([0.5, 0.5]) * (1.1 if k < 2500 else 1.1 * share) * WEIGHT)
    assert walker.state.heavier == pytest.approx(1.1, abs=0.02)


def test_torques_that_the_load_scales_are_named() -> None:
    for share in (1.004, 1.1, 0.9):
        walker, torques = Alone(), np.zeros(3)
        assert walker.native.why == []
        for _ in range(5000):
            walker.native.finish(torques, np.array([0.4, 0.6]) * share * WEIGHT)
        named = [text for text in walker.native.why if text.startswith(f"masses x {share:.2f}: the feet bear")]
        assert len(named) == len(walker.native.why) == (share != 1.004)


def test_torques_go_on_from_those_before_a_switch() -> None:
    limit, walker = np.array([100.0, 50.0, 20.0]), Alone(heavier=1.1)
    first = np.array([10.0, -20.0, 19.0])
    walker.native.finish(first, None)
    np.testing.assert_allclose(first, [10.0, -20.0, 19.0])  # not scaled: the model bears the weight
    walker.set(entered=True)
    jumped = np.array([40.0, 10.0, -10.0])
    walker.native.finish(jumped, None)
    np.testing.assert_allclose(jumped, first + np.sign([1, 1, -1]) * limit * DT / FADE)
    walker.set(entered=False)
    last = jumped
    for _ in range(40):
        now = np.array([40.0, 10.0, -10.0])
        walker.native.finish(now, None)
        assert np.all(np.abs(now - last) <= limit * DT / FADE + 1e-9)
        last = now
    np.testing.assert_allclose(last, [40.0, 10.0, -10.0])


@pytest.mark.parametrize("seed", range(8))
def test_torques_change_at_a_bounded_rate(seed: int) -> None:
    """Answers jump at random, some beyond the limits, through switches: the torques follow them, and meet those that
    last."""
    rng, limit, walker = np.random.default_rng(seed), np.array([100.0, 50.0, 20.0]), Alone(heavier=1.0)
    last = rng.uniform(-1.0, 1.0, 3) * limit
    walker.native.finish(last, None)
    most, asked = np.max(limit) * DT / SLEW, last
    for _ in range(50):
        walker.set(entered=bool(rng.uniform() < 0.1))
        asked = rng.uniform(-1.5, 1.5, 3) * limit
        lasts = int(rng.integers(1, 60))
        for _ in range(lasts):
            now = asked.copy()
            walker.native.finish(now, None)
            walker.set(entered=False)
            assert np.all(np.abs(now - last) <= most * (1.0 + 1e-12))
            assert np.all(np.abs(now) <= limit)
            last = now
    for _ in range(round(4.0 * FADE / DT)):
        last = asked.copy()
        walker.native.finish(last, None)
    np.testing.assert_allclose(last, np.clip(asked, -limit, limit))


# ------------------------------------------------------------------------------------------- phases, plan


def after(pace: Command = PACE, **changed: Any) -> Alone:
    """A walker after the step in which its phase is over."""
    numbers = pace.forward, pace.left, pace.turn
    fields: dict[str, Any] = {
        "t": 0.6,
        "duration": 0.6,
        "walking": True,
        "command": numbers,
        "pace": numbers,
        **changed,
    }
    walker = Alone(swing=swing((0.0, 0.0, 0.01, 0.0), (0.0, 0.0, 0.0, 0.0), time=0.6), **{**fields, **changed})
    walker.at()
    return walker


def haste(pace: Command) -> float:
    period = GAIT.single + GAIT.double
    return min(1.0, max(2.0 / 3.0, 0.6 / (abs(pace.forward) * period / 0.24)))


def continuous(pieces: Any, start: Any) -> None:
    assert pieces[0][1] == start
    assert all(one[2] == other[1] for one, other in pairwise(pieces))
    assert all(duration > 0.0 for duration, _, _ in pieces)


def steps(stance: Any, pace: Command, count: int) -> list[Foothold]:
    found = [Foothold(*stance)]
    period = haste(pace) * (GAIT.single + GAIT.double)
    footsteps = Footsteps(period=period, width=0.2, reach=REACH)
    for _ in range(count):
        found.append(footsteps.next(found[-1], pace))
    return found


@pytest.mark.parametrize(
    ("changed", "phase", "duration"),
    [
        ({"phase": STAND}, SHIFT, GAIT.first),
        ({"phase": STAND, "walking": False}, STAND, 0.6),
        ({"phase": STAND, "t": 0.59}, STAND, 0.6),
        ({"phase": SHIFT}, SWING, haste(Command(0.2)) * GAIT.single),
        ({"phase": SHIFT, "t": 0.5}, SHIFT, 0.6),
        ({"phase": SWING}, SHIFT, haste(Command(0.2)) * GAIT.double),
        ({"phase": SWING, "t": 0.5}, SWING, 0.6),
        ({"phase": SWING, "walking": False}, SHIFT, haste(Command(0.2)) * GAIT.double),
        ({"phase": SWING, "walking": False, "pace": Command()}, STAND, GAIT.first),
    ],
)
def test_phases_follow_each_other(changed: dict[str, Any], phase: int, duration: float) -> None:
    state = after(stance=LEFT, **changed).state
    assert state.phase == phase
    assert state.duration == pytest.approx(duration)
    assert state.entered == (phase != changed["phase"])
    if changed["phase"] == STAND and phase == SHIFT:
        assert state.stance == RIGHT


def test_a_shift_is_followed_by_three_steps() -> None:
    pace, walker = Command(0.2), after(phase=STAND)
    pieces, single, double = walker.native.pieces, haste(Command(0.2)) * GAIT.single, haste(Command(0.2)) * GAIT.double
    assert [p[0] for p in pieces] == pytest.approx([*2 * [0.5 * GAIT.first], *3 * [single, double], single, 0.5])
    continuous(pieces, (0.0, 0.0))
    plan = DcmPlan([Piece(duration, np.array(one), np.array(other)) for duration, one, other in pieces], 3.5)
    np.testing.assert_allclose(plan.at(0.0)[1], (0.0, 0.0), atol=1e-9)  # the place of the robot at rest
    feet = steps(walker.state.holds[RIGHT], pace, 3)
    expected = [feet[0].xy, *(foot.xy for pair in pairwise(feet) for foot in pair), feet[3].xy]
    np.testing.assert_allclose([p[2] for p in pieces[1:]], [*expected, feet[3].xy])


def test_a_swing_goes_on_to_where_its_foot_is_to_land() -> None:
    pace, walker = Command(0.2), after(phase=SHIFT, stance=LEFT)
    pieces, single, double = walker.native.pieces, haste(Command(0.2)) * GAIT.single, haste(Command(0.2)) * GAIT.double
    assert [p[0] for p in pieces] == pytest.approx([single, double, *2 * [single, double], single, 0.5])
    continuous(pieces, (0.0, 0.0))
    feet = steps(walker.state.holds[LEFT], pace, 2)
    np.testing.assert_allclose(walker.state.nominal[1:3], feet[1].xy)
    np.testing.assert_allclose([pieces[k][2] for k in (0, 1, 3)], [foot.xy for foot in feet])
    stance, foothold, offset, left = walker.state.planned
    assert (stance, foothold, left) == (walker.state.holds[LEFT], walker.state.nominal, walker.state.duration)
    plan = DcmPlan([Piece(duration, np.array(one), np.array(other)) for duration, one, other in pieces], 3.5)
    np.testing.assert_allclose(offset, plan.at(left)[1] - feet[1].xy, atol=1e-12)


def test_a_stop_ends_the_plan_between_the_feet() -> None:
    still = Command()
    walker = after(still, phase=SHIFT, stance=LEFT, walking=False)
    pieces = walker.native.pieces
    assert [p[0] for p in pieces] == pytest.approx([GAIT.single, GAIT.first, 0.5])
    middle = 0.5 * (np.array(walker.state.holds[LEFT][1:3]) + walker.state.nominal[1:3])
    np.testing.assert_allclose([p[2] for p in pieces], [walker.state.holds[LEFT][1:3], middle, middle])
    pieces = after(still, phase=SWING, stance=LEFT, walking=False).native.pieces
    assert [p[0] for p in pieces] == pytest.approx([GAIT.first, 0.5])
    np.testing.assert_allclose([p[2] for p in pieces], np.zeros((2, 2)), atol=1e-12)


def test_the_time_to_stop_covers_every_step() -> None:
    ability = made().ability
    for pace in (Command(), Command(0.05), Command(0.3), Command(0.3, 0.05, 0.4)):
        walker = _session.Walker(parts())
        walker.state.pace = pace.forward, pace.left, pace.turn
        count, now = 0, pace
        while now != Command():
            now, count = ability.paced(now, Command()), count + 1
        assert walker.stopping_time == pytest.approx((max(count, 1) + 1) * Gait().period + 2.0 * Gait().first)


@pytest.mark.parametrize("stance", [LEFT, RIGHT])
def test_a_landed_foot_is_the_next_to_stand_on(stance: int) -> None:
    walker, soles = Alone(), [(0.0, 0.1, 0.0, 0.0), (0.0, -0.1, 0.0, 0.0)]
    soles[1 - stance] = (0.2, soles[1 - stance][1], 0.004, 0.3)
    for k in range(20):
        walker.set(phase=SWING, stance=stance, t=0.6, duration=0.6, walking=True)
        walker.set(swing=swing((0.0, 0.0, 0.01, 0.0), (0.0, 0.0, 0.0, 0.0), time=0.6))
        walker.at(soles)
        assert walker.state.stance == 1 - stance
        assert walker.state.holds[1 - stance] == pytest.approx(place(1 - stance, *soles[1 - stance][:2], 0.3, 0.004))
        assert walker.state.holds[stance] == place(stance, *HERE[stance][:2])
        assert abs(walker.state.share - stance) <= DT / TAKE  # the other foot still bears it all
        assert walker.state.sunk[1 - stance] == pytest.approx(max(0.7 * (0.004 - 0.01) * (k + 1), -SAG))
        assert walker.state.sunk[stance] == 0.0


def test_a_walker_measures_itself() -> None:
    walker = made()
    state = walker.robot.state(walker.start)
    places = [state.position(foot.frame) + state.rotation(foot.frame) @ [*foot.middle, 0.0] for foot in walker.feet]
    width = abs(places[0][1] - places[1][1])
    assert walker.height == pytest.approx(state.com()[2] - np.mean([p[2] for p in places]), abs=1e-6)
    assert walker.omega == pytest.approx(math.sqrt(9.81 / walker.height), rel=1e-3)
    assert walker.weight == pytest.approx(9.81 * walker.robot.mass, rel=1e-3)
    reach = walker.footsteps.reach
    assert walker.footsteps.width == pytest.approx(width, abs=1e-6)
    assert reach.forward == pytest.approx(0.5 * walker.height)
    assert reach.most == pytest.approx(width + 0.15 * walker.height, abs=1e-6)
    sole = max(np.ptp([y for _, y in foot.corners]) for foot in walker.feet)
    assert reach.least == pytest.approx(min(max(sole + 0.02, 0.5 * width), 0.7 * width), abs=1e-6)
    assert walker.ability.reach.forward == pytest.approx(0.8 * reach.forward)
    np.testing.assert_array_equal(parts()["limits"], walker.robot.effort_limit[walker.robot.actuated])
    assert parts()["gait"] == (0.6, 0.15, 0.6, 0.05, 0.1, 0.4)


# ------------------------------------------------------------------------------------------ swing reference


def swinging(foot: Any, *, t: float, size: float = 5.0, **changed: Any) -> Alone:
    """The right foot swings, with a path from (0.3, -0.1, 0.01, 0.4) and its sole at `foot`."""
    path = swing((0.3, -0.1, 0.01, 0.4), (0.35, -0.1, 0.0, 0.4))
    path.time = t
    planned = place(LEFT, 0.0, 0.1), place(RIGHT, 0.35, -0.1, 0.4), (0.0, 0.0), 0.5
    fields: dict[str, Any] = {"sunk": (0.9, 0.006), "planned": planned, "target": planned[1], **changed}
    walker = Alone(size, phase=SWING, stance=LEFT, t=t, duration=0.5, swing=path, **fields)
    walker.at((HERE[0], foot))
    return walker


@pytest.mark.parametrize(("t", "sinks"), [(0.03, 0.2), (0.2, 1.0)])
def test_a_swing_foot_is_sent_along_its_path(t: float, sinks: float) -> None:
    expected = swing((0.3, -0.1, 0.01, 0.4), (0.35, -0.1, 0.0, 0.4), time=t)
    expected.step(DT)
    x, y, z, yaw = expected.x
    native = swinging((0.3, -0.1, 0.01, 0.0), t=t).native
    target = native.swing.reshape(4, 4)
    np.testing.assert_allclose(target[:3, :3], about_vertical(yaw))
    np.testing.assert_allclose(target[:3, 3], [x, y, z - 0.006 * sinks], atol=1e-12)
    np.testing.assert_array_equal(target[3], [0.0, 0.0, 0.0, 1.0])
    for found, part in ((native.swing_velocity, expected.v), (native.swing_acceleration, expected.a)):
        np.testing.assert_allclose(found, [*part[:3], 0.0, 0.0, part[3]], atol=1e-9)
    np.testing.assert_allclose(native.state.swing.x[:3], [x, y, z])


def test_a_blocked_swing_foot_is_not_pushed_far() -> None:
    native = swinging((0.2, -0.1, 0.05, 0.0), t=0.03).native
    np.testing.assert_allclose(native.state.swing.x[:3], [0.2 + AHEAD, -0.1, 0.05 - AHEAD])
    np.testing.assert_allclose(native.swing.reshape(4, 4)[:2, 3], [0.2 + AHEAD, -0.1])


def test_inside_the_sole_a_step_stays_as_planned() -> None:
    walker = swinging((0.3, -0.1, 0.01, 0.0), t=0.2, target=place(RIGHT, 0.9, 0.9))
    assert not walker.state.edge
    assert walker.state.target == walker.state.planned[1]
    assert (walker.state.duration, walker.state.swing.duration) == (0.5, 0.5)


@pytest.mark.parametrize(("t", "speed"), [(0.3, CORRECTION), (0.5 - 0.5 * LAST, CREEPS)])
def test_a_goal_creeps_shortly_before_the_landing(t: float, speed: float) -> None:
    planned = place(LEFT, 0.0, 0.1), place(RIGHT, 0.5, -0.1, 0.4), (0.0, 0.0), 0.5
    goal = swinging((0.3, -0.1, 0.01, 0.0), t=t, planned=planned).state.swing.goal
    assert math.dist(goal[:2], (0.35, -0.1)) == pytest.approx(speed * DT)


@pytest.mark.parametrize("push", [(0.3, 0.0), (-0.3, 0.0), (0.0, 0.3), (0.0, -0.4), (0.2, 0.2)])
def test_a_push_moves_the_landing_as_the_adjustment_says(push: tuple[float, float]) -> None:
    """Foothold and time of ``adjust`` for the walker's error and ZMP, the time at a bounded rate."""
    foot, t = (0.2, -0.1, 0.03, 0.0), 0.2
    walker = Alone(
        0.02, phase=SWING, stance=LEFT, t=t, duration=0.5, walking=True, pace=(0.1, 0.0, 0.0), command=(0.1, 0.0, 0.0),
        planned=(place(LEFT, 0.0, 0.1), place(RIGHT, 0.1, -0.1), (0.0, 0.0), 0.5),
        swing=swing((foot[0], foot[1], 0.03, 0.0), (0.1, -0.1, 0.0, 0.0), time=t),
    )  # fmt: skip
    before, soonest = walker.state.swing.x, walker.state.swing.soonest
    assert soonest > 0.05
    walker.at((HERE[0], foot), velocity=(*push, 0.0))
    balance = np.array(walker.native.balance)
    xi = np.array(walker.state.capture_point)
    np.testing.assert_allclose(xi, np.array(push) / 3.5)
    wanted = balance[:2] + (1.0 + 3.0 / 3.5) * (xi - balance[2:])
    corners = np.array(HERE[LEFT][:2]) + 0.02 * SQUARE
    ankle = nearest(corners[hull(corners)], wanted) - balance[:2]
    assert walker.state.edge
    landing = Landing(
        stance=Foothold(LEFT, 0.0, 0.1), foothold=Foothold(RIGHT, 0.1, -0.1), offset=np.zeros(2), left=0.5 - t
    )
    footsteps = Footsteps(period=GAIT.single + GAIT.double, width=0.2, reach=REACH)
    expected, left = adjust(
        landing, footsteps, xi - balance[2:], ankle, 3.5, now=np.array(before[:2]), soonest=soonest,
        latest=1.6 * GAIT.single - t, usual=GAIT.single - t, speed=CORRECTION, least=0.015,
    )  # fmt: skip
    assert walker.state.target == pytest.approx((RIGHT, expected.x, expected.y, expected.z, expected.yaw), abs=1e-9)
    later = left - (0.5 - t)
    moved = math.copysign(min(3.0 * DT, abs(later)), later) if abs(later) > DT else 0.0
    assert walker.state.duration == pytest.approx(0.5 + moved)
    assert walker.state.swing.duration == walker.state.duration


# ------------------------------------------------------------------------------------------------ commands


def test_go_and_stop_say_what_is_followed() -> None:
    walker = Walker(hqp.robots.load("g1", rotors=True), dt=DT, deadline=math.inf)
    walker.go(0.1, 0.02, 0.1)
    assert (walker.command, walker.why, walker.walking) == (Command(0.1, 0.02, 0.1), (), True)
    walker.go()
    assert walker.command == Command()
    walker.go(9.0)
    assert (walker.command.left, walker.command.turn) == (0.0, 0.0)
    assert walker.command.forward == pytest.approx(walker.ability.reach.forward / (2.0 / 3.0 * walker.gait.period))
    assert "knees" in walker.why[0]
    walker.stop()
    assert (walker.command, walker.walking) == (Command(), False)
    walker.session.stop("a door")
    walker.go(0.1)
    assert (walker.command, walker.walking) == (Command(), False)
    assert "a door" in walker.why[0]


@pytest.mark.parametrize("wrong", [math.nan, math.inf])
def test_a_state_that_is_not_finite_leaves_no_trace(wrong: float) -> None:
    """The tick after it has the references of a walker that has not seen it."""
    one, other = Alone(command=(0.1, 0.0, 0.0), walking=True), Alone(command=(0.1, 0.0, 0.0), walking=True)
    com = 0.001, 0.002, HEIGHT - 0.003
    one.at(com=(wrong, 0.0, HEIGHT))
    one.at(((0.0, wrong, 0.0, 0.0), HERE[1]))
    for walker in (one, other):
        walker.at(com=com)
    assert np.isfinite(one.native.balance).all()
    assert (list(one.native.balance), one.native.height) == (list(other.native.balance), other.native.height)
    assert PHASES[one.state.phase] == "stand"
