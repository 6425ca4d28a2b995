"""A late tick: where the solver was cut, the command goes on as the answers before moved, or to what is better.

A point is better than another one where, in the first level whose ||w_k|| differ by more than what the level gives to
those below, ||w_k|| is smaller and so is what the level minimises, ||w_k|| + c_k E(x) with its price c_k on motion: an
answer that was cut before its prices were looked at often leaves less unmet, at a motion that no later tick wants.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from hqp.arrays import Index, Vec
from hqp.loop.outgoing import towards
from hqp.problem import Hierarchy
from hqp.tolerances import VIOLATION_TOLERANCE

MARGIN, WORTH = 2.0, 0.02
"""A cut answer has to be better by this many changes like the last ones, and by this share of what is unmet: less is
made up by the next tick that is solved."""

LONGEST = 25
"""After so many late ticks the answers before tell little of what comes: the command stays."""


class Trend:
    """How the answers of a session move, from the last two that were solved."""

    __slots__ = ("_rate", "_tick", "_x")

    def __init__(self) -> None:
        self.forget()

    def forget(self) -> None:
        """What was solved before tells nothing of what comes."""
        self._x: Vec | None = None
        self._rate: Vec | None = None
        self._tick = 0

    def take(self, x: Vec, tick: int) -> None:
        """A solved answer, which stays as it is, and the number of its tick."""
        if self._x is not None and tick > self._tick:
            self._rate = (x - self._x) / (tick - self._tick)
        self._x, self._tick = x, tick

    def after(self, last: Vec, tick: int) -> Vec:
        """Where the last x comes to in this tick; the last x itself where no two answers are known."""
        return last if self._rate is None or tick > self._tick + LONGEST else last + self._rate


@dataclass(frozen=True, slots=True)
class Judged:
    """A point and its slacks; of every level ||w_k||, ||w_k|| + c_k E(x), and what levels below may change."""

    x: Vec
    slacks: tuple[Vec, ...]
    sizes: Vec
    costs: Vec
    bands: Vec

    @staticmethod
    def of(problem: Hierarchy, x: Vec) -> Judged:
        """The point x of a problem."""
        slacks = problem.slacks(x)
        sizes = costs = np.array([float(np.sqrt(w @ w)) for w in slacks])
        bands = VIOLATION_TOLERANCE * (1.0 + sizes)
        if problem.prices is not None:
            motion = 0.5 * float(x @ x) if problem.motion is None else problem.motion(x)
            costs = sizes + problem.prices * motion
            bands += np.where(problem.prices > 0.0, problem.eta, 0.0) * sizes
        return Judged(x, slacks, sizes, costs, bands)

    def apart(self, other: Judged) -> Vec:
        """By how much the slacks of each level differ, ``(levels,)``."""
        return np.array([float(np.linalg.norm(a - b)) for a, b in zip(self.slacks, other.slacks, strict=True)])

    def better_than(self, other: Judged, by: Vec | None = None) -> bool:
        """Whether the first level that differs tells for this point, and by more than ``by`` ``(levels,)``."""
        gains, bands = other.sizes - self.sizes, np.minimum(self.bands, other.bands)
        for k in np.flatnonzero(np.abs(gains) > bands).tolist():
            least = float(bands[k]) + (0.0 if by is None else float(by[k]))
            return bool(gains[k] > least and other.costs[k] - self.costs[k] > bands[k])
        return False


def late(problem: Hierarchy, cut: Vec, last: Vec, ahead: Vec, joints: Index | slice, most: float) -> Vec:
    """What is sent in place of an answer that was cut.

    last: the x before.  ahead: where it comes to if the answers go on as before.  ``ahead`` is sent, unless ``last`` is
    better, or the cut answer by more than is made up soon.  All of them are clipped into today's box, and what is
    further off than ``most`` in a joint is taken as the point on the way to it: residuals are convex.
    """
    here = Judged.of(problem, problem.boxed(last))
    on = Judged.of(problem, problem.boxed(towards(ahead, here.x, joints, most)))
    found = Judged.of(problem, towards(problem.boxed(cut), here.x, joints, most))
    best = here if here.better_than(on) else on
    return found.x if found.better_than(best, MARGIN * on.apart(here) + WORTH * here.sizes) else best.x
