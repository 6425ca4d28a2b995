"""A late tick: where the solver was cut, the command goes on as the answers before moved, or to what is better.

hqp/cpp/session/late.hpp has the rule.
"""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np

from hqp.arrays import Vec
from hqp.problem import Hierarchy, Rows, Selection
from hqp.programs.envelope import native
from hqp.tolerances import VIOLATION_TOLERANCE


def late(problem: Hierarchy, cut: Vec, last: Vec, ahead: Vec, joints: Sequence[int], most: float) -> Vec:
    """What is sent in place of an answer that was cut.

    last: the x before.  ahead: where it comes to if the answers go on as before.  ``ahead`` is sent, unless ``last`` is
    better, or the cut answer by more than is made up soon.  All of them are clipped into today's box, and what is
    further off than ``most`` in a joint is taken as the point on the way to it: residuals are convex.
    """
    motion, x = problem.motion, np.empty(problem.n)
    F, f = (None, None) if motion is None else (motion.F, motion.f)
    levels = [_level(rows) for rows in problem.levels]
    rule = native.Late(problem.n, levels, problem.constraints, problem.prices, F, f, problem.eta, VIOLATION_TOLERANCE)
    rule.choose(cut, last, ahead, joints, most, x)
    return x


def _level(rows: Rows) -> tuple[object, ...]:
    if isinstance(rows.A, Selection):
        return None, rows.A.index, rows.A.scale, rows.lower, rows.upper
    return rows.A, None, None, rows.lower, rows.upper
