"""Footholds as the input of a walker: each is stepped on, or the nearest one within reach with a reason."""

from __future__ import annotations

import math
from pathlib import Path
from typing import Any

import numpy as np
import pytest

import hqp.robots
from hqp.angles import wrapped
from hqp.errors import DeclarationError
from hqp.walking import LEFT, RIGHT, Foothold, Walker, Walkers
from hqp.walking.footsteps import rotation
from hqp.walking.plan import _loads as loads
from hqp.walking.plan import advance
from tests.scenes.walkers import DT, made


def seen(one: Foothold, stance: Foothold) -> tuple[float, float, float, float]:
    """Place of a foothold from the foot that stands: ahead, out, up [m], turned [rad]."""
    x, y = rotation(-stance.yaw) @ (one.xy - stance.xy)
    return float(x), float(y if one.side == LEFT else -y), one.z - stance.z, wrapped(one.yaw - stance.yaw)


def route(rng: np.random.Generator, walker: Walker, count: int, size: float) -> list[Foothold]:
    """Footholds in turn that take ``size`` of the reach of a planned step: above 1 some are out of reach."""
    reach, width, up = walker.ability.reach, walker.ability.width, 0.05 * walker.height * walker.gait.period
    side = int(rng.integers(2))
    found, stance = [], walker.holds[1 - side]
    for _ in range(count):
        out = width + rng.uniform(-0.3, 1.0) * size * (reach.most - width)
        step = size * rng.uniform(-1.0, 1.0) * reach.forward, out if side == LEFT else -out
        x, y = stance.xy + rotation(stance.yaw) @ step
        turn = size * rng.uniform(-0.5, 0.5) * reach.turn
        rise = size * rng.uniform(-1.0, 1.0) * up
        stance = Foothold(side, float(x), float(y), stance.z + rise, stance.yaw + turn)
        found.append(stance)
        side = 1 - side
    return found


def walk(walker: Walker, most: float = 20.0) -> list[Foothold]:
    """Walk on the walker's own model until it stands; return the landed footholds."""
    q, v, landed = walker.start, np.zeros(walker.robot.nv), []
    while walker.time < most:
        q, v, _ = advance(walker, q, v)
        if walker.event in ("shift", "stand") and walker._state.stepped:
            landed.append(walker.holds[walker.stance])
        if not walker.walking and walker._native.stands:
            break
    return landed


@pytest.mark.long
@pytest.mark.parametrize("seed", range(4))
def test_a_route_within_reach_is_walked_as_it_is(robot: Any, seed: int) -> None:
    walker = made(robot)
    wanted = route(np.random.default_rng(seed), walker, 5, 0.7)
    wanted = [Foothold(one.side, one.x, one.y, 0.0, one.yaw) for one in wanted]  # the model's ground is level
    walker.follow(wanted)
    assert walker.walking
    landed = walk(walker)
    assert walker.why == ()
    assert not walker.walking
    assert walker.ahead == ()
    assert [one.side for one in landed] == [one.side for one in wanted]
    for found, asked in zip(landed, wanted, strict=True):
        assert np.abs(found.xy - asked.xy).max() < 0.01
        assert abs(wrapped(found.yaw - asked.yaw)) < 0.03
    assert walker.phase == "stand"
    middle = 0.5 * (wanted[-1].xy + wanted[-2].xy)
    assert np.abs(walker.capture_point - middle).max() < 0.02


@pytest.mark.parametrize("seed", range(20))
def test_footholds_out_of_reach_give_way_to_the_nearest_with_a_reason(robot: Any, seed: int) -> None:
    walker = made(robot)
    reach, up = walker.ability.reach, 0.05 * walker.height * walker.gait.period
    wanted = route(np.random.default_rng(seed), walker, 8, 0.7 if seed % 4 == 0 else 1.6)
    walker.step(walker.robot.state(walker.start, np.zeros(robot.nv)))
    walker.follow(wanted)
    ahead, changed = walker.ahead, set()
    stance = walker.holds[1 - wanted[0].side]
    assert len(ahead) == len(wanted)
    before = stance.z
    for k, (asked, found) in enumerate(zip(wanted, ahead, strict=True)):
        x, out, rise, turn = seen(asked, stance)
        at = seen(found, stance)
        assert abs(at[0]) <= reach.forward + 1e-9
        assert reach.least - 1e-9 <= at[1] <= reach.most + 1e-9
        assert abs(at[2]) <= up + 1e-9
        assert abs(at[3]) <= reach.turn + 1e-9
        rise = asked.z - before
        for name, one, other in zip(("ahead", "aside", "up", "rad"), (x, out, rise, turn), at, strict=True):
            if abs(one - other) > 1e-6:
                changed.add((k + 1, name))
        assert at[0] == pytest.approx(np.clip(x, -reach.forward, reach.forward), abs=1e-9)
        assert at[3] == pytest.approx(np.clip(turn, -reach.turn, reach.turn), abs=1e-9)
        before, stance = found.z, found
    said = set()
    for text in walker.why:
        number, side = text.split(":")[0].removeprefix("foothold ").split(", ")
        assert side == ("left", "right")[wanted[int(number) - 1].side]
        said |= {(int(number), name) for name in ("ahead", "aside", "up", "rad") if f" {name}" in text.split(":")[1]}
    assert said == changed
    assert bool(changed) == (seed % 4 != 0)


@pytest.mark.long
@pytest.mark.parametrize("moment", ["shift", "swing"])
@pytest.mark.parametrize("first", [LEFT, RIGHT])
def test_the_foot_whose_turn_it_is_steps_in_place_first(robot: Any, moment: str, first: int) -> None:
    walker = made(robot)
    walker.go(forward=0.1)
    q, v = walker.start, np.zeros(robot.nv)
    while walker.phase != moment or walker.time < 2.0:
        q, v, _ = advance(walker, q, v)
    stands = walker.stance if moment == "shift" else 1 - walker.stance  # while the first foot of the route swings
    at = walker._state.nominal if moment == "swing" else walker.holds[stands]
    at = at if isinstance(at, Foothold) else Foothold(*at)
    wanted = [walker.footsteps.next(at, walker.command)]
    if wanted[0].side != first:
        wanted = [walker.footsteps.next(wanted[0], walker.command)]
    walker.follow(wanted)
    assert [one.side for one in walker.ahead] == ([first] if first != at.side else [1 - first, first])
    assert [text.split(":")[0] for text in walker.why] == ["foothold 0, " + ("left", "right")[1 - first]] * (
        first == at.side
    )
    while walker.walking or not walker._native.stands:
        q, v, _ = advance(walker, q, v)
        assert walker.time < 10.0
    assert np.abs(walker.holds[first].xy - wanted[0].xy).max() < 0.01


@pytest.mark.long
def test_a_stop_and_a_velocity_end_a_route(robot: Any) -> None:
    for order in ("stop", "go", "session"):
        walker = made(robot)
        walker.follow(route(np.random.default_rng(1), walker, 6, 0.5))
        q, v = walker.start, np.zeros(robot.nv)
        while len(walker.ahead) > 4 or walker.phase != "swing":
            q, v, _ = advance(walker, q, v)
        if order == "session":
            walker.session.stop("operator")
            advance(walker, q, v)
        else:
            getattr(walker, order)()
        assert len(walker.ahead) == 0
        assert walker.walking == (order == "go")
        if order != "stop":
            continue
        while not walker._native.stands:
            q, v, _ = advance(walker, q, v)
            assert walker.time < 10.0
        x, out, _, _ = seen(walker.holds[LEFT], walker.holds[RIGHT])
        assert abs(x) < 0.01
        assert out == pytest.approx(walker.footsteps.width, abs=0.01)


def test_a_stopped_session_does_not_follow(robot: Any) -> None:
    walker = made(robot)
    walker.session.stop("operator")
    walker.follow([walker.holds[LEFT]])
    assert not walker.walking
    assert "operator" in walker.why[0]


@pytest.mark.long
def test_a_plan_follows_the_route(robot: Any) -> None:
    walker = made(robot)
    wanted = route(np.random.default_rng(3), walker, 3, 0.5)
    walker.follow(wanted)
    motion = walker.plan(8.0)
    assert len(walker.ahead) == 3
    state = walker.robot.state(motion.q[-1])
    for one in wanted[-2:]:
        assert np.abs(walker.feet[one.side].placed(state).xy - one.xy).max() < 0.01


@pytest.mark.long
def test_a_batch_follows_with_the_bits_of_a_single_walker(robot: Any) -> None:
    single, batch = made(robot), Walkers(made(robot), 2, threads=1)
    wanted = route(np.random.default_rng(5), single, 2, 1.2)
    single.follow(wanted)
    batch.follow(wanted, worlds=[1])
    q, v = single.start, np.zeros(robot.nv)
    for _ in range(round(3.0 / DT)):
        felt = loads(single, single.robot.state(q, v))
        found = batch.step([q, q], [v, v], [felt, felt])
        q, v, tick = advance(single, q, v)
        np.testing.assert_array_equal(found.commands[1], tick.command)
    assert batch.why(1) == single.why != ()
    assert batch.phases[0] == "stand"


@pytest.mark.long
def test_bad_footholds_are_named(robot: Any, tmp_path: Path) -> None:
    walker = made(robot)
    left = walker.holds[LEFT]
    for wanted, match in (
        ([left, left], "side"),
        ([Foothold(2, 0.0, 0.0)], "side"),
        ([left, Foothold(RIGHT, math.nan, 0.0)], "bad x"),
        ([Foothold(LEFT, 0.0, 0.0, 0.0, math.inf)], "bad yaw"),
    ):
        with pytest.raises(DeclarationError, match=match):
            walker.follow(wanted)
        with pytest.raises(DeclarationError, match=match):
            Walkers(walker, 1).follow(wanted)
    assert not walker.walking
    walker.follow([])
    assert not walker.walking


@pytest.mark.parametrize(("name", "seed"), [("g1", 0), pytest.param("talos", 1, marks=pytest.mark.long)])
def test_a_route_is_walked_in_mujoco(name: str, seed: int) -> None:
    """Noise, 4 ms of delay: it lands near each foothold, does not fall, and stands on the last two."""
    pytest.importorskip("mujoco")
    from hqp.walking.course import Course

    walker = Walker(hqp.robots.load(name, rotors=True), deadline=math.inf)
    course = Course(walker, seed=seed)
    while course.plant.time < 1.0:
        course.step()
    walker.follow(route(np.random.default_rng(seed), walker, 6, 0.7))
    wanted, landed = list(walker.ahead), 0
    while walker.walking or not walker._native.stands:
        course.step()
        assert not course.fallen
        assert course.plant.time < 15.0
        if walker.event in ("shift", "stand") and walker._state.stepped:
            foot = walker.feet[wanted[landed].side]
            at, turned = course.plant.place(foot.frame)
            assert np.abs((at + turned @ [*foot.middle, 0.0])[:2] - wanted[landed].xy).max() < 0.015
            landed += 1
    assert landed == 6
    assert walker.why == ()
