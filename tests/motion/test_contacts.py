"""Phases of rest of a person's limbs."""

from __future__ import annotations

import numpy as np

from hqp.motion.contacts import detect, runs
from hqp.motion.joints import parts_of

from .people import stand, walk

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


def test_a_hand_on_the_floor_rests() -> None:
    motion = stand(1.0, fps=60.0)
    places = motion.positions.copy()
    places[:, motion.names.index("LeftHand"), 2] = 0.06
    contacts = found(type(motion)(motion.names, places, motion.fps))
    assert contacts.resting["left_hand"].all()
    assert not contacts.resting["right_hand"].any()
