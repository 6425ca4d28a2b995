"""Ticks of closed loops as problems with the answers of the loop's solver."""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass

import numpy as np

from hqp import Hierarchy, Solution
from hqp.errors import StaleState
from tests.scenes.calm.scenes import FORMULATIONS, scenes
from tests.scenes.calm.variants import PRICED

ROBOTS = ("ur5", "panda", "g1", "talos")
PLACES = ("within", "edge", "beyond", "circle edge", "circle beyond", "wall", "contradictory")


@dataclass(frozen=True, eq=False)
class Answered:
    """One tick: a copy of its problem, its solution, and its origin."""

    name: str
    problem: Hierarchy
    solution: Solution


def drawn(
    rng: np.random.Generator, robot: str, formulation: str, place: str, count: int, ticks: int
) -> Iterator[Answered]:
    """Random solved ticks among the first ``ticks`` of a scene, at most ``count``."""
    scene = scenes(robot, formulation, {})[place]()
    model = scene.subject.robot
    session = PRICED.of(scene.stack, FORMULATIONS[formulation]).session(model, scene.dt)
    chosen = set(rng.choice(ticks, size=count, replace=False).tolist())
    q, v = model.home.copy(), np.zeros(model.nv)
    for i in range(max(chosen) + 1):
        tick = session.step(model.state(q, v), *scene.targets(i * scene.dt))
        if i in chosen and tick.solution is not None and tick.status.solved:
            yield Answered(f"{robot} {formulation} {place} {i}", session.problem.copy(), tick.solution)
        try:
            q, v = tick.advance()
        except StaleState:
            return
