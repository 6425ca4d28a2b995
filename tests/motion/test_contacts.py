"""Phases of rest of a person's limbs."""

from __future__ import annotations

from dataclasses import replace
from typing import Any

import numpy as np
import pytest

from hqp.motion import retarget
from hqp.motion.contacts import detect, rests, runs
from hqp.motion.joints import parts_of

from .people import stand, walk
from .robots import robot as catalogued

LEG = 0.84


def found(motion, leg: float = LEG):  # type: ignore[no-untyped-def]
    parts = parts_of(motion.names)
    places = {part: motion.joint(parts[part]) for part in parts}
    toes = {f"{side}_toe": places[f"{side}_toe"] - [0.0, 0.0, 0.03] for side in ("left", "right")}
    rest = {f"{side}_{limb}": places[f"{side}_{limb}"] for side in ("left", "right") for limb in ("hand", "knee")}
    return detect({**toes, **rest}, motion.fps, leg)


def test_feet_of_a_walk_rest_in_turn() -> None:
    contacts = found(walk(4.0, fps=120.0))
    for side in ("left", "right"):
        rests = runs(contacts.resting[f"{side}_foot"])
        assert len(rests) in (4, 5)
        assert 0.4 < contacts.resting[f"{side}_foot"].mean() < 0.65
    assert not any(contacts.resting[f"{side}_{limb}"].any() for side in ("left", "right") for limb in ("hand", "knee"))


def test_a_leg_held_up_carries_nothing_but_one_on_a_step_does() -> None:
    motion = stand(3.0, fps=60.0)
    places, names = motion.positions.copy(), motion.names
    foot = [names.index(n) for n in ("LeftFoot", "LeftToeBase")]
    lift = np.interp(np.arange(len(motion)), [30, 60, 120, 150], [0.0, 0.3, 0.3, 0.0])
    places[:, foot, 2] += lift[:, None]
    held = found(type(motion)(names, places, motion.fps))
    assert not held.resting["left_foot"][70:110].any()
    assert held.resting["right_foot"].all()
    other = [names.index(n) for n in ("RightFoot", "RightToeBase")]
    climb = np.interp(np.arange(len(motion)), [70, 100], [0.0, 0.3])  # the other foot follows up the step
    stays = np.interp(np.arange(len(motion)), [30, 60], [0.0, 0.3])
    places = motion.positions.copy()
    places[:, foot, 2] += stays[:, None]
    places[:, other, 2] += climb[:, None]
    step = found(type(motion)(names, places, motion.fps))
    assert step.resting["left_foot"][65:].all()
    np.testing.assert_allclose(step.ground["left_foot"][100], 0.3, atol=0.02)


def test_noise_of_markers_does_not_end_a_rest() -> None:
    motion = stand(2.0, fps=120.0)
    noisy = type(motion)(
        motion.names, motion.positions + np.random.default_rng(1).normal(0.0, 5e-4, motion.positions.shape), 120.0
    )
    assert found(noisy.smoothed()).resting["left_foot"].all()


@pytest.mark.parametrize("fps", [30.0, *(pytest.param(fps, marks=pytest.mark.long) for fps in (120.0, 1000.0))])
@pytest.mark.parametrize("frames", range(2, 8))
def test_motions_shorter_than_the_window_of_a_speed_are_read(frames: int, fps: float) -> None:
    way = np.linspace(0.0, 5.0 * (frames - 1) / fps, frames)[:, None] * np.array([1.0, 0.0, 0.0])
    assert rests(way, fps, 1.0).shape == (frames,)
    assert not rests(way, fps, 1.0).any()
    robot, motion = catalogued("g1"), stand(0.5)
    short = replace(motion, positions=motion.positions[:frames], fps=fps)
    if frames == 2:
        assert len(retarget(short, robot).q) == len(retarget(short, robot, dynamics=True).q) == frames


def test_a_hand_on_the_floor_rests() -> None:
    motion = stand(1.0, fps=60.0)
    places = motion.positions.copy()
    places[:, motion.names.index("LeftHand"), 2] = 0.06
    contacts = found(type(motion)(motion.names, places, motion.fps))
    assert contacts.resting["left_hand"].all()
    assert not contacts.resting["right_hand"].any()


@pytest.mark.parametrize("seed", range(12))
def test_a_foot_that_shifts_on_a_step_still_stands_there(seed: int) -> None:
    """The other foot is down on the floor by then; a foot held still above the step or far from it carries nothing."""
    rng = np.random.default_rng(seed)
    rise, shift, way = rng.uniform(0.15, 0.45), rng.uniform(0.06, 0.12), rng.uniform(0.0, 2.0 * np.pi)
    motion = stand(6.0, fps=60.0)
    times = np.arange(len(motion)) / 60.0
    left, right = ([motion.names.index(f"{side}{part}") for part in ("Foot", "ToeBase")] for side in ("Left", "Right"))
    up, down = np.interp(times, [0.5, 1.0], [0.0, 1.0]), np.interp(times, [3.0, 3.5], [0.0, 1.0])
    places = motion.positions.copy()
    places[:, right, 2] += rise * up[:, None]
    places[:, left, 2] += rise * (np.interp(times, [1.2, 1.7], [0.0, 1.0]) - down)[:, None]
    moved = np.interp(times, [4.0, 4.2], [0.0, 1.0])[:, None, None]

    def stands(by: Any) -> Any:
        shifted = places.copy()
        shifted[:, right] += moved * np.array(by)
        return found(type(motion)(motion.names, shifted, motion.fps)).resting["right_foot"]

    on, late = [shift * np.cos(way), shift * np.sin(way), 0.0], times > 4.4
    assert stands(on)[late].all()
    assert not stands([*on[:2], 0.15])[late].any()
    assert not stands([0.7 * np.cos(way), 0.7 * np.sin(way), 0.0])[late].any()
