"""Geometry of retargeting, each part against its definition: segments, holds, limbs, rests, rates, references."""

from __future__ import annotations

import math
from dataclasses import replace
from functools import cache
from itertools import pairwise
from types import SimpleNamespace
from typing import Any

import numpy as np
import pytest
from scipy.optimize import minimize
from scipy.spatial.transform import Rotation

import hqp
from hqp.motion import contacts as rests
from hqp.motion.anchored import lost
from hqp.motion.body import Body
from hqp.motion.branches import _enough, _excess, _placed, _worse
from hqp.motion.bvh import _rate
from hqp.motion.clip import TURNS, Motion, low_pass, unit
from hqp.motion.contacts import NAMES, RAMP, detect, runs, smooth
from hqp.motion.holds import Hold, Plane, turn, turns
from hqp.motion.joints import parts_of
from hqp.motion.measures import LEVEL, Measures, _slide, measure, segments
from hqp.motion.person import joints_of, leg_of, remarks, up_axis
from hqp.motion.retargeting import _at_rate
from hqp.motion.skeleton_map import find_map
from hqp.motion.smoothing import Course, filtered
from hqp.motion.stacks import Stacks
from hqp.motion.targets import (
    FLAT,
    Targets,
    _arm,
    _floor,
    _heading,
    _hips,
    _knee,
    _toe_height,
    _trunk,
    targets_of,
    turned,
)
from hqp.motion.tracker import LEAN, OFF, Pass, Tracker
from hqp.tasks import CollisionAvoidance
from hqp.tasks.collision_scene import scene

from .people import stand, walk
from .robots import robot as catalogued

SIDES = ("left", "right")


@cache
def g1() -> tuple[Any, Body]:
    robot = catalogued("g1")
    return robot, Body.of(robot, find_map(None, robot))


@cache
def walked() -> tuple[Motion, Targets]:
    motion = walk(2.0)
    return motion, targets_of(motion, parts_of(motion.names), g1()[1])


@cache
def tracker() -> Tracker:
    robot, body = g1()
    targets = walked()[1]
    return Tracker(robot, Stacks(robot, find_map(None, robot), body, 1.0 / targets.fps), targets)


# ------------------------------------------------------------------------------------------------ segments


@pytest.mark.parametrize("seed", range(4))
def test_the_distance_of_segments_is_the_least_of_their_points(seed: int) -> None:
    rng = np.random.default_rng(seed)
    a, b, c, d = rng.uniform(-1.0, 1.0, (4, 12, 3))
    b[0], d[1] = a[0], c[1]  # a point
    d[2] = c[2] + 2.0 * (b[2] - a[2])  # parallel ones
    found = segments(a, b, c, d)
    for k in range(12):

        def apart(x: Any, k: int = k) -> float:
            return float(np.linalg.norm(a[k] + x[0] * (b[k] - a[k]) - c[k] - x[1] * (d[k] - c[k])))

        starts = [(s, t) for s in (0.0, 0.5, 1.0) for t in (0.0, 0.5, 1.0)]
        least = min(minimize(apart, start, bounds=[(0.0, 1.0)] * 2, tol=1e-12).fun for start in starts)
        assert found[k] == pytest.approx(least, abs=1e-5)


# --------------------------------------------------------------------------------------------------- holds


@pytest.mark.parametrize("seed", range(5))
def test_turns_are_rotation_vectors(seed: int) -> None:
    rng = np.random.default_rng(seed)
    R = Rotation.from_rotvec(rng.uniform(-1.2, 1.2, (6, 3))).as_matrix()
    expected = np.array([Rotation.from_matrix(two @ one.T).as_rotvec() for one, two in pairwise(R)])
    np.testing.assert_allclose(turns(R), expected, atol=1e-9)
    np.testing.assert_allclose([turn(one, two) for one, two in pairwise(R)], expected, atol=1e-9)
    small = Rotation.from_rotvec([1e-7, -2e-7, 3e-7]).as_matrix()
    np.testing.assert_allclose(turn(np.eye(3), small), [1e-7, -2e-7, 3e-7], atol=1e-12)


def test_a_plane_turns_about_its_point_and_shifts() -> None:
    plane = Plane(np.array([0.3, -0.2]), np.array([0.05, 0.1]), 0.7)
    R = Rotation.from_rotvec([0.0, 0.0, 0.7]).as_matrix()
    np.testing.assert_allclose(plane.rotation, R, atol=1e-12)
    about, p = np.array([0.3, -0.2, 0.0]), np.array([1.0, 2.0, 3.0])
    np.testing.assert_allclose(plane.point(p), R @ (p - about) + about + [0.05, 0.1, 0.0], atol=1e-12)
    np.testing.assert_allclose(plane.point(about), about + [0.05, 0.1, 0.0], atol=1e-12)


def test_a_hold_fades_after_its_foot_has_left() -> None:
    hold = Hold(4.0)
    assert (hold.end, hold.motion) == (0, None)
    hold.take(-1, np.array([1.0, 2.0]), Plane(np.zeros(2), np.array([0.4, -0.8]), 0.6))
    assert hold.end == -1
    np.testing.assert_array_equal(hold.spot, [1.0, 2.0])
    shares = []
    for _ in range(6):
        motion = hold.motion
        shares.append(0.0 if motion is None else motion.angle / 0.6)
        if motion is not None:
            np.testing.assert_allclose(motion.shift, shares[-1] * np.array([0.4, -0.8]))
        hold.release()
        assert hold.end == 0
    t = np.array([1.0, 0.75, 0.5, 0.25, 0.0, 0.0])
    np.testing.assert_allclose(shares, t * t * (3.0 - 2.0 * t), atol=1e-12)


@pytest.mark.parametrize(
    ("toe", "heel", "end", "found"),
    [(0.0, 0.01, 0, 1), (0.01, 0.0, 0, -1), (0.001, 0.0, 0, 1), (0.001, 0.0, -1, -1), (0.0, 0.001, 1, 1),
     (0.0025, 0.0, 1, -1), (0.0, 0.0025, -1, 1)],
)  # fmt: skip
def test_the_lower_end_of_a_foot_is_held_or_the_one_of_before(toe: float, heel: float, end: int, found: int) -> None:
    hold = Hold(4.0)
    hold.end = end
    assert hold.lower(toe, heel) == found


# ------------------------------------------------------------------------------------------------- targets


def test_a_foot_is_turned_by_its_yaw_then_its_tilt() -> None:
    yaw, tilt = np.array([0.3, -2.0, 1.0]), np.array([0.4, 0.2, -0.6])
    expected = Rotation.from_euler("ZY", np.column_stack((yaw, tilt))).as_matrix()
    np.testing.assert_allclose(turned(yaw, tilt), expected, atol=1e-12)
    toe = turned(yaw, np.abs(tilt)) @ [0.1, 0.0, 0.0]
    assert np.all(toe[:, 2] < 0.0), "a positive tilt lowers the toe"


@pytest.mark.parametrize("fps", [20.0, 60.0])
def test_a_weight_is_one_in_a_rest_and_fades_around_it(fps: float) -> None:
    rng = np.random.default_rng(0)
    for share in (0.02, 0.1, 0.5):
        mask = rng.uniform(size=80) < share
        mask[40] = True
        away = np.array([np.abs(np.flatnonzero(mask) - k).min() for k in range(80)])
        x = np.clip(1.0 - away / (RAMP * fps), 0.0, 1.0)
        np.testing.assert_allclose(smooth(mask, fps), x * x * (3.0 - 2.0 * x), atol=1e-12)
    assert not smooth(np.zeros(5, dtype=bool), fps).any()


def joints(motion: Motion) -> dict[str, Any]:
    return joints_of(motion, parts_of(motion.names))


def test_axes_of_a_trunk_and_hips_follow_the_person() -> None:
    for heading in (0.0, 0.7, -2.5):
        place = joints(stand(0.2, heading))
        R = Rotation.from_rotvec([0.0, 0.0, heading]).as_matrix()
        np.testing.assert_allclose(_trunk(place)[0], R, atol=0.05)
        np.testing.assert_allclose(_hips(place, _trunk(place))[0], R, atol=0.05)
    place = joints(walked()[0])
    trunk = _trunk(place)
    np.testing.assert_allclose(np.swapaxes(trunk, 1, 2) @ trunk, np.tile(np.eye(3), (len(trunk), 1, 1)), atol=1e-9)
    shoulders, hips = (0.5 * (place[f"left_{limb}"] + place[f"right_{limb}"]) for limb in ("shoulder", "hip"))
    np.testing.assert_allclose(trunk[:, :, 2], unit(shoulders - hips), atol=1e-9)
    pelvis = _hips(place, trunk)
    np.testing.assert_allclose(pelvis[:, :, 1], unit(place["left_hip"] - place["right_hip"]), atol=1e-9)
    assert np.all(np.linalg.det(pelvis) > 0.5)
    assert np.all(np.sum(pelvis[:, :, 2] * trunk[:, :, 2], axis=1) > 0.9)


def lengths(one: Any, two: Any) -> Any:
    return np.linalg.norm(one - two, axis=1)


def test_limbs_have_the_robots_lengths_and_the_persons_directions() -> None:
    body, motion = g1()[1], walked()[0]
    place = joints(motion)
    hips = 0.5 * (place["left_hip"] + place["right_hip"])
    found = detect({**{f"{side}_toe": place[f"{side}_toe"] for side in SIDES},
                    **{n: place[n] for n in NAMES if "foot" not in n}}, motion.fps, 0.84)  # fmt: skip
    nobody = replace(found, resting={name: np.zeros_like(mask) for name, mask in found.resting.items()})
    turned = _trunk(place)
    width = np.median(lengths(place["left_hip"], place["right_hip"]))
    for side in SIDES:
        knee, thigh = _knee(place, hips, side, body), place[f"{side}_knee"] - place[f"{side}_hip"]
        hip = hips + (place[f"{side}_hip"] - hips) * body.width("hip") / width
        np.testing.assert_allclose(unit(knee - hip), unit(thigh), atol=1e-9)
        assert np.median(lengths(knee, hip)) == pytest.approx(body.length("hip", "knee"))
        arm = _arm(place, hips, turned, nobody, side, body, motion.fps)
        shoulder = hips + turned @ (body.places[f"{side}_shoulder"] - body.between("hip"))
        elbow, hand = arm[f"{side}_elbow"], arm[f"{side}_hand"]
        assert np.median(lengths(elbow, shoulder)) == pytest.approx(body.length("shoulder", "elbow"))
        assert np.median(lengths(hand, elbow)) == pytest.approx(body.length("elbow", "hand"))
        np.testing.assert_allclose(unit(elbow - shoulder), unit(place[f"{side}_elbow"] - place[f"{side}_shoulder"]))
        np.testing.assert_allclose(unit(hand - elbow), unit(place[f"{side}_hand"] - place[f"{side}_elbow"]), atol=1e-9)
        resting = replace(found, resting={name: np.ones_like(mask) for name, mask in found.resting.items()})
        rests_at = _arm(place, hips, turned, resting, side, body, motion.fps)[f"{side}_hand"]
        np.testing.assert_allclose(rests_at, place[f"{side}_hand"])


def test_the_floor_is_where_slow_ankles_are_lowest() -> None:
    times = np.arange(200) / 50.0
    low = np.zeros((200, 3))
    low[:, 2] = 0.08 + np.where(times < 2.0, 0.0, 0.3)
    low[:, 0] = np.where(times < 2.0, 0.0, 2.0 * (times - 2.0))  # fast and high later
    high = low + [0.0, 0.2, 0.5]
    floor = _floor({"left_ankle": low, "right_ankle": high}, 50.0, 0.9)
    np.testing.assert_allclose(floor, [0.0, 0.0, 0.08], atol=1e-9)
    dips = low.copy()
    dips[150:, 2] = -1.0  # below, but fast: no floor
    np.testing.assert_allclose(
        _floor({"left_ankle": dips, "right_ankle": high}, 50.0, 0.9), [0.0, 0.0, 0.08], atol=1e-9
    )
    ankle = np.column_stack((np.zeros(100), np.zeros(100), np.linspace(0.0, 1.0, 100)))
    toe = ankle - [0.0, 0.0, 0.05]
    assert _toe_height({"left_ankle": ankle, "left_toe": toe}, "left", 0.9) == pytest.approx(-0.05 + 0.03, abs=5e-3)


def test_a_foot_that_points_down_has_the_yaw_of_the_trunk() -> None:
    trunk = np.tile(Rotation.from_rotvec([0.0, 0.0, 1.1]).as_matrix(), (4, 1, 1))
    ahead = np.array([math.cos(0.4), math.sin(0.4), 0.0])
    way = np.array([s * ahead - math.sqrt(1.0 - s * s) * np.array([0.0, 0.0, 1.0]) for s in (1.0, 0.51, 0.19, 0.0)])
    np.testing.assert_allclose(_heading(0.2 * way, trunk), [0.4, 0.4, 1.1, 1.1], atol=1e-6)
    half = 0.35 * ahead - math.sqrt(1.0 - 0.35**2) * np.array([0.0, 0.0, 1.0])
    assert _heading(np.array([half, half]), trunk[:2])[0] == pytest.approx(0.75, abs=1e-6)


@pytest.mark.parametrize("heading", [0.9, -2.2])
def test_a_person_who_turns_turns_all_targets(heading: float) -> None:
    motion, found = walked()
    R = Rotation.from_rotvec([0.0, 0.0, heading]).as_matrix()
    other = targets_of(replace(motion, positions=3.0 * motion.positions @ R.T), parts_of(motion.names), g1()[1])
    assert other.scale == pytest.approx(found.scale / 3.0)
    for name, place in found.places.items():
        np.testing.assert_allclose(other.places[name], place @ R.T, atol=1e-9)
    for name, axes in found.axes.items():
        np.testing.assert_allclose(other.axes[name], R @ axes, atol=1e-9)
    for name, mask in found.contacts.resting.items():
        np.testing.assert_array_equal(other.contacts.resting[name], mask)


def test_standing_soles_are_flat_on_the_floor_where_ankles_are() -> None:
    body, motion = g1()[1], stand(0.5)
    found = targets_of(motion, parts_of(motion.names), body)
    assert found.scale == pytest.approx(body.leg / leg_of(joints(motion)))
    for side in SIDES:
        sole = found.places[f"{side}_sole"]
        np.testing.assert_allclose(sole[:, 2], 0.0, atol=1e-9)
        ankle = found.scale * motion.joint(parts_of(motion.names)[f"{side}_ankle"])
        np.testing.assert_allclose((sole - ankle)[:, :2], np.tile(body.levers[side][:2], (len(sole), 1)), atol=1e-6)
        np.testing.assert_allclose(found.axes[f"{side}_sole"][0], body.axes[f"{side}_sole"], atol=0.05)
        assert not found.edge[side].any()
    hips: Any = 0.5 * sum(found.scale * motion.joint(parts_of(motion.names)[f"{side}_hip"]) for side in SIDES)
    lift = -np.mean([body.levers[side][2] for side in SIDES])
    ankles = min(float(motion.joint(parts_of(motion.names)[f"{side}_ankle"])[0, 2]) for side in SIDES)
    np.testing.assert_allclose(found.places["pelvis"][:, 2], hips[:, 2] - found.scale * ankles + lift, atol=1e-6)
    assert FLAT > 0.0


def test_thinned_targets_are_every_other_frame() -> None:
    found = walked()[1]
    thin = found.thinned(3)
    assert (thin.fps, len(thin)) == (found.fps / 3.0, len(found.person[::3]))
    for name, place in found.places.items():
        np.testing.assert_array_equal(thin.places[name], place[::3])
    for side in SIDES:
        np.testing.assert_array_equal(thin.edge[side], found.edge[side][::3])
        np.testing.assert_array_equal(thin.contacts.ground[f"{side}_foot"], found.contacts.ground[f"{side}_foot"][::3])
    np.testing.assert_array_equal(thin.contacts.array(), found.contacts.array()[::3])


# ---------------------------------------------------------------------------------------------------- rests


def test_runs_are_stretches_of_true() -> None:
    assert runs(np.array([1, 1, 0, 1, 0, 0, 1], dtype=bool)) == [(0, 2), (3, 4), (6, 7)]
    assert runs(np.zeros(3, dtype=bool)) == []
    assert runs(np.ones(3, dtype=bool)) == [(0, 3)]


@pytest.mark.parametrize(("first", "last", "kept"), [(1, 4, False), (0, 3, True), (97, 100, True), (96, 99, False)])
def test_a_short_gap_is_filled_unless_it_touches_an_end(first: int, last: int, kept: bool) -> None:
    mask = np.ones(100, dtype=bool)
    mask[first:last] = False
    assert rests._without_short(mask, 100.0)[first:last].any() != kept


def test_a_rest_begins_slow_and_ends_fast() -> None:
    """Speeds of 0.2 m/s continue a rest that began below 0.15, and begin none."""
    fps, leg = 100.0, 1.0
    for before, expected in ((0.0, True), (0.5, False)):
        speed = np.repeat([before, 0.2, 0.5], 60)
        place = np.column_stack((np.concatenate(([0.0], np.cumsum(speed)[:-1])) / fps, np.zeros(180), np.zeros(180)))
        mask = rests.rests(place, fps, leg)
        assert mask[10:50].all() == expected
        assert not mask[64:].any()
        back = rests.rests(place[::-1], fps, leg)[::-1]
        np.testing.assert_array_equal(back[10:50], mask[10:50])
    still = rests.rests(np.zeros((50, 3)), fps, leg)
    assert still.all()


def test_a_hand_is_above_the_nearest_ground_beside_it() -> None:
    place = np.array([[0.0, 0.0, 0.5], [1.0, 0.0, 0.5], [2.0, 0.0, 0.5], [1.0, 0.0, -0.1]])
    grounds = np.array([[1.0, 0.0, 0.4]])
    np.testing.assert_allclose(rests._above(place, grounds, 1.0), [0.5, 0.1, 0.5, 0.1])
    np.testing.assert_allclose(rests._above(place, grounds, 2.0), [0.1, 0.1, 0.1, 0.1])


def test_grounds_are_where_feet_stood_above_the_floor() -> None:
    toe = np.column_stack((np.r_[np.zeros(10), np.ones(10)], np.full(20, 0.3), np.r_[np.zeros(10), np.full(10, 0.25)]))
    mask = np.ones(20, dtype=bool)
    mask[9:11] = False
    level = np.r_[np.zeros(10), np.full(10, 0.25)]
    nobody = np.zeros(20, dtype=bool)
    found = rests._grounds(
        {"left_toe": toe, "right_toe": toe}, {"left_foot": mask, "right_foot": nobody},
        {"left_foot": level, "right_foot": level},
    )  # fmt: skip
    np.testing.assert_allclose(found, [[1.0, 0.3, 0.25]])


# --------------------------------------------------------------------------------------------------- rates


@pytest.mark.parametrize(
    ("written", "rate"),
    [("0.008333", 120.0), ("0.033367", 30000.0 / 1001.0), ("0.03", 1.0 / 0.03), ("0.0333333", 30.0), ("1", 1.0),
     ("2.0", 0.5), ("0.0416667", 24.0), ("0.0417083", 24000.0 / 1001.0), ("0.1", 10.0), ("0.00416667", 240.0),
     ("0.0166833", 60000.0 / 1001.0)],
)  # fmt: skip
def test_a_frame_time_is_the_rate_that_it_was_written_from(written: str, rate: float) -> None:
    assert _rate(written) == pytest.approx(rate, rel=1e-12)


@pytest.mark.parametrize("written", ["0", "-0.01", "fast", "nan", "inf", ""])
def test_what_is_no_frame_time_is_refused(written: str) -> None:
    with pytest.raises(hqp.HqpError, match="frame time"):
        _rate(written)


def test_masks_take_the_nearest_frame_of_another_rate() -> None:
    mask = np.array([[0], [0], [1], [1], [0]], dtype=bool)
    assert _at_rate(mask, 10.0, 30.0, 13)[:, 0].tolist() == [0, 0, 0, 0, 0, 1, 1, 1, 1, 1, 1, 0, 0]
    assert _at_rate(mask, 30.0, 10.0, 2)[:, 0].tolist() == [0, 1]
    assert _at_rate(mask, 10.0, 10.0, 6)[:, 0].tolist() == [0, 0, 1, 1, 0, 0]


def test_a_motion_at_another_rate_passes_through_its_frames() -> None:
    times = np.arange(21) / 20.0
    places = np.stack([np.column_stack((np.sin(times), times**2, 0.0 * times))], axis=1)
    motion = Motion(("hips",), places, 20.0)
    twice = motion.at_rate(40.0)
    assert (len(twice), twice.fps) == (41, 40.0)
    np.testing.assert_allclose(twice.positions[::2], places, atol=1e-12)
    np.testing.assert_allclose(twice.positions[:, 0, 1], (np.arange(41) / 40.0) ** 2, atol=1e-9)
    assert len(motion.at_rate(7.0)) == 8
    assert motion.at_rate(20.0) is motion


def test_a_low_pass_keeps_slow_motion_and_removes_fast_one_without_lag() -> None:
    times = np.arange(400) / 100.0
    slow, fast = np.sin(2.0 * np.pi * 0.5 * times), np.sin(2.0 * np.pi * 30.0 * times)
    found = low_pass((slow + fast)[:, None], 6.0, 100.0)[:, 0]
    np.testing.assert_allclose(found[50:-50], slow[50:-50], atol=5e-3)
    half = low_pass(np.sin(2.0 * np.pi * 6.0 * times)[:, None], 6.0, 100.0)[:, 0]
    assert np.abs(half[100:-100]).max() == pytest.approx(0.5, abs=0.01)  # twice 3 dB
    line = np.linspace(0.0, 1.0, 60)[:, None]
    np.testing.assert_allclose(low_pass(line, 6.0, 100.0), line, atol=1e-3)


@pytest.mark.parametrize("up", list(TURNS))
def test_the_axis_that_is_up_becomes_z_by_a_rotation(up: str) -> None:
    motion = Motion(tuple("abc"), np.tile(np.eye(3), (2, 1, 1)), 10.0)
    R = motion.turned(up).positions[0].T
    assert np.linalg.det(R) == pytest.approx(1.0)
    axis = np.eye(3)["xyz".index(up[-1])] * (-1.0 if up[0] == "-" else 1.0)
    np.testing.assert_array_equal(R @ axis, [0.0, 0.0, 1.0])


# -------------------------------------------------------------------------------------------------- person


def test_a_person_is_measured_and_described() -> None:
    place = joints(stand(0.2))
    assert remarks(place) == ()
    ways = [
        lengths(place[f"{s}_hip"], place[f"{s}_knee"]) + lengths(place[f"{s}_knee"], place[f"{s}_ankle"]) for s in SIDES
    ]
    assert leg_of(place) == pytest.approx(np.median(np.mean(ways, axis=0)))
    lying = {part: p @ Rotation.from_rotvec([0.0, np.pi / 2.0, 0.0]).as_matrix().T for part, p in place.items()}
    count = len(place["left_hip"])
    assert remarks(lying) == (f"the person lies in {count} of {count} frames, from frame 0 to {count - 1}",)
    over = {part: p @ Rotation.from_rotvec([np.pi, 0.0, 0.0]).as_matrix().T for part, p in place.items()}
    assert "upside down" in " ".join(remarks(over))
    mirrored = {part: p * [-1.0, 1.0, 1.0] for part, p in place.items()}
    assert "mirrored" in " ".join(remarks(mirrored))
    crossed = {**place, "left_shoulder": place["right_shoulder"], "right_shoulder": place["left_shoulder"]}
    assert "exchanged" in remarks(crossed)[0]


def test_the_axis_of_a_person_who_stands() -> None:
    motion = stand(0.2)
    motion = replace(motion, positions=motion.positions + [2.0, 2.0, 0.0])  # else one lies on a side at zero
    for up, (axes, signs) in TURNS.items():
        places = np.empty_like(motion.positions)
        places[..., axes] = motion.positions * np.array(signs)
        turned = replace(motion, positions=places)
        assert up_axis(turned, joints(turned), "y" if up[-1] != "y" else "z") == up
        assert up_axis(turned, joints(turned), up) == up


# ----------------------------------------------------------------------------------------------- measures


def test_a_flat_sole_slides_as_its_slower_end_a_tilted_one_as_its_lower() -> None:
    fps = 10.0
    toe, heel = np.zeros((6, 3)), np.zeros((6, 3))
    toe[:, 0], heel[:, 1] = 0.03 * np.arange(6), 0.01 * np.arange(6)
    toe[:2, 2], heel[2:4, 2] = 2.0 * LEVEL, 2.0 * LEVEL
    mask = np.array([1, 1, 1, 1, 1, 0], dtype=bool)
    found = _slide({"left_toe": toe, "left_heel": heel}, mask, "left", fps)
    np.testing.assert_allclose(found, [0.1, 0.1, 0.3, 0.3, np.nan])
    assert _slide({"left_toe": toe, "left_heel": heel}, np.ones(6, dtype=bool), "left", fps)[4] == pytest.approx(0.1)


def test_a_summary_has_each_figure_in_its_place() -> None:
    n = 1001
    ramp = np.arange(n) / (n - 1.0)
    parts = ("left_hand", "right_hand", "left_toe", "right_toe", "torso", "left_sole", "right_sole")
    errors = {part: (k + 1.0) * ramp for k, part in enumerate(parts)}
    slide = {"left": np.full(n - 1, np.nan), "right": np.where(np.arange(n - 1) < 250, 0.02, 0.005)}
    found = Measures(
        errors, slide, 11.0 * ramp, 1.0 + ramp, 12.0 * ramp, 13.0 * ramp, 14.0 * ramp, 15.0 * ramp
    ).summary()
    assert found["slide_share"] == pytest.approx(0.25)
    assert found["slide_p99"] == pytest.approx(0.02)
    assert (found["penetration"], found["clearance"], found["beyond"], found["speed"]) == (11.0, 1.0, 14.0, 15.0)
    hands, feet = np.r_[ramp, 2.0 * ramp], np.r_[3.0 * ramp, 4.0 * ramp]
    assert found["hand_p50"] == pytest.approx(np.quantile(hands, 0.5))
    assert found["hand_p99"] == pytest.approx(np.quantile(hands, 0.99))
    assert found["hand_end"] == 2.0
    assert (found["foot_p50"], found["foot_p99"]) == pytest.approx(np.quantile(feet, [0.5, 0.99]))
    assert found["trunk_p99"] == pytest.approx(5.0 * 0.99)
    assert found["sole_p99"] == pytest.approx(np.quantile(np.r_[6.0 * ramp, 7.0 * ramp], 0.99))
    assert (found["acceleration_p99"], found["jerk_p99"]) == pytest.approx((12.0 * 0.99, 13.0 * 0.99))


def test_figures_of_a_pose_are_its_distances() -> None:
    robot, _ = g1()
    stacks, targets = tracker().stacks, walked()[1].thinned(20)
    lower, upper = (np.where(np.isfinite(x), x, 0.0) for x in (robot.lower, robot.upper))
    step = np.zeros(robot.nv)
    column = robot.joints("left_elbow_joint")[0]
    step[2], step[column] = -0.03, upper[column] - robot.state(robot.home).angles[column] + 0.07
    q = np.array([robot.integrate(robot.home, step, 1.0)] * len(targets))
    found = measure(robot, stacks, targets, q)
    state = robot.state(q[0])
    for name, task in stacks.points.items():
        np.testing.assert_allclose(found.errors[name], lengths(task.value(state), targets.places[name]), atol=1e-9)
    for name in ("torso", "left_sole", "right_sole"):
        R = state.rotation(find_map(None, robot).frames[name])
        angle = Rotation.from_matrix(R.T @ targets.axes[name]).magnitude()
        np.testing.assert_allclose(found.errors[name], angle, atol=1e-6)
    np.testing.assert_allclose(found.penetration, 0.03, atol=2e-3)
    np.testing.assert_allclose(found.beyond, 0.07, atol=1e-9)
    assert np.all(lower <= upper)
    assert not found.speed.any()


@pytest.mark.long
@pytest.mark.parametrize("seed", range(3))
def test_the_clearance_is_that_of_the_nearest_pair(seed: int) -> None:
    """Also of drawn postures in which links are inside each other, and beside hulls."""
    robot, _ = g1()
    stacks, targets = tracker().stacks, walked()[1].thinned(3)
    spread = np.linspace(0.02, 0.6, len(targets))[:, None] * np.r_[np.zeros(6), np.ones(robot.nv - 6)]
    drawn = spread * np.random.default_rng(seed).normal(size=spread.shape)
    q = np.array([robot.integrate(robot.home, step, 1.0) for step in drawn])
    found = measure(robot, stacks, targets, q).clearance
    pairs = scene(CollisionAvoidance(clearance=0.0), robot)
    assert any(pairs.is_hull(j) for _, j in pairs.pairs)
    for k, at in enumerate(q):
        robot.state(at).kinematics()
        apart = [
            pairs.measure(row, np.zeros((0, 4, 4)), pairs.placed(i), pairs.placed(j))[0] - pairs.clearance[row]
            for row, (i, j) in enumerate(pairs.pairs)
        ]
        assert found[k] == pytest.approx(min(apart), abs=1e-9)
    assert found.min() < 0.0 < found.max()


# ----------------------------------------------------------------------------------------------- references


def test_references_are_the_targets_and_their_rates_both_ways() -> None:
    track, targets = tracker(), walked()[1]
    fps = targets.fps
    frame = next(k for k in range(5, len(targets)) if len(track.feet(k, k + 1)) == 1 and len(track.feet(k, k - 1)) == 1)
    for step in (1, -1):
        standing = track.standing(frame)
        found: Any = {r.name: r for r in track.references(frame, frame + step, standing, {})}
        between = min(frame, frame + step)
        for name in ("pelvis", "left_hand", "right_elbow", "left_knee"):
            place = targets.places[name]
            np.testing.assert_allclose(found[name].value, place[frame])
            np.testing.assert_allclose(
                found[name].velocity, step * fps * (place[between + 1] - place[between]), atol=1e-9
            )
        for name in ("torso", "hips"):
            R = targets.axes[name]
            np.testing.assert_allclose(found[name].value, R[frame])
            w = Rotation.from_matrix(R[between + 1] @ R[between].T).as_rotvec()
            np.testing.assert_allclose(found[name].velocity, step * fps * w, atol=1e-9)
        ((side, end),) = standing
        other = "right" if side == "left" else "left"
        down = {1: "toe", -1: "heel"}
        spot, height = found[f"{side}_{down[end]}_spot"], found[f"{side}_{down[end]}_height"]
        sole, axes = targets.places[f"{side}_sole"][frame], targets.axes[f"{side}_sole"][frame]
        corner = {1: g1()[1].toes, -1: g1()[1].heels}[end][side]
        at = sole + axes @ g1()[1].axes[f"{side}_sole"].T @ corner
        np.testing.assert_allclose(spot.value, at[:2], atol=1e-9)
        np.testing.assert_array_equal(spot.velocity, np.zeros(2))
        assert float(height.value[0]) == pytest.approx(0.0, abs=2e-2)
        assert found[f"{other}_toe"].velocity is not None
        np.testing.assert_allclose(found[f"{other}_sole"].value, targets.axes[f"{other}_sole"][frame])


def test_a_released_foot_is_moved_by_its_hold() -> None:
    track = tracker()
    frame = next(k for k in range(5, len(track.targets)) if len(track.feet(k, k + 1)) == 1)
    side = next(s for s in SIDES if s not in track.feet(frame, frame + 1))
    standing = track.standing(frame)
    free: Any = {r.name: r for r in track.references(frame, frame + 1, standing, {})}
    hold = Hold(5.0)
    plane = Plane(np.array([0.1, 0.2]), np.array([0.05, -0.03]), 0.4)
    hold.take(1, np.zeros(2), plane)
    moved: Any = {r.name: r for r in track.references(frame, frame + 1, standing, {side: hold})}
    toe, sole = f"{side}_toe", f"{side}_sole"
    np.testing.assert_allclose(moved[toe].value, plane.point(free[toe].value))
    np.testing.assert_allclose(moved[toe].velocity, plane.rotation @ free[toe].velocity)
    np.testing.assert_allclose(moved[sole].value, plane.rotation @ free[sole].value)
    np.testing.assert_allclose(moved[sole].velocity, plane.rotation @ free[sole].velocity)
    np.testing.assert_allclose(moved["pelvis"].value, free["pelvis"].value)


def test_errors_are_shares_of_what_is_behind() -> None:
    """Level by level; a foot by the end that it stands on, whichever the person stands on."""
    track, (robot, body), targets = tracker(), g1(), walked()[1]
    frames = find_map(None, robot).frames
    edges = {side: np.zeros(len(targets), dtype=np.int8) for side in SIDES}
    on_heels = replace(targets, edge={side: edge - 1 for side, edge in edges.items()})
    for given, ends in ((replace(targets, edge=edges), body.toes), (on_heels, body.heels)):
        found = Tracker(robot, track.stacks, given).errors(np.array([robot.home] * len(targets)))
        assert found.shape == (len(targets), 7)
        state = robot.state(robot.home)
        for i in (0, 20, 40):
            expected = []
            for side in SIDES:
                end = ends[side] if given.contacts.resting[f"{side}_foot"][i] else body.toes[side]
                turned_back = targets.axes[f"{side}_sole"][i] @ body.axes[f"{side}_sole"].T
                at = targets.places[f"{side}_sole"][i] + turned_back @ end
                own = state.rotation(frames[f"{side}_sole"]) @ body.axes[f"{side}_sole"].T @ end
                sole = state.position(frames[f"{side}_sole"]) + state.rotation(frames[f"{side}_sole"]) @ np.array(
                    find_map(None, robot).offset(f"{side}_sole")
                )
                expected.append(np.linalg.norm(sole + own - at) / OFF)
            expected += [
                np.linalg.norm(track.stacks.points[f"{s}_hand"].value(state) - targets.places[f"{s}_hand"][i]) / OFF
                for s in SIDES
            ]
            for name in ("left_sole", "right_sole", "torso"):
                R = state.rotation(frames[name])
                expected.append(Rotation.from_matrix(R.T @ targets.axes[name][i]).magnitude() / LEAN)
            np.testing.assert_allclose(found[i], expected, atol=1e-6)


def test_passes_join_in_one_frame_and_run_backwards() -> None:
    one = Pass(np.arange(6.0).reshape(3, 2), np.ones((3, 1)), ["a", "b"])
    two = Pass(np.arange(4.0, 10.0).reshape(3, 2), 2.0 * np.ones((3, 1)), ["c", "d"])
    both = one.then(two)
    np.testing.assert_array_equal(both.q, np.arange(10.0).reshape(5, 2))
    np.testing.assert_array_equal(both.v[:, 0], [1.0, 1.0, 1.0, 2.0, 2.0])
    assert both.statuses == ["a", "b", "c", "d"]
    back = one.reversed()
    np.testing.assert_array_equal(back.q, one.q[::-1])
    np.testing.assert_array_equal(back.v, -one.v)
    assert back.statuses == ["b", "a"]


@pytest.mark.parametrize(("hand", "left", "right", "found"), [(0, 1, 1, 1), (1, 0, 1, 1), (1, 1, 0, -1), (-1, 0, 0, 0)])
def test_a_foot_stands_while_it_rests_in_both_frames(hand: int, left: int, right: int, found: int) -> None:
    del hand
    edge = {"left": np.array([0, left * found, found]), "right": np.zeros(3, dtype=int)}
    resting = {"left": np.array([1, left, 1], dtype=bool), "right": np.array([1, right, 0], dtype=bool)}
    part: Any = SimpleNamespace(_resting=resting, targets=SimpleNamespace(edge=edge))
    feet = vars(Tracker)["feet"](part, 0, 1)
    assert set(feet) == {side for side, on in (("left", left), ("right", right)) if on}
    if left:
        assert feet["left"] == found


# --------------------------------------------------------------------------------------------------- start


def reached(**residuals: float) -> Any:
    return SimpleNamespace(
        residuals={"subject_to": 0.0, "stance": 0.0, "hands": 0.0, "soles": 0.0, "trunk": 0.0, **residuals}
    )


def test_a_start_is_enough_if_nothing_is_behind() -> None:
    assert _enough(reached())
    assert _enough(reached(trunk=0.19, soles=0.19, posture=9.0))
    assert not _enough(reached(hands=0.006))
    assert not _enough(reached(trunk=0.21))
    assert _excess(reached(hands=0.1, trunk=1.2)) == pytest.approx(1.0 + 0.5)


def test_the_worse_start_has_more_behind_or_is_off_in_a_higher_level() -> None:
    assert _worse(reached(trunk=1.2), reached(hands=0.02))
    assert not _worse(reached(hands=0.02), reached(trunk=1.2))
    assert _worse(reached(hands=0.03), reached(hands=0.02, trunk=0.5))
    assert not _worse(reached(hands=0.02), reached(hands=0.023))
    assert _worse(reached(stance=0.03), reached(hands=0.04))


def test_starts_face_four_ways_with_the_hips_in_place() -> None:
    track, robot, body = tracker(), *g1()
    frame = 7
    starts = list(_placed(track, frame))
    torso = walked()[1].axes["torso"][frame] @ body.axes["torso"].T
    yaw = math.atan2(torso[1, 0], torso[0, 0])
    for q, heading in zip(starts, (0.0, 0.5 * math.pi, -0.5 * math.pi, math.pi), strict=True):
        state = robot.state(q)
        frames = find_map(None, robot).frames
        hips = 0.5 * (state.position(frames["left_hip"]) + state.position(frames["right_hip"]))
        np.testing.assert_allclose(hips, walked()[1].places["pelvis"][frame], atol=1e-6)
        R = Rotation.from_rotvec([0.0, 0.0, yaw + heading]).as_matrix()
        np.testing.assert_allclose(state.rotation(frames["torso"]), R @ body.axes["torso"], atol=1e-6)


def test_a_lag_counts_by_its_duration_and_its_size() -> None:
    track: Any = SimpleNamespace(dt=0.01, stacks=tracker().stacks)
    errors = np.zeros((100, 7))
    errors[40:49, 3] = 1.5
    assert not any(lost(track, errors))
    errors[49, 3] = 1.5
    errors[60:80, 1] = 0.99
    assert lost(track, errors) == pytest.approx((0.0, 10 * 0.5, 0.0, 0.0))


# --------------------------------------------------------------------------------------------------- stacks


def test_a_start_may_turn_its_feet_and_a_motion_may_not() -> None:
    stacks = tracker().stacks
    standing = (("left", 1),)
    levels = {level.name: [e.name for e in level] for level in stacks.stack(standing).levels}
    begun = {level.name: [e.name for e in level] for level in stacks.starting(standing).levels}
    assert "left_line" in levels["ground"]
    assert "left_line" not in levels["soles"]
    assert "left_line" in begun["soles"]
    assert "left_line" not in begun["ground"]
    assert levels["stance"] == ["left_toe_spot"]
    assert levels["swing"] == ["right_toe"]
    assert levels["ground"] == ["left_toe_height", "left_heel_above", "left_line"]
    assert levels["soles"] == ["left_heel_height", "right_sole"]
    heel = {level.name: [e.name for e in level] for level in stacks.stack((("left", -1), ("right", 1))).levels}
    assert heel["stance"] == ["left_heel_spot", "right_toe_spot"]
    assert "swing" not in heel
    closing = [level.name for level in stacks.closing(standing).levels]
    assert closing == ["stance", "ground", "swing", "hands", "motion"]


def test_links_keep_apart_and_above_the_floor_unless_told_otherwise() -> None:
    robot, body = g1()
    names = {c.name for c in tracker().stacks.stack(()).subject_to}
    assert {"self_collision", "floor"} <= names
    free = Stacks(robot, find_map(None, robot), body, 0.01, collision=False)
    assert not {"self_collision", "floor"} & {c.name for c in free.stack(()).subject_to}
    assert free.links == tracker().stacks.links
    assert free.posture.law == hqp.P(1.0)
    assert (free.hips.law, free.soles["left"].law) == (hqp.P(10.0), hqp.P(30.0))
    quick = Stacks(robot, find_map(None, robot), body, 0.1, collision=False)
    assert (quick.hips.law, quick.soles["left"].law) == (hqp.P(5.0), hqp.P(5.0))


def test_corners_of_the_soles_are_those_of_the_shapes() -> None:
    robot, body = g1()
    state = robot.state(robot.home)
    found = np.array([task.value(state)[-1] for task in tracker().stacks.corners])
    np.testing.assert_allclose(found, body.places["left_sole"][2], atol=2e-3)
    ends = {task.name: task.value(state) for _, task in tracker().stacks.edges}
    for side in SIDES:
        np.testing.assert_allclose(ends[f"{side}_toe"], body.places[f"{side}_sole"] + body.toes[side], atol=1e-6)
        np.testing.assert_allclose(ends[f"{side}_heel"], body.places[f"{side}_sole"] + body.heels[side], atol=1e-6)


# ------------------------------------------------------------------------------------------------- last pass


def test_the_last_pass_asks_for_the_low_passed_motion() -> None:
    track, robot = tracker(), g1()[0]
    n, fps = 60, walked()[1].fps
    times = np.arange(n) / fps
    column = robot.joints("left_elbow_joint")[0]
    way = np.zeros((n, robot.nv))
    way[:, column], way[:, 0], way[:, 5] = 0.3 * np.sin(3.0 * times), 0.2 * times, 0.5 * times
    q = np.array([robot.integrate(robot.home, step, 1.0) for step in way])
    q[n // 2 :, 3:7] *= -1.0  # the other sign of the same rotation
    found = filtered(track.robot, q, track.targets.fps)
    np.testing.assert_allclose(np.linalg.norm(found[:, 3:7], axis=1), 1.0, atol=1e-12)
    smooth_way = low_pass(way[:, column : column + 1], 6.0, fps)[:, 0]
    angles = np.array([robot.state(each).angles[column] for each in found])
    np.testing.assert_allclose(angles - robot.state(robot.home).angles[column], smooth_way, atol=1e-6)
    course = Course(track, q)
    for i in (0, 20, n - 2):
        given: Any = course.references(i)
        tasks = {
            **track.stacks.points,
            **{task.name: task for _, task in track.stacks.edges},
            "base": track.stacks.base,
        }
        here = {name: task.value(robot.state(found[i])) for name, task in tasks.items()}
        there = {name: task.value(robot.state(found[i + 1])) for name, task in tasks.items()}
        for name in ("left_hand", "right_toe"):
            np.testing.assert_allclose(given[name].value, here[name], atol=1e-9)
            np.testing.assert_allclose(given[name].velocity, fps * (there[name] - here[name]), atol=1e-6)
        one, two = here["base"], there["base"]
        np.testing.assert_allclose(given["base"].value, one, atol=1e-9)
        w = Rotation.from_matrix(two[:3, :3] @ one[:3, :3].T).as_rotvec()
        np.testing.assert_allclose(given["base"].velocity, fps * np.r_[two[:3, 3] - one[:3, 3], w], atol=1e-6)
        before = robot.state(q[i])
        ends = [track.stacks.down("left", end).value(before)[2] for end in (1, -1)]
        np.testing.assert_allclose(course.heights("left", i), ends, atol=1e-12)


# ---------------------------------------------------------------------------------------------------- hands


@pytest.mark.parametrize("name", ["g1", "talos", "cbi"])
def test_no_hand_is_to_be_lower_than_its_shapes_allow(name: str) -> None:
    """A hand at its lowest target reaches the floor in any turn, with a single capsule exactly so in some turn.  Hands
    of a person below the floor become targets on it."""
    robot, rng = catalogued(name), np.random.default_rng(4)
    found = find_map(None, robot)
    body = Body.of(robot, found)
    for side in SIDES:
        state, frame = robot.state(robot.home), found.frames[f"{side}_hand"]
        state.kinematics()
        number = robot.body(robot.frame(frame))
        at, turned_by = robot.bodies[number][5]
        point = turned_by.T @ (body.places[f"{side}_hand"] - at)
        own = [c for c in robot.capsules if c.body == number]
        lowest = [
            min(R[2] @ (np.array(end) - point) - c.radius for c in own for end in (c.a, c.b))
            for R in Rotation.random(4000, rng).as_matrix()
        ]
        assert body.thickness[side] <= -max(lowest) + 1e-9
        assert len(own) > 1 or body.thickness[side] > -max(lowest) - 2e-3
    motion = walk(0.5)
    places = motion.positions.copy()
    hands = [motion.names.index(f"{side}Hand") for side in ("Left", "Right")]
    places[:, hands, 2] = rng.uniform(-0.2, 0.02, (len(motion), 2))
    targets = targets_of(Motion(motion.names, places, motion.fps), parts_of(motion.names), body)
    for side in SIDES:
        assert (targets.places[f"{side}_hand"][:, 2] >= body.thickness[side]).all()
