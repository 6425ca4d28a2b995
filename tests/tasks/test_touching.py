"""Pairs of `pairs="auto"`: links that may touch have a row, and no row keeps the joints from most of their ranges."""

from __future__ import annotations

import itertools
import math
import re
import warnings
from typing import Any

import coal
import numpy as np
import pinocchio as pin
import pytest

import hqp
from hqp.robots import capsule_files
from hqp.shapes import LinkCapsule
from hqp.tasks import CollisionAvoidance, touching
from hqp.tasks.collision_pairs import candidates
from hqp.tasks.collision_scene import scene

FAST = ("g1", "ur5", "panda", "go2", "anymal", "drawn 0", "drawn 1", "drawn 2")
SLOW = ("talos", "icub", "romeo", "solo12", "ur3", "ur10", "kinova", "xarm7", "tiago", "tiago_pro", "drawn 3")
Shapes = dict[int, list[tuple[Any, Any]]]


def load(name: str) -> Any:
    return drawn(int(name.split()[1])) if name.startswith("drawn") else hqp.robots.load(name)


def drawn(seed: int) -> Any:
    """A floating trunk with chains of capsules of drawn sizes, axes and ranges, whose capsules are the shapes."""
    rng, model = np.random.default_rng(seed), pin.Model()
    body = model.addJoint(0, pin.JointModelFreeFlyer(), pin.SE3.Identity(), "root")
    capsules = [LinkCapsule("trunk", body, (0.0, 0.0, -0.2), (0.0, 0.0, 0.2), 0.1)]
    model.appendBodyToJoint(body, pin.Inertia(5.0, np.zeros(3), np.eye(3)), pin.SE3.Identity())
    joints = [pin.JointModelRX, pin.JointModelRY, pin.JointModelRZ]
    for chain in range(3):
        turn = 2.0 * math.pi * chain / 3.0 + rng.uniform(-0.3, 0.3)
        place = 0.22 * np.array([math.cos(turn), math.sin(turn), rng.uniform(-1.0, 1.0)])
        parent = body
        for k in range(rng.integers(3, 6)):
            length, name = rng.uniform(0.05, 0.3), f"chain{chain}_{k}"
            high = rng.uniform(0.3, 2.8)
            parent = model.addJoint(
                parent, joints[rng.integers(3)](), pin.SE3(np.eye(3), place), name, np.full(1, 50.0), np.full(1, 3.0),
                np.full(1, -high), np.full(1, high),
            )  # fmt: skip
            model.appendBodyToJoint(parent, pin.Inertia(1.0, np.zeros(3), np.eye(3)), pin.SE3.Identity())
            model.addFrame(pin.Frame(name, parent, 0, pin.SE3.Identity(), pin.FrameType.BODY))
            along = rng.normal(size=3) * (1.0, 1.0, 0.3)
            place = length * along / np.linalg.norm(along)
            capsules.append(LinkCapsule(name, parent, (0.0,) * 3, tuple(place.tolist()), rng.uniform(0.02, 0.05)))
    return hqp.robots.Robot(model, name=f"drawn {seed}").with_capsules(capsules)


def capsule(c: LinkCapsule) -> tuple[Any, Any]:
    a, b = np.array(c.a), np.array(c.b)
    turn = pin.Quaternion.FromTwoVectors(np.array([0.0, 0.0, 1.0]), b - a).matrix() if c.a != c.b else np.eye(3)
    return coal.Capsule(c.radius, float(np.linalg.norm(b - a))), pin.SE3(turn, 0.5 * (a + b))


def placed(pose: Any) -> Any:
    return coal.Transform3s(pose.rotation, pose.translation)


def touch(one: list[tuple[Any, Any]], two: list[tuple[Any, Any]], first: Any, second: Any) -> bool:
    ask, result = coal.CollisionRequest(), coal.CollisionResult()
    for (a, at), (b, to) in itertools.product(one, two):
        result.clear()
        if coal.collide(a, placed(first * at), b, placed(second * to), ask, result):
            return True
    return False


def gap(one: LinkCapsule, two: LinkCapsule, first: Any, second: Any) -> float:
    (a, at), (b, to) = capsule(one), capsule(two)
    found = coal.distance(a, placed(first * at), b, placed(second * to), coal.DistanceRequest(), coal.DistanceResult())
    return float(found)


def configurations(robot: Any, rng: Any, count: int) -> list[Any]:
    """Joint places at home, then drawn within their ranges, of a seed that the library does not use."""
    low = np.where(np.isfinite(robot.lower), robot.lower, -math.pi)
    high = np.where(np.isfinite(robot.upper), robot.upper, math.pi)
    data, found = robot.model.createData(), []
    for q in (robot.home, *(robot.configuration(rng.uniform(low, high)) for _ in range(count))):
        pin.forwardKinematics(robot.model, data, q)
        found.append([pose.copy() for pose in data.oMi])
    return found


@pytest.mark.long
@pytest.mark.parametrize("name", [*FAST, *(pytest.param(name, marks=pytest.mark.slow) for name in SLOW)])
def test_pairs_that_touch_have_a_row_and_needless_pairs_none(name: str) -> None:
    """By coal on the shapes of the file: no row is violated at home. In another draw, shapes touch in some
    configurations that a row excludes, or the row excludes less than half of the configurations with shapes apart.
    Pairs that touch in most configurations that their capsules exclude have a row, and of those whose capsules overlap
    at home no others.
    """
    robot = load(name)
    with warnings.catch_warnings():
        warnings.simplefilter("ignore")
        own = scene(CollisionAvoidance(), robot)
    near = CollisionAvoidance().near(robot.state(robot.home))
    assert all(n.distance >= n.clearance for n in near if n is not None)
    shapes: Shapes = {}
    if robot.description is None:
        for c in robot.capsules:
            shapes.setdefault(c.body, []).append(capsule(c))
    else:
        for item in robot.geometry.geometryObjects:
            shapes.setdefault(item.parentJoint, []).append((item.geometry, item.placement))
    places = configurations(robot, np.random.default_rng(7), 250)
    rows, parents = {pair: float(c) for pair, c in zip(own.pairs, own.clearance, strict=True)}, robot.model.parents
    rng, capsules = np.random.default_rng(8), robot.capsules
    by_hulls = {frozenset((own.capsules[i].body, own.capsules[j].body)) for i, j in own.pairs if own.is_hull(j)}
    every = [
        (i, j)
        for i, j in itertools.combinations(range(len(capsules)), 2)
        if len({capsules[i].body, capsules[j].body}) == 2
        and parents[capsules[i].body] != capsules[j].body != parents[capsules[j].body]
        and parents[capsules[j].body] != capsules[i].body
        and frozenset((capsules[i].body, capsules[j].body)) not in by_hulls
    ]
    for i, j in rng.permutation(every)[:60].tolist():
        a, b = capsules[i].body, capsules[j].body
        distances = np.array([gap(capsules[i], capsules[j], p[a], p[b]) for p in places])
        if touch(shapes[a], shapes[b], places[0][a], places[0][b]):
            assert (i, j) not in rows
            continue
        least = rows.get((i, j), min(0.01, (0.8 if distances[0] > 0.0 else 1.2) * distances[0]))
        excluded = [p for p, d in zip(places, distances, strict=True) if d < least]
        if len(excluded) < 30:
            assert (i, j) in rows or len(excluded) > 0 or distances[0] <= 0.0
            continue
        touching = np.mean([touch(shapes[a], shapes[b], p[a], p[b]) for p in excluded[:80]])
        share = len(excluded) / len(places)
        if distances[0] <= 0.0:
            assert touching > 0.3 if (i, j) in rows else touching < 0.7
        elif (i, j) in rows:
            assert touching > 0.35 or share * (1.0 - touching) < 0.45 * (1.0 - share * touching)
            assert touching > 0.0 or share < 0.3
        else:
            assert touching < 0.65  # half, and three deviations of the draw


@pytest.mark.long
def test_capsules_of_a_file_have_the_pairs_of_shipped_ones(tmp_path: Any) -> None:
    """Capsules that were fitted to the robot's shapes are judged by these wherever they come from."""
    robot = hqp.robots.load("ur5")
    path = tmp_path / "ur5.capsules.toml"
    path.write_text(capsule_files.text(robot, robot.capsules))
    read = robot.copy().with_capsules(path)
    given = robot.copy().with_capsules(robot.capsules)
    fitted = scene(CollisionAvoidance(), robot).pairs
    assert scene(CollisionAvoidance(), read).pairs == scene(CollisionAvoidance(), given).pairs == fitted
    own = [c._replace(fitted=False) for c in robot.capsules]
    assert scene(CollisionAvoidance(), robot.copy().with_capsules(own)).pairs != fitted


def passing(rng: Any, *, closes: bool = True) -> tuple[Any, float, float]:
    """A ball on a turning slide that passes a trunk with gaps of -deep to wide [m], contact in a third of them.

    closes: False for a slide that only opens from home.
    """
    wide = rng.uniform(0.004, 0.009)
    deep, home = rng.uniform(0.1, 0.5) * wide, rng.uniform(0.7, 1.0) * wide
    model = pin.Model()
    trunk = model.addJoint(0, pin.JointModelPX(), pin.SE3.Identity(), "trunk")
    turn = model.addJoint(trunk, pin.JointModelRZ(), pin.SE3.Identity(), "turn")
    place = pin.SE3(np.eye(3), np.array([0.15 + home, 0.0, 0.0]))
    slide = model.addJoint(
        turn, pin.JointModelPX(), place, "slide", np.full(1, 50.0), np.full(1, 1.0),
        np.full(1, -deep - home if closes else 0.0), np.full(1, wide - home),
    )  # fmt: skip
    balls = [(trunk, "trunk", 0.1), (slide, "ball", 0.05)]
    for joint in (trunk, turn, slide):
        model.appendBodyToJoint(joint, pin.Inertia(1.0, np.zeros(3), np.eye(3)), pin.SE3.Identity())
    for joint, name, _ in balls:
        model.addFrame(pin.Frame(name, joint, 0, pin.SE3.Identity(), pin.FrameType.BODY))
    own = [LinkCapsule(name, joint, (0.0,) * 3, (0.0,) * 3, radius) for joint, name, radius in balls]
    return hqp.robots.Robot(model, name="passing").with_capsules(own), deep, wide


@pytest.mark.parametrize("seed", range(12))
def test_links_that_pass_closely_keep_a_smaller_clearance(seed: int) -> None:
    """Judged by the gap that is drawn: the row excludes contact, and a fifth of the gaps above 0."""
    rng = np.random.default_rng(seed)
    robot, deep, wide = passing(rng)
    avoid, places = CollisionAvoidance(), robot.configuration(np.zeros(3))
    assert avoid.clearance > wide
    excluded = []
    for gap in np.linspace(-deep, wide, 101):
        places[:] = 0.0, rng.uniform(-3.0, 3.0), gap - wide + robot.upper[2]
        [row] = [near for near in avoid.near(robot.state(places)) if near is not None]
        assert row.distance == pytest.approx(gap, abs=1e-9)
        assert gap > 0.0 or row.distance < row.clearance
        excluded += [row.distance < row.clearance] if gap > 0.0 else []
    assert np.mean(excluded) == pytest.approx(0.2, abs=0.04)
    assert "keep" in avoid.remark(robot)


@pytest.mark.long
@pytest.mark.parametrize("name", ["g1", pytest.param("talos", marks=pytest.mark.slow)])
def test_links_of_both_sides_keep_alike_clearances(name: str) -> None:
    """Left and right links that pass others closely are judged in other draws, and keep the same within a fifth."""
    robot, avoid = hqp.robots.load(name), CollisionAvoidance()
    capsules, _, _, lowered = candidates(avoid, robot, avoid.world, avoid.pairs, avoid.clearance, avoid.joints)
    names = {c.body: c.name.split("/")[0] for c in capsules}
    kept = {frozenset(names[b] for b in bodies): clearance for bodies, clearance in lowered.items()}
    mirror = {"left": "right", "right": "left"}
    for links, clearance in kept.items():
        other = frozenset(re.sub("left|right", lambda side: mirror[side.group()], link) for link in links)
        assert kept[other] == pytest.approx(clearance, rel=0.2), sorted(links)
    assert kept


@pytest.mark.parametrize("seed", range(12))
def test_a_robot_with_other_ranges_has_its_own_clearance(seed: int) -> None:
    """Pairs are remembered: a robot whose links do not meet keeps no smaller clearance, though one of the same capsules
    and home does."""
    (one, *_), (other, *_) = (passing(np.random.default_rng(seed), closes=closes) for closes in (True, False))
    avoid, kept = CollisionAvoidance(), []
    for robot in (one, other, one.copy()):
        [row] = [near for near in avoid.near(robot.state(robot.home)) if near is not None]
        kept.append(row.clearance)
    assert kept[0] < kept[1]
    assert kept[2] == kept[0]


@pytest.mark.long
@pytest.mark.parametrize("seed", range(3))
def test_the_order_of_distances_does_not_matter(seed: int) -> None:
    """Near configurations are measured once for each pair, in any order of the distances."""
    robot, rng = drawn(seed), np.random.default_rng(seed)
    capsules = tuple(robot.capsules)
    places = touching._drawn(robot.copy(), [c.body for c in capsules], 200)
    kept = touching._Drawn(capsules, places, None)
    for _ in range(300):
        i, j = rng.choice(len(capsules), 2, replace=False).tolist()
        least = float(rng.choice([-0.02, 0.0, 0.01, 0.1]))
        once = touching._Drawn(capsules, places, None)
        np.testing.assert_array_equal(kept.near(i, j, least), once.near(i, j, least))
        draws, at = range(0, 201, 50), (places[capsules[i].body], places[capsules[j].body])
        gaps = [gap(capsules[i], capsules[j], *(pin.SE3(R[n], p[n]) for p, R in at)) for n in draws]
        near = np.isin(draws, once.near(i, j, least))
        clear = np.abs(np.array(gaps) - least) > 1e-6
        np.testing.assert_array_equal(near[clear], (np.array(gaps) < least)[clear])


@pytest.mark.long
def test_links_of_the_catalogue_that_pass_closely_have_a_row() -> None:
    for name in ("g1", "ur5"):
        assert not scene(CollisionAvoidance(), hqp.robots.load(name)).unseparated


def folding(seed: int) -> Any:
    """A trunk with a shelf, and a limb on a short link above it, straight out at home, that bends far down."""
    rng, model = np.random.default_rng(seed), pin.Model()
    trunk, high = rng.uniform(0.1, 0.2), rng.uniform(1.2, 3.0)
    below, parent = -rng.uniform(0.06, 0.25), 0
    capsules = [LinkCapsule("trunk", 1, (0.0, 0.0, below), (trunk + 0.3, 0.0, below), 0.02)]
    names, place = ("trunk", "short", "limb"), np.zeros(3)
    ranges = ((-3.0, 3.0), (-0.2, 0.2), (-rng.uniform(0.1, 0.6), high))
    for k, (name, (low, up)) in enumerate(zip(names, ranges, strict=True)):
        joint = pin.JointModelRZ() if k == 0 else pin.JointModelRY()
        parent = model.addJoint(
            parent, joint, pin.SE3(np.eye(3), place), name, np.full(1, 50.0), np.full(1, 3.0), np.full(1, low),
            np.full(1, up),
        )  # fmt: skip
        model.appendBodyToJoint(parent, pin.Inertia(1.0, np.zeros(3), np.eye(3)), pin.SE3.Identity())
        model.addFrame(pin.Frame(name, parent, 0, pin.SE3.Identity(), pin.FrameType.BODY))
        place = np.array([trunk + rng.uniform(0.03, 0.06), 0.0, 0.0]) if k == 0 else np.array([0.02, 0.0, 0.0])
    capsules.append(LinkCapsule("limb", 3, (0.0,) * 3, (rng.uniform(0.26, 0.4), 0.0, 0.0), rng.uniform(0.01, 0.03)))
    return hqp.robots.Robot(model, name=f"folding {seed}").with_capsules(capsules)


@pytest.mark.long
def test_links_that_touch_in_most_configurations_have_no_row_but_a_note() -> None:
    """Shapes that deny their joints most of the ranges are wrong; by coal, in configurations of another draw."""
    counted = {True: 0, False: 0}
    for seed in range(25):
        robot = folding(seed)
        with warnings.catch_warnings():
            warnings.simplefilter("ignore")
            found = candidates(CollisionAvoidance(), robot, (), "auto", 0.0)
        one, two = robot.capsules
        places = configurations(robot, np.random.default_rng(9), 400)
        share = np.mean([gap(one, two, p[one.body], p[two.body]) <= 0.0 for p in places[1:]])
        if abs(share - 2.0 / 3.0) < 0.06:
            continue
        counted[bool(share > 2.0 / 3.0)] += 1
        assert found.unseparated == (("trunk - limb",) if share > 2.0 / 3.0 else ())
        assert bool(found.pairs) == (share < 2.0 / 3.0)
    assert min(counted.values()) > 3
