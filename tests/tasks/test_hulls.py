"""Convex hulls in place of capsules that cannot keep two links apart: coal judges distances and rows."""

from __future__ import annotations

import itertools
import warnings
from collections.abc import Callable
from typing import Any

import numpy as np
import pytest
from scipy.spatial import ConvexHull

import hqp
from hqp.collision_library import convex_hull, solid
from hqp.errors import DeclarationError
from hqp.shapes import LinkHull
from hqp.tasks import CollisionAvoidance
from hqp.tasks.collision_scene import scene
from hqp.tasks.distances import to_capsule
from hqp.tasks.hull_distances import between
from hqp.tasks.polytopes import nearest_feature, polytope, to_polytope

from .test_collision import by_coal, pose
from .test_touching import configurations, touch

FAST = ("g1", "go2")
SLOW = ("ur5", "laikago", "go1", "talos", "icub", "solo12", "romeo", "panda", "anymal", "tiago", "xarm7")


def hull(rng: Any) -> LinkHull:
    """Hull of drawn points, round, long or flat."""
    points = rng.normal(size=(rng.integers(4, 40), 3)) * rng.uniform(0.01, 0.3, 3)
    own = ConvexHull(points)
    place = {int(v): k for k, v in enumerate(own.vertices)}
    triangles = tuple((place[i], place[j], place[k]) for i, j, k in own.simplices.tolist())
    return LinkHull(
        "hull", 1, tuple(map(tuple, points[own.vertices].tolist())), triangles, float(rng.uniform(0.0, 0.02))
    )


@pytest.mark.parametrize("seed", range(5))
def test_distances_to_hulls_are_coals(seed: int) -> None:
    rng, apart, inside = np.random.default_rng(seed), 0, 0
    for _ in range(40):
        own, T = hull(rng), pose(rng)
        a = T[:3, 3] + rng.normal(size=3) * rng.choice([0.05, 0.3])
        b = a + rng.normal(size=3) * rng.choice([0.3, 1e-4])
        d, normal, point = to_polytope(a, b, 0.05, polytope(own), T[:3, 3], T[:3, :3])
        feature = nearest_feature(a, b, polytope(own), T[:3, 3], T[:3, :3])
        again = to_polytope(a, b, 0.05, polytope(own), T[:3, 3], T[:3, :3], feature=feature)
        np.testing.assert_array_equal(np.hstack(again), np.hstack((d, normal, point)))
        shape = solid(convex_hull(np.array(own.corners)))
        expected = by_coal(a, b, 0.05, shape, T) - own.rounding
        assert np.linalg.norm(normal) == pytest.approx(1.0, abs=1e-9)
        if expected > 1e-3:
            assert d == pytest.approx(expected, abs=1e-5)
            apart += 1
        else:  # the way out ends at a touch, and a shorter one does not
            assert d < 2e-3
            core = d + 0.05 + own.rounding
            if core < -1e-3:
                out = normal * core
                assert by_coal(a + 1.001 * out, b + 1.001 * out, 1e-6, shape, T) > 0.0
                assert by_coal(a + 0.95 * out, b + 0.95 * out, 1e-6, shape, T) < 1e-5
                inside += 1
    assert apart > 10
    assert inside > 3


@pytest.mark.long
def test_hulls_contain_the_shapes() -> None:
    robot = hqp.robots.load("g1")
    contacts, geometry = robot.contacts(), robot.geometry
    for link in ("torso_link", "left_hip_roll_link"):
        body = robot.body(robot.frame(link))
        items = [item for item in geometry.geometryObjects if item.parentJoint == body]
        for own, item in zip(contacts.hulls(body, link), items, strict=True):
            assert own.rounding < 3e-3
            shape = polytope(own)
            for p in item.geometry.vertices()[::80]:
                at = item.placement.rotation @ p + item.placement.translation
                assert to_polytope(at, at, 0.0, shape, np.zeros(3), np.eye(3))[0] < 1e-6


@pytest.mark.long
@pytest.mark.parametrize("name", [*FAST, *(pytest.param(name, marks=pytest.mark.slow) for name in SLOW)])
def test_what_the_rows_allow_does_not_touch(name: str) -> None:
    """Links that are apart at home, by coal on the shapes of the file, in drawn configurations:
    rows exclude 98 % of their contacts (Talos 800 of 811, others all), or a note names them."""
    robot = hqp.robots.load(name)
    with warnings.catch_warnings():
        warnings.simplefilter("ignore")
        own = scene(CollisionAvoidance(), robot)
    named = {frozenset(text.split(" - ")) for text in own.unseparated}
    link: dict[int, str] = {}
    shapes: dict[int, list[tuple[Any, Any]]] = {}
    for c in robot.capsules:
        link.setdefault(c.body, c.link)
    for item in robot.geometry.geometryObjects:
        shapes.setdefault(item.parentJoint, []).append((item.geometry, item.placement))
    places = configurations(robot, np.random.default_rng(3), 25 if name in FAST else 300)
    rows: dict[frozenset[int], list[int]] = {}
    for k, (i, j) in enumerate(own.pairs):
        rows.setdefault(frozenset((own.body(i), own.body(j))), []).append(k)
    touching, allowed = 0, list[str]()
    for one, two in itertools.combinations(sorted(shapes.keys() & link.keys()), 2):
        parents = robot.model.parents
        if parents[one] == two or parents[two] == one or frozenset((link[one], link[two])) in named:
            continue
        if touch(shapes[one], shapes[two], places[0][one], places[0][two]):
            continue
        for place in places[1:]:
            if not touch(shapes[one], shapes[two], place[one], place[two]):
                continue
            touching += 1
            bodies = {b: (0, 0, 0, 0, 0, (place[b].translation, place[b].rotation)) for b in (one, two)}
            left = [
                own.measure(k, np.zeros((0, 6, 4)), *(own.placed(s, bodies) for s in own.pairs[k]))[0]
                - own.clearance[k]
                for k in rows.get(frozenset((one, two)), ())
            ]
            if not min(left, default=1.0) < 0.0:
                allowed.append(f"{link[one]} - {link[two]}")
    assert touching > 5
    assert len(allowed) <= touching // 50, allowed


@pytest.mark.long
@pytest.mark.parametrize("name", [*FAST, *(pytest.param(name, marks=pytest.mark.slow) for name in SLOW)])
def test_rows_of_hulls_exclude_what_touches(name: str) -> None:
    """The shapes of a pair of links touch in a third of the configurations that its rows exclude at clearance 0.

    The bound is a quarter, for the draw.  A leg that bends as far as its joints allow passes its pelvis at a few
    millimetres.
    """
    robot = hqp.robots.load(name)
    with warnings.catch_warnings():
        warnings.simplefilter("ignore")
        own = scene(CollisionAvoidance(clearance=0.0), robot)
    shapes: dict[int, list[tuple[Any, Any]]] = {}
    for item in robot.geometry.geometryObjects:
        shapes.setdefault(item.parentJoint, []).append((item.geometry, item.placement))
    places = configurations(robot, np.random.default_rng(4), 800)
    rows: dict[frozenset[int], list[tuple[int, int]]] = {}
    for i, j in own.pairs:
        if own.is_hull(j):
            rows.setdefault(frozenset((own.body(i), own.body(j))), []).append((i, j))
    for bodies, pairs in rows.items():
        poses = {
            b: tuple(np.array([getattr(p[b], x) for p in places]) for x in ("translation", "rotation")) for b in bodies
        }
        gaps = [between(own.capsules[i], poses[own.body(i)], own.capsules[j], poses[own.body(j)]) for i, j in pairs]
        excluded = [p for p, gap in zip(places, np.min(gaps, axis=0), strict=True) if gap < 0.0]
        one, two = bodies
        contacts = sum(touch(shapes[one], shapes[two], p[one], p[two]) for p in excluded)
        assert len(excluded) < 20 or contacts > 0.25 * len(excluded), own.name(pairs[0][0])


@pytest.mark.parametrize("seed", range(3))
def test_distances_are_exact_up_to_the_one_that_is_asked_for(seed: int) -> None:
    rng = np.random.default_rng(seed)
    for _ in range(10):
        own, other, far = hull(rng), hull(rng), float(rng.choice([-0.05, 0.0, 0.05, 0.2]))
        poses = [np.array([pose(rng) for _ in range(30)]) for _ in range(2)]
        one, two = ((T[:, :3, 3] * rng.uniform(0.1, 1.0), T[:, :3, :3]) for T in poses)
        exact, found = (between(own, one, other, two, most) for most in (np.inf, far))
        np.testing.assert_array_equal(found[exact <= far], exact[exact <= far])
        assert (found[exact > far] > far).all()
        assert (found <= exact + 1e-9).all()


@pytest.mark.long
@pytest.mark.parametrize("order", [1, 2])
@pytest.mark.parametrize(
    ("name", "pairs"),
    [
        ("go2", (("base", "RL_thigh"), ("base", "RR_thigh"))),
        ("g1", (("torso_link", "left_shoulder_yaw_link"), ("torso_link", "right_shoulder_yaw_link"))),
    ],
)
def test_native_rows_are_those_of_the_functions(name: str, pairs: Any, order: int, written: Callable[..., Any]) -> None:
    """Drawn states, slow and fast, and influences: native code looks at parts of a hull, the functions at all of it."""
    robot, rng, rows = hqp.robots.load(name), np.random.default_rng(0), 0
    for influence in (0.05, 0.12, 0.3):
        with warnings.catch_warnings():
            warnings.simplefilter("ignore")
            avoid = CollisionAvoidance(pairs=pairs, influence=influence)
            own = scene(avoid, robot)
        assert [own.is_hull(j) for _, j in own.pairs].count(True) == len(own.pairs) > 2
        for speed in (0.0, 0.3, 1.0, 6.0):
            state = robot.state(robot.random_configuration(rng), speed * rng.normal(size=robot.nv))
            fast, slow = (written(avoid, state, avoid.hold(state), order, native) for native in (True, False))
            np.testing.assert_allclose(fast.J, slow.J, atol=1e-9)
            np.testing.assert_allclose(fast.lower, slow.lower, atol=1e-9 if order == 1 else 1e-5 * (1.0 + speed) ** 2)
            rows += int(np.isfinite(fast.lower).sum())
    assert rows > 40


@pytest.mark.long
@pytest.mark.parametrize("name", ["g1", "ur5", pytest.param("go1", marks=pytest.mark.slow)])
def test_links_that_are_named_are_kept_apart_or_refused(name: str) -> None:
    """All pairs of links whose capsules overlap at home, and some others: a row with a clearance, or an error."""
    robot, refused, hulls = hqp.robots.load(name), dict[tuple[str, str], str](), 0
    place, shapes = configurations(robot, np.random.default_rng(0), 0)[0], dict[str, list[Any]]()
    for c in robot.capsules:
        shapes.setdefault(c.link, []).append(c)

    def ends(c: Any) -> tuple[Any, Any]:
        return place[c.body].act(np.array(c.a)), place[c.body].act(np.array(c.b))

    def gap(one: str, two: str) -> float:
        both = itertools.product(shapes[one], shapes[two])
        return min(float(to_capsule(*ends(a), a.radius, *ends(b), b.radius)[0]) for a, b in both)

    every = [p for p in itertools.combinations(shapes, 2) if shapes[p[0]][0].body != shapes[p[1]][0].body]
    with robot.keep_shapes():
        for pair in [p for k, p in enumerate(every) if k % 20 == 0 or gap(*p) <= 0.0]:
            try:
                own = scene(CollisionAvoidance(pairs=(pair,)), robot)
            except DeclarationError as error:
                refused[pair] = str(error)
            else:
                assert (own.clearance > 0.0).all(), pair
                assert not own.overlapping
                hulls += any(own.is_hull(j) for _, j in own.pairs)
    for pair, text in refused.items():
        assert all(link in text for link in pair), text
        assert gap(*pair) <= 0.0
    assert refused
    assert hulls or name == "ur5"


@pytest.mark.long
def test_a_group_keeps_the_links_that_can_be_kept_apart() -> None:
    """Neighbours in a chain meet at their joint: the rows of the others remain."""
    robot = hqp.robots.load("g1")
    robot.groups["arm"] = [joint for joint in robot.joint_names if "left_" in joint and "hip" not in joint][-7:]
    with warnings.catch_warnings(record=True) as told:
        warnings.simplefilter("always")
        avoid = CollisionAvoidance(pairs=(("arm", "arm"), ("arm", "torso_link")))
        own = scene(avoid, robot)
    assert own.unseparated == ("left_wrist_roll_link - left_wrist_yaw_link",), told
    assert "left_wrist_roll_link - left_wrist_yaw_link" in avoid.remark(robot)
    assert (own.clearance > 0.0).all()
