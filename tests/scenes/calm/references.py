"""Disturbed references as on a real robot: at 30 Hz, with jumps, or missing for a while."""

from __future__ import annotations

import math
from collections.abc import Callable, Mapping
from dataclasses import replace

import numpy as np

from tests.scenes.calm.drawn import scene
from tests.scenes.calm.scenes import Scene, Targets

FRAMES = 30.0
"""Camera frames per second; references are held in between."""

JUMP, EVERY = 0.2, 0.5
"""Length [m] and period [s] of jumps of the target."""

OUT, OF = 0.2, 0.7
"""References are missing for OUT of every OF seconds."""


def sampled(targets: Targets, seed: int) -> Targets:
    """Sample at 30 Hz and hold."""
    return lambda t: targets(math.floor(t * FRAMES) / FRAMES)


def jumping(targets: Targets, seed: int) -> Targets:
    """Move the target within a ball every half second."""
    offsets = np.random.default_rng(seed).standard_normal((100, 3))
    offsets *= JUMP / np.linalg.norm(offsets, axis=1, keepdims=True)

    def at(t: float) -> tuple[object, ...]:
        offset = offsets[math.floor(t / EVERY) % len(offsets)]
        return tuple(replace(goal, value=goal.value + offset) for goal in targets(t))

    return at  # type: ignore[return-value]


def dropping(targets: Targets, seed: int) -> Targets:
    """Drop references in the last part of every period."""
    return lambda t: targets(t) if t % OF < OF - OUT else ()


DISTURBED: Mapping[str, Callable[[Targets, int], Targets]] = {
    "30 Hz": sampled, "jumps": jumping, "dropouts": dropping,
}  # fmt: skip


def disturbed(kind: str, seed: int, formulation: str) -> Scene:
    """The drawn loop of a seed with disturbed references."""
    drawn = scene(seed, formulation)
    return replace(drawn, name=f"{drawn.name}, {kind}", targets=DISTURBED[kind](drawn.targets, seed))


def slow(period: float, seed: int, formulation: str) -> Scene:
    """The drawn loop of a seed with another period [s]."""
    drawn = scene(seed, formulation)
    return replace(drawn, name=drawn.name.replace(f"{1e3 * drawn.dt:g} ms", f"{1e3 * period:g} ms", 1), dt=period)
