"""Parts of a walker alone, each against its own equation: yaw, share, height, landing, load, plan, swing reference."""

from __future__ import annotations

import math
from collections.abc import Callable
from functools import cache
from itertools import pairwise
from types import SimpleNamespace
from typing import Any

import numpy as np
import pytest

import hqp.robots
from hqp.angles import wrapped
from hqp.estimation.rotations import about_vertical
from hqp.walking import Command, Foothold, Gait, Swing, Walker
from hqp.walking import walker as room
from hqp.walking.footsteps import LEFT, RIGHT
from hqp.walking.pendulum import Piece
from hqp.walking.preview import Ability
from hqp.walking.walker import AHEAD, CORRECTION, CREEPS, EARLY, FADE, HEAVIER, LAST, LATE, SAG, TAKE, TOUCH, WEIGHING

DT = 0.004
methods: Any = vars(Walker)


def foothold(side: int, x: float, y: float, yaw: float = 0.0, z: float = 0.0) -> Foothold:
    return Foothold(side, x, y, z, yaw)


@cache
def made() -> Walker:
    return Walker(hqp.robots.load("g1", rotors=True), dt=DT, deadline=math.inf)


# ---------------------------------------------------------------------------------------------------- yaw


@pytest.mark.parametrize("stance", [LEFT, RIGHT])
@pytest.mark.parametrize(("one", "other"), [(0.1, 0.5), (-0.3, 0.2), (3.0, -3.0), (-2.9, 3.1)])
@pytest.mark.parametrize("phase", ["stand", "swing"])
def test_the_trunk_aims_half_way_between_the_feet(phase: str, one: float, other: float, stance: int) -> None:
    elsewhere = foothold(1 - stance, 0.0, 0.0, 1.3)
    there = foothold(1 - stance, 0.0, 0.0, other)
    holds = [elsewhere if phase == "swing" else there] * 2
    holds[stance] = foothold(stance, 0.0, 0.0, one)
    part = SimpleNamespace(stance=stance, phase=phase, holds=holds, _target=there if phase == "swing" else elsewhere)
    yaw = methods["_mean_yaw"](part)
    assert wrapped(yaw - one) == pytest.approx(0.5 * wrapped(other - one), abs=1e-12)
    assert wrapped(other - yaw) == pytest.approx(0.5 * wrapped(other - one), abs=1e-12)


@pytest.mark.parametrize(("start", "goal"), [(0.0, 0.002), (0.0, 0.5), (3.1, -3.1), (0.4, 0.1)])
def test_the_trunk_turns_the_short_way_at_a_bounded_rate(start: float, goal: float) -> None:
    part = SimpleNamespace(dt=DT, _yaw=start, _mean_yaw=lambda: goal)
    way, yaw = wrapped(goal - start), start
    for k in range(1, 400):
        yaw = methods["_next_yaw"](part)
        assert wrapped(yaw - start) == pytest.approx(math.copysign(min(abs(way), 0.8 * DT * k), way), abs=1e-9)
    assert wrapped(goal - yaw) == pytest.approx(0.0, abs=1e-9)


# -------------------------------------------------------------------------------------------------- share


def share_of(along: float, **changed: Any) -> Any:
    """A walker whose ZMP is at a share of the way from the left foot to the right."""
    holds = [foothold(LEFT, 0.2, 0.4), foothold(RIGHT, 0.5, -0.1)]
    zmp = holds[0].xy + along * (holds[1].xy - holds[0].xy) + 0.07 * np.array([0.5, 0.3])
    fields: dict[str, Any] = {"holds": holds, "phase": "stand", "_T": 0.6, "_t": 0.0, "dt": DT, "stance": RIGHT}
    part = SimpleNamespace(**{**fields, "_share": 0.5, **changed})
    return part, zmp


@pytest.mark.parametrize(("along", "expected"), [(0.3, 0.3), (0.75, 0.75), (-0.4, 0.0), (1.2, 1.0)])
def test_a_foot_bears_as_much_as_the_zmp_is_near_it(along: float, expected: float) -> None:
    part, zmp = share_of(along)
    shares = [methods["_next_share"](part, zmp) for _ in range(60)]
    assert shares[-1] == pytest.approx(expected, abs=1e-9)
    steps = np.abs(np.diff([0.5, *shares]))
    assert steps.max() == pytest.approx(min(DT / TAKE, abs(expected - 0.5)))
    assert shares[0] == pytest.approx(0.5 + math.copysign(steps[0], expected - 0.5))


@pytest.mark.parametrize("stance", [LEFT, RIGHT])
def test_a_shift_ends_with_all_on_the_stance_foot(stance: int) -> None:
    for left, expected in ((2.0 * TAKE + 0.01, 0.4), (1.5 * TAKE, 0.4 + 0.5 * (stance - 0.4)), (0.5 * TAKE, stance)):
        part, zmp = share_of(0.4, phase="shift", stance=stance, _t=0.6 - left, _share=expected)
        assert methods["_next_share"](part, zmp) == pytest.approx(expected, abs=1e-9)


# ------------------------------------------------------------------------------------------------- height


@pytest.mark.parametrize(("phase", "ground"), [("swing", 0.06), ("stand", 0.02), ("shift", 0.02)])
def test_the_height_rises_slowly_to_that_above_the_feet(phase: str, ground: float) -> None:
    holds = [foothold(LEFT, 0.0, 0.1, z=-0.02), foothold(RIGHT, 0.0, -0.1, z=0.06)]
    for start in (0.6, 0.9):
        part = SimpleNamespace(holds=holds, stance=RIGHT, phase=phase, height=0.7, dt=DT, _z=start, _raised=0.0)
        for k in range(1, 4000):
            wanted = methods["_height"](part, part._z)  # no deficit but that of this tick's rise
            way = ground + 0.7 - start
            expected = start + math.copysign(min(abs(way), 0.05 * 0.7 * DT * k), way)
            assert part._z == pytest.approx(expected, abs=1e-9)
            assert wanted == part._z + part._raised
        assert part._z == pytest.approx(ground + 0.7)


def test_a_deficit_raises_the_height_by_its_integral() -> None:
    part = SimpleNamespace(holds=[foothold(s, 0.0, 0.0) for s in (0, 1)], stance=0, phase="stand", height=0.7, dt=DT)
    for deficit in (0.003, -0.002):
        part._z, part._raised = 0.7, 0.001
        found = [methods["_height"](part, 0.7 - deficit) - 0.7 for _ in range(10)]
        np.testing.assert_allclose(found, 0.001 + 2.0 * DT * deficit * np.arange(1, 11), atol=1e-12)


# ------------------------------------------------------------------------------------------------ landing


def landing(
    *, share: float, t: float, z: float, path: float, goal: float = 0.0, stance: int = RIGHT
) -> tuple[Any, Any]:
    cleared: list[float] = []
    swing = SimpleNamespace(
        x=np.array([0.0, 0.0, path, 0.0]), goal=np.array([0.0, 0.0, goal, 0.0]), clear=cleared.append
    )
    feet = [SimpleNamespace(frame=name) for name in ("left", "right")]
    gait = Gait(patience=0.3)
    part = SimpleNamespace(_t=t, _T=0.5, _swing=swing, stance=stance, weight=400.0, feet=feet, gait=gait)
    state = SimpleNamespace(position=lambda frame: np.array([0.0, 0.0, {"left": z, "right": 9.0}[frame]]))
    loads = np.array([share * 400.0, 9000.0])
    return methods["_landed"](part, state, loads), cleared


def test_a_foot_lands_with_load_near_its_path_or_its_goal() -> None:
    early, before, after = 0.5 * EARLY - 0.01, 0.4, 0.51
    held: dict[str, Any] = {"z": 0.03, "path": 0.03}
    assert not landing(share=0.9, t=early, **held)[0]
    assert landing(share=TOUCH + 0.01, t=before, **held)[0]
    assert not landing(share=TOUCH - 0.01, t=before, **held)[0]
    assert landing(share=LATE + 0.001, t=after, **held)[0]
    assert not landing(share=LATE - 0.001, t=after, **held)[0]
    assert landing(share=0.0, t=0.81, **held)[0]
    assert not landing(share=0.0, t=0.79, **held)[0]


@pytest.mark.parametrize(
    ("z", "path", "goal", "lands"),
    [(0.026, 0.03, 0.0, True), (0.024, 0.03, 0.0, False), (0.0, 0.019, 0.0, True), (0.0, 0.021, 0.0, False),
     (0.0, 0.035, 0.02, True)],
)  # fmt: skip
def test_a_loaded_foot_far_from_both_has_scuffed(z: float, path: float, goal: float, lands: bool) -> None:
    found, cleared = landing(share=0.2, t=0.4, z=z, path=path, goal=goal)
    assert (found, cleared) == (lands, [] if lands else [z])


def test_without_loads_a_foot_lands_in_time() -> None:
    found = [methods["_landed"](SimpleNamespace(_t=t, _T=0.5), None, None) for t in (0.499, 0.5, 0.6)]
    assert found == [False, True, True]


# --------------------------------------------------------------------------------------------------- load


@pytest.mark.parametrize(("share", "expected"), [(1.1, 1.1), (0.9, 0.9), (1.4, 1.0 + HEAVIER), (0.6, 1.0 - HEAVIER)])
def test_the_mean_load_says_how_heavy_a_robot_is(share: float, expected: float) -> None:
    part = SimpleNamespace(weight=300.0, dt=DT, time=0.0, heavier=1.0, _mean=1.0)
    for _ in range(5000):
        methods["_weigh"](part, share * 300.0)
        part.time += DT
    assert part.heavier == pytest.approx(expected, abs=1e-9)
    last = part._mean
    for load in (0.49, 1.51, 0.0):
        methods["_weigh"](part, load * 300.0)
    assert part._mean == last
    methods["_weigh"](part, 300.0)
    assert part._mean - last == pytest.approx(DT / WEIGHING * (1.0 - last))


def test_the_first_loads_are_averaged() -> None:
    part, loads = SimpleNamespace(weight=300.0, dt=DT, time=0.0, heavier=1.0, _mean=1.0), [1.2, 0.9, 1.1, 0.95]
    methods["_weigh"](part, loads[0] * 300.0)
    assert part._mean == pytest.approx(loads[0])
    part.time = 100 * DT
    methods["_weigh"](part, loads[1] * 300.0)
    assert part._mean == pytest.approx(loads[0] + (loads[1] - loads[0]) / 100.0)


def test_torques_go_on_from_those_before_a_switch() -> None:
    limit = np.array([100.0, 50.0, 20.0])
    part = SimpleNamespace(
        heavier=1.1, event="", _sent=None, _rest=np.zeros(3), _limit=limit, _fading=limit * DT / FADE
    )
    first = np.array([10.0, -20.0, 19.0])
    methods["_bound"](part, first)
    np.testing.assert_allclose(first, [11.0, -22.0, 20.0])  # scaled, within the limits
    part.event = "swing"
    jumped = np.array([40.0, 10.0, -10.0])
    methods["_bound"](part, jumped)
    np.testing.assert_allclose(jumped, first + np.sign([1, 1, -1]) * limit * DT / FADE)
    part.event = ""
    last = jumped
    for _ in range(40):
        now = np.array([40.0, 10.0, -10.0])
        methods["_bound"](part, now)
        assert np.all(np.abs(now - last) <= limit * DT / FADE + 1e-9)
        last = now
    np.testing.assert_allclose(last, [44.0, 11.0, -11.0])


# --------------------------------------------------------------------------------------------------- plan


def planned(monkeypatch: pytest.MonkeyPatch, **changed: Any) -> tuple[Walker, list[Piece]]:
    """Pieces of the plan of a walker that walks ahead, in a state."""
    walker, seen = made(), []
    monkeypatch.setattr(room, "DcmPlan", lambda pieces, omega: seen.append((pieces, omega)))
    fields: dict[str, Any] = {
        "phase": "shift", "stance": LEFT, "walking": True, "command": Command(0.2), "_pace": Command(0.2),
        "_t": 0.1, "_T": 0.5, "_zmp": np.array([0.01, 0.02]), "_nominal": foothold(RIGHT, 0.3, -0.1),
        "holds": [foothold(LEFT, 0.1, 0.1), foothold(RIGHT, -0.05, -0.1)], **changed,
    }  # fmt: skip
    for name, value in fields.items():
        monkeypatch.setattr(walker, name, value, raising=False)
    walker._plan()
    assert seen[0][1] == walker.omega
    assert walker._since == 0.0
    return walker, seen[0][0]


def continuous(pieces: list[Piece], start: Any) -> None:
    at = start
    for piece in pieces:
        np.testing.assert_array_equal(piece.start, at)
        assert piece.duration > 0.0
        at = piece.end


def test_a_shift_is_followed_by_three_steps(monkeypatch: pytest.MonkeyPatch) -> None:
    walker, pieces = planned(monkeypatch)
    haste, gait = walker.ability.haste(Command(0.2)), walker.gait
    single, double = haste * gait.single, haste * gait.double
    assert [p.duration for p in pieces] == pytest.approx([0.4, *3 * [single, double], single, 0.5])
    continuous(pieces, walker._zmp)
    feet = [walker.holds[LEFT]]
    for _ in range(3):
        feet.append(walker._next(feet[-1], Command(0.2)))
    expected = [feet[0].xy, *(foot.xy for pair in pairwise(feet) for foot in pair), feet[3].xy]
    np.testing.assert_allclose([p.end for p in pieces], [*expected, feet[3].xy])


def test_a_swing_goes_on_to_where_its_foot_was_to_land(monkeypatch: pytest.MonkeyPatch) -> None:
    walker, pieces = planned(monkeypatch, phase="swing")
    haste, gait = walker.ability.haste(Command(0.2)), walker.gait
    single, double = haste * gait.single, haste * gait.double
    assert [p.duration for p in pieces] == pytest.approx([0.4, double, *2 * [single, double], single, 0.5])
    continuous(pieces, walker._zmp)
    np.testing.assert_allclose(pieces[0].end, walker.holds[LEFT].xy)
    np.testing.assert_allclose(pieces[1].end, walker._nominal.xy)
    np.testing.assert_allclose(pieces[3].end, walker._next(walker._nominal, Command(0.2)).xy)


def test_a_stop_ends_the_plan_between_the_feet(monkeypatch: pytest.MonkeyPatch) -> None:
    walker, pieces = planned(monkeypatch, phase="swing", walking=False, command=Command(), _pace=Command())
    assert [p.duration for p in pieces] == pytest.approx([0.4, walker.gait.first, 0.5])
    middle = 0.5 * (walker.holds[LEFT].xy + walker._nominal.xy)
    np.testing.assert_allclose([p.end for p in pieces], [walker.holds[LEFT].xy, middle, middle])
    walker, pieces = planned(monkeypatch, phase="stand", walking=False)
    middle = 0.5 * (walker.holds[LEFT].xy + walker.holds[RIGHT].xy)
    assert [p.duration for p in pieces] == pytest.approx([0.4, 0.5])
    np.testing.assert_allclose([p.end for p in pieces], [middle, middle])
    assert planned(monkeypatch, phase="stand", _t=0.6)[1][0].duration == DT


def test_the_time_to_stop_covers_every_step() -> None:
    ability = Ability(gait=Gait(), reach=made().ability.reach, width=0.2, height=0.7, gravity=9.81)
    for pace in (Command(), Command(0.05), Command(0.3), Command(0.3, 0.05, 0.4)):
        part = SimpleNamespace(ability=ability, _pace=pace, gait=Gait())
        steps, now = 0, pace
        while now != Command():
            now, steps = ability.paced(now, Command()), steps + 1
        found: Callable[[Any], float] = methods["stopping_time"].fget
        assert found(part) == pytest.approx((max(steps, 1) + 1) * Gait().period + 2.0 * Gait().first)


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
    np.testing.assert_allclose(walker._fading * 0.08 / DT, walker.robot.effort_limit[walker.robot.actuated])


# ------------------------------------------------------------------------------------------ phases


def machine(**changed: Any) -> Any:
    """A walker that records the phases that it enters."""
    entered: list[tuple[str, float]] = []
    feet = [SimpleNamespace(frame=name, placed=lambda _, s=s: foothold(s, 7.0, 7.0)) for s, name in enumerate("lr")]
    fields: dict[str, Any] = {
        "phase": "stand", "walking": True, "_t": 0.6, "_T": 0.6, "gait": Gait(first=0.7, single=0.5, double=0.2),
        "stance": LEFT, "command": Command(0.1), "_pace": Command(), "_haste": 0.9, "feet": feet, "_share": 0.3,
        "holds": [foothold(s, 0.0, 0.0) for s in (0, 1)], "_sunk": [0.0, 0.0], "entered": entered,
        "_swing": SimpleNamespace(x=np.array([0.0, 0.0, 0.01, 0.0])),
        "ability": SimpleNamespace(paced=lambda pace, command: command),
        "_double": lambda pace, last: 0.7 if last else 0.2,
        "_enter": lambda phase, duration, state: entered.append((phase, duration)),
        "_landed": lambda state, loads: True, **changed,
    }  # fmt: skip
    return SimpleNamespace(**fields)


STATE = SimpleNamespace(position=lambda frame: np.array([0.0, 0.0, 0.004]))


@pytest.mark.parametrize(
    ("changed", "expected"),
    [
        ({}, [("shift", 0.7)]),
        ({"walking": False}, []),
        ({"_t": 0.59}, []),
        ({"phase": "shift"}, [("swing", 0.45)]),
        ({"phase": "shift", "_t": 0.5}, []),
        ({"phase": "swing"}, [("shift", 0.2)]),
        ({"phase": "swing", "_landed": lambda state, loads: False}, []),
        ({"phase": "swing", "walking": False, "_pace": Command(0.1)}, [("shift", 0.2)]),
        ({"phase": "swing", "walking": False}, [("stand", 0.7)]),
    ],
)
def test_phases_follow_each_other(changed: dict[str, Any], expected: list[tuple[str, float]]) -> None:
    part = machine(**changed)
    methods["_advance"](part, STATE, None)
    assert part.entered == [(phase, pytest.approx(time)) for phase, time in expected]
    if part.phase == "stand" and expected:
        assert part.stance == RIGHT
    if part.phase == "shift" and expected:
        assert part._pace == Command(0.1)


@pytest.mark.parametrize("stance", [LEFT, RIGHT])
def test_a_landed_foot_is_the_next_to_stand_on(stance: int) -> None:
    part = machine(phase="swing", stance=stance)
    methods["_advance"](part, STATE, None)
    assert part.stance == 1 - stance
    assert part.holds[1 - stance] == foothold(1 - stance, 7.0, 7.0)
    assert part.holds[stance] == foothold(stance, 0.0, 0.0)
    assert part._share == stance  # the other foot still bears it all
    assert part._sunk[1 - stance] == pytest.approx(0.7 * (0.004 - 0.01))
    assert part._sunk[stance] == 0.0
    for _ in range(20):
        part.stance = stance
        methods["_advance"](part, STATE, None)
    assert part._sunk[1 - stance] == pytest.approx(-SAG)


# ------------------------------------------------------------------------------------------ swing reference


def reference(**changed: Any) -> Any:
    """Reference of a right foot at a height of 4 mm whose path is at 10 mm."""
    given: list[Any] = []

    def at(target: Any, **rates: Any) -> None:
        given.append((target, rates))

    x, v, a = np.array([0.3, -0.1, 0.01, 0.4]), np.array([1.0, 2.0, 3.0, 4.0]), np.array([5.0, 6.0, 7.0, 8.0])
    swing = SimpleNamespace(x=x.copy(), step=lambda dt: (x.copy(), v.copy(), a.copy()))
    adjusted: list[Any] = []
    fields: dict[str, Any] = {
        "_swing": swing, "stance": LEFT, "dt": DT, "_t": 0.03, "_T": 0.5, "_sunk": [0.9, 0.006],
        "feet": [SimpleNamespace(frame="l"), SimpleNamespace(frame="r")],
        "stacks": SimpleNamespace(swing=[None, SimpleNamespace(at=at)]),
        "_adjust": lambda *errors: adjusted.append(errors), **changed,
    }  # fmt: skip
    part = SimpleNamespace(**fields)
    here = {"r": np.array([0.29, -0.1, 0.004]), "l": np.full(3, 9.0)}
    where = changed.get("here", here)
    methods["_swing_reference"](part, SimpleNamespace(position=where.__getitem__), "error", "pushed")
    target, rates = given[0]
    return target, rates, swing, adjusted


def test_a_swing_foot_is_sent_along_its_path() -> None:
    target, rates, swing, adjusted = reference()
    np.testing.assert_allclose(target[:3, :3], about_vertical(0.4))
    np.testing.assert_allclose(target[:3, 3], [0.3, -0.1, 0.01 - 0.006 * 0.03 / 0.15])
    np.testing.assert_allclose(swing.x[:3], [0.3, -0.1, 0.01])
    assert rates == {"velocity": [1.0, 2.0, 3.0, 0.0, 0.0, 4.0], "acceleration": [5.0, 6.0, 7.0, 0.0, 0.0, 8.0]}
    assert adjusted == []
    target, _, _, adjusted = reference(_t=0.2)
    assert target[2, 3] == pytest.approx(0.01 - 0.006)
    assert adjusted == [("error", "pushed")]


def test_a_blocked_swing_foot_is_not_pushed_far() -> None:
    blocked = {"r": np.array([0.2, -0.1, 0.05]), "l": np.full(3, 9.0)}
    target, _, swing, _ = reference(here=blocked)
    np.testing.assert_allclose(swing.x[:3], [0.2 + AHEAD, -0.1, 0.05 - AHEAD])
    np.testing.assert_allclose(target[:2, 3], [0.2 + AHEAD, -0.1])


@pytest.mark.parametrize(("left", "speed"), [(0.3, CORRECTION), (0.5 * LAST, CREEPS)])
def test_inside_the_sole_a_step_stays_as_planned(left: float, speed: float) -> None:
    moved: list[Any] = []
    swing = SimpleNamespace(retarget=lambda *given: moved.append(given), duration=0.5, x=np.zeros(4))
    planned = SimpleNamespace(foothold=foothold(RIGHT, 0.3, -0.1))
    part = SimpleNamespace(
        _swing=swing, _planned=planned, _haste=1.0, gait=Gait(single=0.5), edge=False, _T=0.5, _t=0.5 - left, dt=DT,
        _goal=lambda: "goal", _plan=lambda: moved.append("plan"), feet=[], footsteps=None, omega=3.0,
    )  # fmt: skip
    methods["_adjust"](part, np.array([0.1, 0.1]), np.zeros(2))
    assert part._target is planned.foothold
    assert moved == [("goal", speed, DT)]
    assert (part._T, swing.duration) == (0.5, 0.5)


@pytest.mark.parametrize(("later", "expected"), [(0.1, 3.0 * DT), (-0.1, -3.0 * DT), (0.006, 0.006), (0.002, 0.0)])
def test_a_landing_time_changes_at_a_bounded_rate(
    later: float, expected: float, monkeypatch: pytest.MonkeyPatch
) -> None:
    seen: dict[str, Any] = {}

    def adjusted(*given: Any, **bounds: Any) -> tuple[Foothold, float]:
        seen.update(bounds)
        return foothold(RIGHT, 0.4, -0.1), 0.3 + later

    monkeypatch.setattr(room, "adjust", adjusted)
    swing = Swing(np.zeros(4), np.array([0.3, -0.1, 0.0, 0.0]), 0.5, 0.05)
    plans: list[int] = []
    foot = SimpleNamespace(middle=(0.02, 0.0), origin=lambda xy, yaw: xy)
    part = SimpleNamespace(
        _swing=swing, _planned=made_landing(), _haste=0.9, gait=Gait(single=0.5), edge=True, _T=0.5, _t=0.2, dt=DT,
        _goal=lambda: np.zeros(4), _plan=lambda: plans.append(1), feet=[foot, foot], footsteps=None, omega=3.0,
    )  # fmt: skip
    methods["_adjust"](part, np.array([0.1, 0.1]), np.zeros(2))
    assert part._target.x == 0.4
    found: float = part._T
    assert found == pytest.approx(0.5 + expected)
    assert swing.duration == pytest.approx(part._T)
    assert len(plans) == int(expected != 0.0)
    assert seen["soonest"] == 0.05
    assert seen["latest"] == pytest.approx(1.6 * 0.45 - 0.2)
    assert seen["usual"] == pytest.approx(0.45 - 0.2)
    assert (seen["speed"], seen["least"]) == (CORRECTION, 0.015)
    np.testing.assert_allclose(seen["now"], [0.02, 0.0])


def made_landing() -> Any:
    from hqp.walking import Landing

    return Landing(stance=foothold(LEFT, 0.0, 0.1), foothold=foothold(RIGHT, 0.3, -0.1), offset=np.zeros(2), left=0.3)


# ------------------------------------------------------------------------------------------------ commands


def test_go_and_stop_say_what_is_followed() -> None:
    session = SimpleNamespace(stopping="", stopped="")
    part = SimpleNamespace(session=session, ability=made().ability, walking=False, command=Command(), why=())
    methods["go"](part, 0.1, 0.02, 0.1)
    assert (part.command, part.why, part.walking) == (Command(0.1, 0.02, 0.1), (), True)
    methods["go"](part)
    assert part.command == Command()
    methods["go"](part, 9.0)
    assert (part.command.left, part.command.turn) == (0.0, 0.0)
    assert part.command.forward == pytest.approx(made().ability.reach.forward / (2.0 / 3.0 * made().gait.period))
    assert "knees" in part.why[0]
    methods["stop"](part)
    assert (part.command, part.walking) == (Command(), False)
    for field in ("stopping", "stopped"):
        part.session = SimpleNamespace(**{"stopping": "", "stopped": "", field: "a door"})
        methods["go"](part, 0.1)
        assert (part.command, part.walking) == (Command(), False)
        assert "a door" in part.why[0]
