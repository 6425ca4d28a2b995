"""Motion with dynamics: the schedule of soles, the plan of the CoM, and the posture that follows it."""

from __future__ import annotations

import itertools
import math
from typing import Any

import numpy as np
import pinocchio as pin
import pytest
from scipy.optimize import linprog

import hqp
from hqp.arrays import Mat, Vec
from hqp.errors import DeclarationError
from hqp.motion import Motion, Retargeted, retarget
from hqp.motion.beside import overlap
from hqp.motion.body import Body
from hqp.motion.centroidal import CentroidalPlan, Soles, Support, centroidal_plan, outside
from hqp.motion.clip import accelerated
from hqp.motion.contacts import LEVEL, runs
from hqp.motion.dynamics import TAKES, beyond, centroidal, front, shifting, strong, supports_of, zmp_outside
from hqp.motion.joints import parts_of
from hqp.motion.schedule import (
    BOTH,
    CLEAR,
    FALLING,
    FLIGHT,
    GRAVITY,
    LEAST,
    LEFT,
    LEG,
    RIGHT,
    _cheapest,
    _falling,
    from_rest,
    grounded,
    heel_off,
    levelled,
    schedule_of,
)  # fmt: skip
from hqp.motion.skeleton_map import find_map
from hqp.motion.stacks import Stacks
from hqp.motion.targets import targets_of
from hqp.motion.tracker import Tracker

from .people import crouch, stand, step_up, walk
from .robots import robot as catalogued

G, DT = 9.81, 1.0 / 60.0


def _square(x: float, y: float, half: float, height: float = 0.0, heading: float = 0.0) -> Support:
    """A square sole with its middle at x, y, everything turned by a heading [m, rad]."""
    c, s = math.cos(heading), math.sin(heading)
    own = np.array([x, y]) + half * np.array([[-1.0, -1.0], [1.0, -1.0], [1.0, 1.0], [-1.0, 1.0]])
    return Support(own @ np.array([[c, s], [-s, c]]), height)


def _drawn(seed: int, heading: float = 0.0, rise: float = 0.0, toes: bool = False) -> tuple[Mat, list[Soles], Mat]:
    """A person's CoM over steps of random length, height and time, their soles, and a random angular momentum.

    toes: true to stand on the front edge of a sole for a while before it lifts.
    """
    rng = np.random.default_rng(seed)
    supports: list[Soles] = []
    x, z, side, heights = 0.0, 0.0, 1.0, []
    for _ in range(4):
        step, up = float(rng.uniform(0.0, 0.2)), rise * float(rng.uniform(-1.0, 1.0))
        one = _square(x, side * 0.1, 0.04, z, heading)
        two = _square(x + step, -side * 0.1, 0.04, z + up, heading)
        alone, both = int(rng.integers(18, 30)), int(rng.integers(8, 14))
        edge = one._replace(corners=one.corners[1:3]) if toes else one
        supports += [(one,)] * alone + [(one, two)] * (both // 2) + [(edge, two)] * (both - both // 2)
        heights += [z] * alone + np.linspace(z, z + up, both).tolist()
        x, z, side = x + step, z + up, -side
    n = len(supports)
    times: Any = np.arange(n) * DT
    com: Any = np.column_stack((x * times / times[-1], 0.0 * times, 0.6 + 0.01 * np.sin(9.0 * times) + heights))
    c, s = math.cos(heading), math.sin(heading)
    turn = np.array([[c, -s, 0.0], [s, c, 0.0], [0.0, 0.0, 1.0]])
    spin = 0.05 * np.sin(6.0 * times)[:, None] * rng.uniform(-1.0, 1.0, 2)
    return com @ turn.T, supports, spin @ turn[:2, :2].T


def _planned(
    seed: int, heading: float = 0.0, rise: float = 0.0, toes: bool = False
) -> tuple[CentroidalPlan, list[Soles], Mat]:
    com, supports, spin = _drawn(seed, heading, rise, toes)
    return centroidal_plan(com, supports, DT, gravity=G, highest=np.full(len(com), np.inf), spin=spin), supports, spin


def _lacks(soles: Soles, com: Vec, force: Vec, spin: Vec) -> float:
    """Least moment over the mass that no forces at the corners of the soles give, with mu 0.8 and the strengths of the
    legs, by a linear program.
    """
    around = np.linspace(0.0, 2.0 * np.pi, 16, endpoint=False)
    edges = np.column_stack((0.8 * np.cos(around), 0.8 * np.sin(around), np.ones(16)))
    points = np.vstack([np.column_stack((sole.corners, np.full(len(sole.corners), sole.height))) for sole in soles])
    moments = [np.cross(p - com, edge)[:2] for p in points for edge in edges]
    sums = np.vstack((np.tile(edges.T, len(points)), np.array(moments).T))
    loose = np.vstack((np.zeros((3, 4)), np.hstack((np.eye(2), -np.eye(2)))))
    cost = np.concatenate((np.zeros(sums.shape[1]), np.ones(4)))
    owner = np.repeat(range(len(soles)), [16 * len(sole.corners) for sole in soles])
    loads = np.hstack((np.equal.outer(range(len(soles)), owner), np.zeros((len(soles), 4))))
    most = [min(sole.strength + 1e-3, 1e6) for sole in soles]
    found = linprog(cost, loads, most, A_eq=np.hstack((sums, loose)), b_eq=np.concatenate((force, spin)))
    assert found.status == 0
    return float(found.fun)


@pytest.mark.long
@pytest.mark.parametrize("toes", [False, True])
@pytest.mark.parametrize("rise", [0.0, 0.3])
@pytest.mark.parametrize("seed", [*range(3), *(pytest.param(s, marks=pytest.mark.slow) for s in range(3, 9))])
def test_forces_of_the_plan_act_inside_the_soles(seed: int, rise: float, toes: bool) -> None:
    """Forces at their corners give the CoM's acceleration and the angular momentum, on level ground and on stairs, with
    and without feet on their toes.
    """
    plan, supports, spin = _planned(seed, rise=rise, toes=toes)
    kept = [k for k in range(len(supports)) if plan.outside[k] < 1e-4]
    assert len(kept) >= 0.98 * len(supports)
    for k in kept:
        force = plan.acceleration[k] + [0.0, 0.0, G]
        assert _lacks(supports[k], plan.com[k], force, spin[k]) < 1e-3
    steps: Any = np.arange(len(supports) - 1) * DT
    for share in (0.0, 1.0):
        found = plan.at(steps + share * DT * (1.0 - 1e-9), DT)
        there = slice(None, -1) if share == 0.0 else slice(1, None)
        for value, node in zip(found, (plan.com, plan.velocity, plan.acceleration), strict=True):
            np.testing.assert_allclose(value, node[there], atol=1e-5)


@pytest.mark.parametrize("seed", range(6))
def test_soles_at_two_heights_do_not_push_against_each_other(seed: int) -> None:
    """The line of the ground's force passes between the soles on drawn stairs, in a plan with the shares of another."""
    com, supports, spin = _drawn(seed, rise=0.3)
    no, shares = np.full(len(com), np.inf), None
    for _ in range(2):
        plan = centroidal_plan(com, supports, DT, gravity=G, highest=no, spin=spin, shares=shares)
        shares = plan.shares
    off = []
    for k, soles in enumerate(supports):
        force = plan.acceleration[k] + [0.0, 0.0, G]
        turning = np.array([-spin[k, 1], spin[k, 0]]) / force[2]
        off.append(outside(soles, plan.com[k], force, turning))
    assert max(off) < 5e-3


@pytest.mark.long
@pytest.mark.parametrize("seed", [*range(4), *(pytest.param(s, marks=pytest.mark.slow) for s in range(4, 10))])
def test_legs_are_strong_enough_for_the_plan(seed: int) -> None:
    """On stairs, in a motion that needs more load than legs of drawn strengths give."""
    com, supports, spin = _drawn(seed, rise=0.2)
    rng = np.random.default_rng(seed)
    strengths: dict[int, float] = {}
    for soles in supports:
        strengths |= {id(sole): G * rng.uniform(1.2, 1.6) for sole in soles if id(sole) not in strengths}
    weak: list[Soles] = [tuple(sole._replace(strength=strengths[id(sole)]) for sole in soles) for soles in supports]
    no = np.full(len(com), np.inf)
    plan, free = (centroidal_plan(com, on, DT, gravity=G, highest=no, spin=spin) for on in (weak, supports))
    loads = plan.acceleration[:, 2] + G
    assert (free.acceleration[:, 2] + G > [1.02 * sum(sole.strength for sole in soles) for soles in weak]).any()
    kept = [k for k in range(len(weak)) if plan.outside[k] < 1e-4]
    assert len(kept) >= 0.9 * len(weak)
    assert (loads < [sum(sole.strength for sole in soles) + 1e-3 for soles in weak]).all()
    for k in kept:
        assert _lacks(weak[k], plan.com[k], plan.acceleration[k] + [0.0, 0.0, G], spin[k]) < 1e-3


@pytest.mark.long
def test_a_plan_turns_with_its_motion() -> None:
    own, _, _ = _planned(5)
    for heading in 2.0 * math.pi * np.arange(1, 36, 5) / 36.0:
        turned, _, _ = _planned(5, heading)
        c, s = math.cos(heading), math.sin(heading)
        back = np.array([[c, -s], [s, c]])
        np.testing.assert_allclose(turned.com[:, :2] @ back, own.com[:, :2], atol=2e-4)
        np.testing.assert_allclose(turned.com[:, 2], own.com[:, 2], atol=1e-5)


def test_flight_is_free_fall() -> None:
    n = 60
    com: Any = np.column_stack((0.3 * np.arange(n) * DT, np.zeros(n), np.full(n, 0.6)))
    supports: list[Soles] = [(_square(0.15, 0.0, 0.1),)] * n
    supports[25:37] = [()] * 12
    plan = centroidal_plan(com, supports, DT, gravity=G, highest=np.full(n, np.inf))
    np.testing.assert_allclose(plan.acceleration[25:37], [[0.0, 0.0, -G]] * 12, atol=1e-4)
    assert np.isnan(plan.zmp[25:37]).all()
    assert np.isfinite(plan.zmp[:25]).all()
    assert (plan.acceleration[[24, 37], 2] > -G).all()


def test_legs_bound_the_height() -> None:
    com, supports, _ = _drawn(1)
    highest = np.full(len(com), 0.55)
    plan = centroidal_plan(com, supports, DT, gravity=G, highest=highest)
    assert plan.com[:, 2].max() < 0.55 + 1e-4


def test_the_schedule_is_the_cheapest_one() -> None:
    """Beside all sequences of states that last long enough."""
    rng, least, change = np.random.default_rng(3), [2, 3, 2, 1], 0.7
    for _ in range(6):
        own = rng.uniform(0.0, 3.0, (7, 4))
        own[:, FLIGHT] += np.where(rng.random(7) < 0.6, np.inf, 0.0)
        best = math.inf
        for path in itertools.product(range(4), repeat=7):
            pairs = list(itertools.pairwise(path))
            if (LEFT, RIGHT) in pairs or (RIGHT, LEFT) in pairs:
                continue
            lengths = [(state, len(list(run))) for state, run in itertools.groupby(path)]
            if any(length < least[state] for state, length in lengths[1:-1]):
                continue
            cost = sum(own[i, state] for i, state in enumerate(path)) + change * (len(lengths) - 1)
            best = min(best, cost)
        found = _cheapest(own, least, change)
        changes = sum(a != b for a, b in itertools.pairwise(found))
        assert sum(own[i, state] for i, state in enumerate(found)) + change * changes == pytest.approx(best)


@pytest.fixture(scope="module")
def g1() -> hqp.robots.Robot:
    return catalogued("g1")


@pytest.fixture(scope="module")
def walked(g1: hqp.robots.Robot) -> Retargeted:
    return retarget(walk(1.2, speed=0.4, fps=120.0), g1, dynamics=True)


@pytest.mark.long
def test_a_walk_steps_by_its_schedule(walked: Retargeted) -> None:
    dynamics = walked.dynamics
    assert dynamics is not None
    stands = dynamics.stands
    assert stands.any(axis=1).all()
    assert not ((stands[1:] == ~stands[:-1]).all(axis=1)).any()
    for column in stands.T:
        for first, last in runs(~column)[1:-1]:
            assert (last - first) / walked.fps >= LEAST[LEFT] - 2.0 / walked.fps
    soles = [walked.robot.landmarks["soles"][k] for k in (0, 1)]
    for k, sole in enumerate(soles):
        states = (walked.robot.state(q) for q in walked.q[stands[:, k]])
        assert min(float(state.rotation(sole)[2, 2]) for state in states) > math.cos(0.02)
    before, after = dynamics.zmp_outside
    assert after < 0.5 * before
    assert f"{100 * after:.1f} % after" in str(walked)


@pytest.mark.parametrize("seed", range(5))
def test_heels_rise_before_a_sole_lifts(seed: int) -> None:
    """In a drawn schedule and drawn edges of a person's feet: beside another sole, longer than a load changes feet."""
    rng, least = np.random.default_rng(seed), 3
    states = np.array([[1, 1], [1, 0], [1, 1], [0, 1], [1, 1], [0, 0]] * 4)
    stands = np.repeat(states, rng.integers(1, 9, len(states)), axis=0) > 0
    edges = np.repeat(rng.integers(-1, 2, (len(stands) // 4 + 1, 2), dtype=np.int8), 4, axis=0)[: len(stands)]
    found = heel_off(stands, edges, least)
    for k in (0, 1):
        for first, last in runs(found[:, k]):
            assert last - first > least
            assert not stands[last, k]
        lifts = [i for i in range(least + 1, len(stands)) if stands[i - 1, k] and (stands[i] == [k == 1, k == 0]).all()]
        before = [slice(i - least - 1, i) for i in lifts]
        on_toe = [bool(stands[b].all() and (edges[b, k] == 1).all()) for b in before]
        assert [bool(found[i - 1, k]) for i in lifts] == on_toe
    assert not (found & ~stands.all(axis=1, keepdims=True)).any()


@pytest.mark.parametrize("seed", range(5))
def test_a_path_between_stances_begins_and_ends_at_rest(seed: int) -> None:
    """Drawn paths that begin and end at speed keep their ends, and turn and scale with the motion."""
    rng, n = np.random.default_rng(seed), int(np.random.default_rng(seed).integers(26, 120))
    path = np.cumsum(rng.uniform(-0.005, 0.015, (n, 3)), axis=0)
    found = from_rest(path, 12.0, 12.0)
    np.testing.assert_allclose(found[[0, -1]], path[[0, -1]], atol=1e-12)
    steps, most = np.linalg.norm(np.diff(found, axis=0), axis=1), np.linalg.norm(np.diff(path, axis=0), axis=1).max()
    assert (steps[[0, -1]] < 0.02 * most).all()
    assert np.abs(np.diff(found, n=2, axis=0)).max() < 1.5 * np.abs(np.diff(path, n=2, axis=0)).max()
    one = np.linalg.norm(np.diff(from_rest(path, 12.0, 0.0), axis=0), axis=1)
    assert one[0] < 0.02 * most < one[-1]
    R = 2.0 * np.array([[0.0, -1.0, 0.0], [1.0, 0.0, 0.0], [0.0, 0.0, 1.0]])
    np.testing.assert_allclose(from_rest(path @ R, 12.0, 12.0), found @ R, atol=1e-12)


def test_feet_lift_and_land_at_rest(g1: hqp.robots.Robot) -> None:
    """A walking person's feet are at 0.3 m/s and more when the schedule's swings begin and end."""
    found, motion = find_map(None, g1), walk(2.0, speed=0.8, fps=120.0)
    body = Body.of(g1, found)
    targets = targets_of(motion, parts_of(motion.names, found.human), body)
    schedule = schedule_of(targets, body)
    placed, swings = grounded(targets, body, schedule), 0
    for side, stands in zip(("left", "right"), schedule.stands.T, strict=True):
        before, after = (
            np.linalg.norm(np.diff(t.places[f"{side}_sole"], axis=0), axis=1) * t.fps for t in (targets, placed)
        )
        for first, last in runs(~stands):
            if first > 0 and last < len(stands):
                swings += 1
                assert max(after[first - 1], after[last - 1]) < 0.03 * before[first:last].max()
    assert swings > 1


@pytest.mark.parametrize("seed", range(6))
def test_a_foot_passes_over_the_edge_of_its_box(seed: int, g1: hqp.robots.Robot) -> None:
    """A person's foot that swings up, or down, lower than a box; a sole above its own place there is not below it, and
    does not jump there from a place beside the box.
    """
    rng, found = np.random.default_rng(seed), find_map(None, g1)
    motion = step_up(float(rng.uniform(0.15, 0.3)), fps=120.0)
    body, places = Body.of(g1, found), motion.positions.copy()
    for side, begin in (("Left", 0.4), ("Right", 1.7)):
        share = np.clip((np.arange(len(places)) / 120.0 - begin) / 0.6, 0.0, 1.0)
        lower = rng.uniform(0.05, 0.15) * np.sin(np.pi * share) ** 2
        places[:, [i for i, name in enumerate(motion.names) if name in (f"{side}Foot", f"{side}ToeBase")], 2] -= lower[
            :, None
        ]
    if seed % 2:
        places = places[::-1].copy()
    motion = Motion(motion.names, places, motion.fps, motion.parents)
    targets = targets_of(motion, parts_of(motion.names, found.human), body)
    schedule = schedule_of(targets, body)
    placed, checked = grounded(targets, body, schedule), 0
    for side, stands in zip(("left", "right"), schedule.stands.T, strict=True):
        R = placed.axes[f"{side}_sole"] @ body.axes[f"{side}_sole"].T
        points = placed.places[f"{side}_sole"][:, None] + np.einsum("tij,mj->tmi", R, body.soles[side])
        assert np.abs(np.diff(points[..., 2], axis=0)).max() < 4.0 / 120.0
        for first, last in runs(~stands):
            for end, other in ((first - 1, last), (last, first - 1)):
                if first > 0 and last < len(stands):
                    there, way = points[end, :, :2], np.array([1.0, 0.0])
                    near = overlap(points[other, :, :2], there, way) + CLEAR
                    over = [i for i in range(first, last) if overlap(points[i, :, :2], there, way) > near]
                    checked += len(over)
                    assert (points[over, :, 2].min(axis=1) > points[end, :, 2].min() - 2e-3).all()
    assert checked > 20


@pytest.mark.parametrize("seed", range(8))
def test_a_motion_that_ends_in_a_step_may_stop_on_the_foot_in_the_air(seed: int) -> None:
    """The DCM of a person who falls onto the next foot ends between both, and the plan stays near the person."""
    rng = np.random.default_rng(seed)
    height, heading, step = rng.uniform(0.5, 1.0), rng.uniform(-np.pi, np.pi), rng.uniform(0.2, 0.4)
    time = math.sqrt(height / G)
    times = np.arange(round(rng.uniform(1.2, 1.6) * time / DT)) * DT
    way, ahead = np.array([math.cos(heading), math.sin(heading)]), 0.1 * step * np.exp(times / time)
    com = np.column_stack((np.outer(ahead, way), np.full(len(times), height)))
    stance, swing = (_square(x, 0.0, 0.03, heading=heading) for x in (0.0, step))
    highest = np.full(len(times), np.inf)
    stuck, free = (
        centroidal_plan(com, [(stance,)] * len(times), DT, gravity=G, highest=highest, ends=ends)
        for ends in (None, (stance, swing))
    )
    off, own = (float(np.linalg.norm(plan.com - com, axis=1).max()) for plan in (stuck, free))
    assert own < 0.005 < 0.02 < off
    dcm = way @ (free.com[-1] + time * free.velocity[-1])[:2]
    assert 0.03 < dcm < step + 0.03


@pytest.mark.parametrize("seed", range(8))
def test_a_load_changes_feet_without_a_jump(seed: int) -> None:
    """Beside the other sole one bears nothing as it lands and as it lifts, and at most the rate more for each node in
    between; alone, before and after flights, and at the ends of the motion, it is as strong as before.  Together they
    hold the weight at all times.
    """
    rng, rate = np.random.default_rng(seed), G * DT / TAKES
    states = [[1, 1]]
    for _ in range(20):  # one sole changes at a time, or both in a flight
        k, now = int(rng.integers(2)), states[-1]
        flight = [1 - now[0], 1 - now[1]] if now[0] == now[1] and rng.random() < 0.3 else None
        states.append(flight or ([int(j == k) for j in (0, 1)] if now[0] == now[1] else [1, 1]))
    spans = rng.integers(round(LEAST[BOTH] / DT), 12, len(states))
    stands = np.repeat(np.array(states), spans, axis=0) > 0
    own = _square(0.0, 0.0, 0.1)._replace(strength=rng.uniform(15.0, 25.0))
    found = shifting([(own,) * int(on.sum()) for on in stands], stands, rate)
    for j, (first, last) in enumerate(itertools.pairwise(np.cumsum([0, *spans]))):
        for i in range(first, last):
            strengths = [sole.strength for sole in found[i]]
            expected = [own.strength] * sum(states[j])
            for k in range(2) if states[j] == [1, 1] else ():
                if j > 0 and states[j - 1] == [int(side != k) for side in (0, 1)]:
                    expected[k] = min(expected[k], rate * (i - first))
                if j + 1 < len(states) and states[j + 1] == [int(side != k) for side in (0, 1)]:
                    expected[k] = min(expected[k], rate * (last - 1 - i))
            assert strengths == pytest.approx(expected)
            assert not strengths or sum(strengths) >= G - 1e-9


@pytest.mark.parametrize("toes", [False, True])
@pytest.mark.parametrize("seed", range(4))
def test_a_planned_zmp_is_on_the_old_sole_as_the_new_one_lands(seed: int, toes: bool) -> None:
    """And on the new one as the old one lifts, on stairs."""
    com, drawn, spin = _drawn(seed, rise=0.1, toes=toes)
    supports: list[Soles] = [tuple(sorted(soles, key=lambda sole: -sole.corners[0, 1])) for soles in drawn]
    stands = np.array([[any(sign * sole.corners[0, 1] > 0.0 for sole in soles) for sign in (1, -1)] for soles in drawn])
    faded = shifting(supports, stands, G * DT / TAKES)
    plan = centroidal_plan(com, faded, DT, gravity=G, highest=np.full(len(com), np.inf), spin=spin)
    changes = [i for i in range(1, len(drawn)) if len(drawn[i]) != len(drawn[i - 1])]
    assert len(changes) == 7
    for i in changes:
        both, alone = (i, i - 1) if len(drawn[i]) == 2 else (i - 1, i)
        normals, offsets = drawn[alone][0].edges
        assert plan.outside[both] > 1e-4 or (normals @ plan.zmp[both] < offsets + 1e-3).all()


@pytest.mark.parametrize("seed", range(4))
def test_a_body_that_accelerates_does_so_in_its_first_and_last_frame(seed: int, g1: hqp.robots.Robot) -> None:
    """G1 moved along a drawn cubic; a point-reflecting filter ends without acceleration."""
    rng, fps, frames = np.random.default_rng(seed), 120.0, int(np.random.default_rng(seed).integers(30, 90))
    times: Any = np.arange(frames)[:, None] / fps
    second, third = rng.normal(size=3), rng.normal(size=3)
    q = np.repeat(g1.home[None], frames, axis=0)
    q[:, :3] += rng.normal(size=3) * times + second * times**2 / 2.0 + third * times**3 / 6.0
    com, _ = centroidal(g1, q, fps)
    np.testing.assert_allclose(accelerated(com, fps), second + third * times, atol=0.02)


@pytest.mark.parametrize("seed", range(8))
def test_one_who_falls_does_so_in_the_first_and_the_last_frame(seed: int, g1: hqp.robots.Robot) -> None:
    """A person at a drawn rate whose hips fall by a drawn share of gravity all the time."""
    rng = np.random.default_rng(seed)
    found, fps, share = find_map(None, g1), float(rng.uniform(100.0, 240.0)), float(rng.choice([0.35, 0.65, 1.0]))
    body, motion = Body.of(g1, found), stand(float(rng.uniform(0.3, 0.6)), fps=fps)
    targets = targets_of(motion, parts_of(motion.names, found.human), body)
    times = np.arange(len(targets)) / fps
    falls = rng.uniform(0.0, 2.0) * times - 0.5 * share * GRAVITY * body.leg / LEG * times**2
    targets.places["pelvis"][:, 2] += falls
    assert (_falling(targets, body.leg) == (share > FALLING)).all()


@pytest.mark.parametrize("name", ["g1", "talos", "cbi"])
def test_a_toe_is_an_edge_across_the_sole(name: str) -> None:
    """At least half as wide as the sole, at its front, from right to left."""
    robot = catalogued(name)
    for outline in Body.of(robot, find_map(None, robot)).soles.values():
        ends = front(outline)
        assert np.diff(ends[:, 1])[0] > 0.5 * np.ptp(outline[:, 1])
        assert (ends[:, 0] > outline[:, 0].max() - 0.006).all()


@pytest.mark.slow
@pytest.mark.parametrize("rise", [0.15, 0.2])
def test_a_heel_rises_in_a_step_on_a_box(rise: float, g1: hqp.robots.Robot) -> None:
    """The toe stays on its spot, the heel rises, and the ground's force acts between the toe and the other sole."""
    found = retarget(step_up(rise, fps=120.0), g1, dynamics=True)
    assert found.dynamics is not None
    left, right = found.dynamics.toes.T
    assert not left.any()
    frames = np.flatnonzero(right)
    assert len(frames) > 0.1 * found.fps
    assert not found.dynamics.stands[frames[-1] + 1, 1]
    tracker = _tracker(g1)
    both = tracker.stacks.toes["right"], tracker.stacks.heels["right"]
    ends = np.array([[end.value(state) for end in both] for state in (g1.state(found.q[i]) for i in frames)])
    assert np.linalg.norm(ends[:, 0] - ends[0, 0], axis=1).max() < 5e-3
    assert ends[-1, 1, 2] - ends[0, 1, 2] > 0.02
    soles = supports_of(tracker, found.q, found.dynamics.stands, found.dynamics.toes, margin=False)
    push = found.dynamics.acceleration + [0.0, 0.0, G]
    before = [outside(soles[i], found.dynamics.com[i], push[i], np.zeros(2)) for i in frames]
    assert np.mean(np.array(before) < 0.02) > 0.9


@pytest.mark.long
@pytest.mark.parametrize("heading", [2.1, *(pytest.param(h, marks=pytest.mark.slow) for h in (0.0, 3.1, 4.4))])
def test_one_who_stands_is_left_alone(heading: float, g1: hqp.robots.Robot) -> None:
    found = retarget(stand(0.4, heading), g1, dynamics=True)
    assert found.dynamics is not None
    assert found.dynamics.shift.max() < 1e-3
    assert found.dynamics.zmp_outside == (0.0, 0.0)
    assert np.ptp(found.angles, axis=0).max() < 0.02


def _tracker(robot: Any) -> Tracker:
    found, motion = find_map(None, robot), stand(0.2)
    body = Body.of(robot, found)
    targets = targets_of(motion, parts_of(motion.names, found.human), body)
    return Tracker(robot, Stacks(robot, found, body, 1.0 / motion.fps, collision=False), targets)


@pytest.mark.parametrize("seed", range(5))
def test_the_strength_of_a_leg_is_the_load_that_its_motors_hold(seed: int, g1: hqp.robots.Robot) -> None:
    """By virtual work of each motor alone, at drawn angles, for a sole or a toe: one is at its limit, none beyond."""
    toes = [bool(seed % 2), seed % 3 == 0]
    tracker, rng = _tracker(g1), np.random.default_rng(seed)
    angles = rng.uniform(np.maximum(g1.lower, -1.0), np.minimum(g1.upper, 1.0))
    q, soles = g1.configuration(angles), (_square(0.0, 0.1, 0.1), _square(0.0, -0.1, 0.1))
    [found] = strong(tracker, [soles], q[None], np.ones((1, 2), dtype=bool), np.array([toes]))
    stacks = tracker.stacks
    ends = [
        (stacks.toes[side], (stacks.toes if toe else stacks.heels)[side])
        for side, toe in zip(("left", "right"), toes, strict=True)
    ]
    mass = sum(inertia.mass for inertia in g1.model.inertias)
    for sole, both in zip(found, ends, strict=True):
        used = []
        for k in g1.actuated:
            turn = np.zeros(g1.nv)
            turn[k] = 1e-5
            high, low = (
                np.mean([end.value(g1.state(g1.integrate(q, way * turn, 1.0)))[2] for end in both]) for way in (1, -1)
            )
            used.append(abs(high - low) / 2e-5 * sole.strength * mass / g1.effort_limit[k])
        assert max(used) == pytest.approx(1.0, abs=1e-4)


def test_a_plan_leaves_the_ankle_room_for_a_push(g1: hqp.robots.Robot) -> None:
    """A push of 0.075 m/s moves the DCM by less than the way from any planned ZMP of one sole to the sole's edge."""
    tracker, one = _tracker(g1), np.array([[True, False], [False, True]])
    q = np.array([g1.home] * 2)
    inner, whole = (supports_of(tracker, q, one, ~one & one, margin=margin) for margin in (True, False))
    height = float(g1.state(g1.home).com()[2])
    for [planned], [sole] in zip(inner, whole, strict=True):
        normals, offsets = sole.edges
        room = (offsets[:, None] - normals @ planned.corners.T).min()
        assert room > 0.075 / math.sqrt(G / height)


@pytest.mark.parametrize("seed", range(5))
def test_soles_on_one_box_stand_at_one_height(seed: int) -> None:
    """Stairs of drawn heights, each measured with noise at drawn places; on a ramp no height moves far."""
    rng = np.random.default_rng(seed)
    leg = float(rng.uniform(0.4, 1.2))
    steps = leg * np.cumsum(rng.uniform(0.15, 0.4, 4))
    box = rng.integers(4, size=30)
    spots = np.column_stack((box * leg + 0.2 * leg * rng.uniform(-1.0, 1.0, 30), 0.2 * leg * rng.uniform(-1.0, 1.0, 30),
                             steps[box] + 0.02 * leg * rng.uniform(-1.0, 1.0, 30)))  # fmt: skip
    found = levelled(spots, leg)
    for own in range(4):
        assert len(np.unique(found[box == own])) <= 1
        assert np.abs(found - steps[box]).max() < 0.02 * leg
    order = rng.permutation(30)
    np.testing.assert_allclose(levelled(spots[order], leg), found[order], atol=1e-12)
    x = leg * np.linspace(0.0, 8.0, 30)
    ramp = np.column_stack((x, 0.0 * x, 0.1 * x))
    assert np.abs(levelled(ramp, leg) - ramp[:, 2]).max() < LEVEL * leg
    np.testing.assert_array_equal(levelled(spots[:1], leg), spots[:1, 2])


def _wrench(robot: Any, q: Mat, i: int, fps: float) -> tuple[Vec, Vec]:
    """Force and moment about the world's origin that the ground gives, by Pinocchio's inverse dynamics.

    Only the wrench of the ground works on virtual motions of the free base.
    """
    window = np.array([robot.difference(q[i], q[i + k]) for k in range(-8, 9)])
    fit = np.polynomial.polynomial.polyfit(np.arange(-8, 9) / fps, window, 4)
    data = robot.model.createData()
    tau: Any = pin.rnea(robot.model, data, q[i], fit[1], 2.0 * fit[2])
    pin.forwardKinematics(robot.model, data, q[i])
    base = data.oMi[1]
    force = base.rotation @ tau[:3]
    return force, base.rotation @ tau[3:6] + np.cross(base.translation, force)


@pytest.mark.long
def test_the_grounds_force_moves_the_com_as_planned(walked: Retargeted) -> None:
    """Half of the frames are within 5 % of the weight, nine of ten within 15 %: feet change within a frame."""
    dynamics = walked.dynamics
    assert dynamics is not None
    robot: Any = walked.robot
    weight, off = robot.mass * G, []
    for i in range(24, len(walked) - 24, 3):
        force, _ = _wrench(walked.robot, walked.q, i, walked.fps)
        off.append(np.abs(force / weight - (dynamics.acceleration[i] / G + [0.0, 0.0, 1.0])).max())
    assert np.median(off) < 0.05
    assert np.quantile(off, 0.9) < 0.15


def test_the_zmp_of_a_motion_is_that_of_its_ground_reaction(g1: hqp.robots.Robot) -> None:
    """Angular momentum included: a drawn motion of all joints, judged by Pinocchio."""
    rng, fps = np.random.default_rng(2), 120.0
    found = find_map(None, g1)
    body = Body.of(g1, found)
    motion = stand(1.5).at_rate(fps)
    targets = targets_of(motion, parts_of(motion.names, found.human), body)
    tracker = Tracker(g1, Stacks(g1, found, body, 1.0 / fps, flat=True), targets)
    swing, phase = rng.uniform(-0.15, 0.15, g1.nv), rng.uniform(0.0, 6.28, g1.nv)
    times = np.arange(len(targets)) / fps
    q = np.array([g1.integrate(g1.home, swing * np.sin(2.0 * np.pi * t + phase), 1.0) for t in times])
    stands = np.ones((len(q), 2), dtype=bool)
    measured = zmp_outside(tracker, q, stands, ~stands)
    supports = supports_of(tracker, q, stands, ~stands, margin=False)
    for i in range(30, len(q) - 30, 12):
        force, moment = _wrench(g1, q, i, fps)
        line = np.append(np.array([-moment[1], moment[0]]) / force[2], 0.0)  # the force's line meets the ground there
        assert outside(supports[i], line, force, np.zeros(2)) == pytest.approx(measured[i], abs=4e-3)


@pytest.mark.parametrize("seed", range(4))
def test_times_that_no_forces_of_the_soles_carry(seed: int, g1: hqp.robots.Robot) -> None:
    """Move G1 to and fro, within the forces of its soles or beyond them by a drawn share."""
    rng, fps = np.random.default_rng(seed), 120.0
    found, body = find_map(None, g1), Body.of(g1, find_map(None, g1))
    motion = stand(2.0).at_rate(fps)
    targets = targets_of(motion, parts_of(motion.names, found.human), body)
    tracker = Tracker(g1, Stacks(g1, found, body, 1.0 / fps, flat=True), targets)
    stands = np.ones((len(targets), 2), dtype=bool)
    (soles,) = supports_of(tracker, g1.home[None], stands[:1], ~stands[:1], margin=False)
    com = g1.state(g1.home).com()
    off = np.vstack([sole.corners for sole in soles])[:, 0] - com[0]
    height = com[2] - soles[0].height
    least, most = (-G / height * end for end in (off.max(), off.min()))
    times: Any = np.arange(len(targets)) / fps
    turns, size = 2.0 * np.pi * rng.uniform(0.8, 1.5), rng.uniform(0.3, 0.9) if seed % 3 == 0 else rng.uniform(2.0, 3.0)
    moved = size * min(most, -least) / turns**2 * np.cos(turns * times)
    q = np.repeat(g1.home[None], len(times), axis=0)
    q[:, 0] += moved
    push = -(turns**2) * moved
    excess = np.maximum(push - most, 0.0) + np.maximum(least - push, 0.0)
    lacks = [excess[a:b].sum() / fps for a, b in runs(excess > 0.0)]
    told = beyond(tracker, centroidal(g1, q, fps)[0], stands, zmp_outside(tracker, q, stands, ~stands))
    np.testing.assert_allclose([each.lacks for each in told], [x for x in lacks if x > 0.075], rtol=0.1)
    assert bool(told) == (seed % 3 != 0)


@pytest.fixture(scope="module", params=["talos", "cbi"])
def crouched(request: pytest.FixtureRequest) -> Retargeted:
    """Without self-collision: thighs of Talos, whose capsules overlap at home, keep it from bending its knees."""
    return retarget(crouch(1.5), request.param, dynamics=True, collision=False)


@pytest.mark.slow
def test_the_plan_leads_on_other_robots(crouched: Retargeted) -> None:
    """The CoM follows its plan from above, where the ZMP depends on it."""
    assert crouched.dynamics is not None
    before, after = crouched.dynamics.zmp_outside
    assert after <= before
    com = np.array([crouched.robot.state(q).com() for q in crouched.q])
    assert np.linalg.norm((com - crouched.dynamics.com)[:, :2], axis=1).max() < 5e-3


@pytest.mark.slow
def test_the_height_of_the_plan_is_reached_on_other_robots(crouched: Retargeted) -> None:
    """A plan above knees and hands that bend the body lower would be missed by 0.11 m on CBi."""
    assert crouched.dynamics is not None
    assert crouched.dynamics.missed < 0.02


@pytest.mark.long
def test_dynamics_need_the_outline_of_the_soles(g1: hqp.robots.Robot, monkeypatch: pytest.MonkeyPatch) -> None:
    from hqp.motion import body
    from hqp.robots import soles

    monkeypatch.setattr(soles, "level_sole", lambda robot, frame: (np.eye(3), np.zeros((0, 3))))
    assert body._outline(g1, "left_sole", np.zeros(3), np.eye(3))[1].shape == (2, 2)
    with pytest.raises(DeclarationError, match="outline of the soles"):
        retarget(stand(0.2), g1, dynamics=True)
