"""People whose hips and shoulders contradict each other, or whose place is far away."""

from __future__ import annotations

from functools import cache
from typing import Any

import numpy as np
import pytest
from scipy.spatial.transform import Rotation

from hqp.errors import DeclarationError
from hqp.motion import Motion, retarget
from hqp.motion.body import Body
from hqp.motion.joints import parts_of
from hqp.motion.schedule import grounded, schedule_of
from hqp.motion.skeleton_map import find_map
from hqp.motion.targets import targets_of

from .people import NAMES, PARENTS, stand
from .robots import robot as catalogued

ARMS = [k for k, name in enumerate(NAMES) if "Arm" in name or "Hand" in name]


@cache
def _g1() -> Body:
    robot = catalogued("g1")
    return Body.of(robot, find_map(None, robot))


def _turned(axis: Any, angles: Any) -> Motion:
    """A standing person whose arms turn about an axis through the hips."""
    motion = stand(2.0)
    places, hips = motion.positions.copy(), motion.positions[:, :1]
    turns = Rotation.from_rotvec(np.outer(angles, axis)).as_matrix()
    places[:, ARMS] = hips + np.einsum("tij,tkj->tki", turns, (places - hips)[:, ARMS])
    return Motion(NAMES, places, motion.fps, PARENTS)


@pytest.mark.parametrize("seed", range(8))
def test_axes_are_rotations_however_the_trunk_turns(seed: int) -> None:
    """Shoulders that turn by a full turn, and a trunk that folds along the hips, in drawn frames exactly so."""
    rng = np.random.default_rng(seed)
    angles = np.pi * rng.integers(-4, 5, 60) / [1, 2, 4][seed % 3]
    motion = _turned([[0.0, 0.0, 1.0], [1.0, 0.0, 0.0]][seed % 2], angles)
    found = targets_of(motion, parts_of(NAMES), _g1())
    for axes in found.axes.values():
        np.testing.assert_allclose(np.linalg.det(axes), 1.0, atol=1e-6)
        np.testing.assert_allclose(axes @ np.swapaxes(axes, 1, 2), np.tile(np.eye(3), (60, 1, 1)), atol=1e-6)
    assert all(np.isfinite(place).all() for place in found.places.values())


def _upturned(rng: np.random.Generator) -> Motion:
    """A person on hands, back, front or a side for the whole motion, the lowest joint a little above the floor."""
    motion = stand(0.5)
    way = rng.uniform(-np.pi, np.pi)
    lean = Rotation.from_rotvec(rng.uniform(1.4, np.pi) * np.array([np.cos(way), np.sin(way), 0.0]))
    places = motion.positions @ lean.as_matrix().T
    return Motion(NAMES, places - [0.0, 0.0, places[..., 2].min() - 0.05], motion.fps, PARENTS)


@pytest.mark.parametrize("seed", range(12))
def test_the_floor_is_below_all_limbs_of_one_who_never_stands(seed: int) -> None:
    """Hips are as high above the floor as the person's, in the robot's size, and feet in the air carry nothing."""
    motion = _upturned(np.random.default_rng(seed))
    found = targets_of(motion, parts_of(NAMES), _g1())
    height = found.scale * motion.joint("Hips")[0, 2]
    assert found.places["pelvis"][0, 2] == pytest.approx(height, abs=0.06)
    for side in ("left", "right"):
        foot, knee = (motion.joint(f"{side.title()}{name}")[0, 2] for name in ("Foot", "Leg"))
        assert not (foot > knee + 0.1 and found.contacts.resting[f"{side}_foot"].any())


@pytest.mark.parametrize("frames", [2, 3, 8])
def test_one_who_is_never_slow_has_a_floor(frames: int) -> None:
    """Moved by 0.25 m a frame all along: the floor is below the feet all the same."""
    still, body = stand(1.0), _g1()
    moved = still.positions[:frames] + np.arange(frames)[:, None, None] * [0.25, 0.0, 0.0]
    parts = parts_of(still.names)
    one, other = (
        targets_of(Motion(NAMES, places, still.fps, PARENTS), parts, body).places["left_sole"]
        for places in (moved, still.positions[:frames])
    )
    np.testing.assert_allclose(one[:, 2], other[:, 2], atol=1e-9)


@pytest.mark.parametrize("seed", range(12))
def test_feet_of_one_who_never_stands_are_square_to_the_shanks(seed: int) -> None:
    """Toes recorded or not, legs straight or bent: no ankle turns as if the sole were level below the person."""
    rng = np.random.default_rng(seed)
    motion = _upturned(rng)
    kept = [k for k, name in enumerate(NAMES) if seed % 2 or "Toe" not in name]
    names = tuple(NAMES[k] for k in kept)
    lying = Motion(names, motion.positions[:, kept] * rng.uniform(0.5, 200.0), motion.fps)
    body, parts = _g1(), parts_of(names)
    found = targets_of(lying, parts, body)
    for side in ("left", "right"):
        shank = lying.joint(parts[f"{side}_knee"])[0] - lying.joint(parts[f"{side}_ankle"])[0]
        turn = (found.axes[f"{side}_sole"] @ body.axes[f"{side}_sole"].T)[0]
        np.testing.assert_allclose(turn @ turn.T, np.eye(3), atol=1e-9)
        assert turn[:, 2] @ shank / np.linalg.norm(shank) > 0.99
        ahead = np.cross(lying.joint("LeftUpLeg")[0] - lying.joint("RightUpLeg")[0], shank)
        assert turn[:, 0] @ ahead / np.linalg.norm(ahead) > 0.9


def _heel_to_the_back(rng: np.random.Generator) -> tuple[Motion, float]:
    """A runner's back swing on the spot: a shank swings back and up, its foot pointed; the fastest turn of the foot."""
    motion, side = stand(2.0, fps=120.0), str(rng.choice(["Left", "Right"]))
    times, places = np.arange(240) / 120.0, motion.positions.copy()
    share = np.clip(np.minimum(times - 0.4, 1.6 - times) / rng.uniform(0.3, 0.6), 0.0, 1.0)
    share = share * share * (3.0 - 2.0 * share)
    bend, point = rng.uniform(1.2, 2.4) * share, rng.uniform(0.0, 0.9) * share
    knee, foot, toe = (NAMES.index(side + part) for part in ("Leg", "Foot", "ToeBase"))
    shank, sole = places[:, foot] - places[:, knee], places[:, toe] - places[:, foot]
    places[:, foot] = places[:, knee] + Rotation.from_rotvec(np.outer(bend, [0.0, 1.0, 0.0])).apply(shank)
    places[:, toe] = places[:, foot] + Rotation.from_rotvec(np.outer(bend + point, [0.0, 1.0, 0.0])).apply(sole)
    way = Rotation.from_rotvec([0.0, 0.0, rng.uniform(-np.pi, np.pi)])
    whole = way.apply(places.reshape(-1, 3)).reshape(places.shape)
    return Motion(NAMES, whole, 120.0, PARENTS), float(np.abs(np.diff(bend + point)).max())


@pytest.mark.parametrize("seed", range(8))
def test_a_foot_turns_on_beyond_the_vertical(seed: int) -> None:
    """A sole in the air turns little faster than the person's foot, in any direction."""
    motion, fastest = _heel_to_the_back(np.random.default_rng(seed))
    body = _g1()
    found = targets_of(motion, parts_of(NAMES), body)
    moved = grounded(found, body, schedule_of(found, body))
    for targets in (found, moved):
        for side in ("left", "right"):
            turns = Rotation.from_matrix(targets.axes[f"{side}_sole"])
            assert (turns[1:] * turns[:-1].inv()).magnitude().max() < 1.5 * fastest + 0.01


@pytest.mark.parametrize("seed", range(4))
def test_a_foot_held_up_all_along_stays_up(seed: int) -> None:
    rng, motion = np.random.default_rng(seed), stand(0.5)
    side, high = str(rng.choice(["Left", "Right"])), rng.uniform(0.15, 0.4)
    places = motion.positions.copy()
    places[:, [NAMES.index(side + part) for part in ("Leg", "Foot", "ToeBase")]] += [0.0, 0.0, high]
    found = targets_of(Motion(NAMES, places, 30.0, PARENTS), parts_of(NAMES), _g1())
    assert not found.contacts.resting[f"{side.lower()}_foot"].any()
    assert found.places[f"{side.lower()}_sole"][0, 2] == pytest.approx(found.scale * high, abs=0.02)


@pytest.mark.long
def test_exchanged_arms_are_said_and_do_not_stop() -> None:
    found = retarget(_turned([0.0, 0.0, 1.0], np.full(60, np.pi)).part(0, 4), "g1")
    assert "exchanged" in " ".join(found.notes)
    assert np.isfinite(found.q).all()


@pytest.mark.parametrize("motion", [None, stand(0.1).positions, 3])
def test_another_thing_than_a_motion_ends_in_a_sentence(motion: Any) -> None:
    with pytest.raises(DeclarationError, match="a Motion"):
        retarget(motion, "g1")


@pytest.mark.long
def test_a_trunk_along_the_hips_and_a_place_too_far_away_end_in_a_sentence() -> None:
    with pytest.raises(DeclarationError, match="in one line"):
        retarget(_turned([1.0, 0.0, 0.0], np.full(60, 0.5 * np.pi)), "g1")
    motion = stand(0.1)
    with pytest.raises(DeclarationError, match="distance from the origin"):
        retarget(Motion(NAMES, motion.positions + [2e4, 0.0, 0.0], 30.0, PARENTS), "g1")
