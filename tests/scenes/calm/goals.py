"""Goals of a calm controller, by formulation."""

from __future__ import annotations

from collections.abc import Iterator, Mapping
from dataclasses import dataclass

Figures = Mapping[str, float | str]


@dataclass(frozen=True)
class Goal:
    """Largest allowed value of a figure; share: alternative, as a share of the joint's limit, if larger."""

    figure: str
    most: float
    share: float = 0.0


GOALS: Mapping[str, tuple[Goal, ...]] = {
    "velocity": (
        Goal("jump", 0.2), Goal("reversals", 5.0), Goal("acceleration_p50", 3.0), Goal("acceleration_p99", 30.0),
        Goal("above", 1e-9),
    ),
    "acceleration": (
        Goal("jump", 20.0), Goal("reversals", 5.0), Goal("acceleration_p50", 5.0), Goal("acceleration_p99", 50.0),
        Goal("above", 1e-9),
    ),
    "torque": (
        Goal("jump", 5.0, share=0.1), Goal("reversals", 5.0), Goal("acceleration_p50", 5.0),
        Goal("acceleration_p99", 50.0), Goal("above", 1e-8),
    ),
}  # fmt: skip
"""Largest change of a command in a tick, reversals a second, joint accelerations, levels above the hand."""

PROMISES = frozenset({"above", "error", "com", "over", "load"})
"""Promised figures, whose miss is a failure: levels above, tracking within reach, balance, limits and loads."""

LOSS, OFFSET = 1.01, 1e-4
"""Within reach the error may be this factor times the exact one, or exceed it by this offset [m]."""

WALKING = (Goal("com", 1e-3), Goal("over", 1e-9), Goal("tick_max", 2000.0))
"""Goals of the walking hand: CoM [m], position limits [rad], worst tick [us]; loads must be positive as well."""


def misses(formulation: str, figures: Figures) -> Iterator[str]:
    """Names of the figures that miss their goal."""
    for goal in GOALS[formulation]:
        most = float(figures[goal.figure])
        if most > goal.most and not (goal.share and float(figures[f"{goal.figure}_share"]) <= goal.share):
            yield goal.figure


def walking_misses(figures: Figures) -> Iterator[str]:
    """Names of the figures of a walking hand that miss their goal."""
    for goal in WALKING:
        if float(figures[goal.figure]) > goal.most:
            yield goal.figure
    if float(figures["load"]) < 0.0:
        yield "load"


def loses(priced: Figures, exact: Figures) -> bool:
    """Return true if the exact problem tracks a scene within reach better."""
    return float(priced["error"]) > max(LOSS * float(exact["error"]), float(exact["error"]) + OFFSET)
