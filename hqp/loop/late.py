"""A late tick: where the solver was cut, the command goes on as the answers before moved, or to what is better.

hqp/cpp/session/late.hpp has the rule.
"""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np

from hqp.arrays import Vec
from hqp.problem import Hierarchy
from hqp.programs.envelope import native
from hqp.tolerances import VIOLATION_TOLERANCE


def late(problem: Hierarchy, cut: Vec, last: Vec, ahead: Vec, joints: Sequence[int], most: float) -> Vec:
    """What is sent in place of an answer that was cut.

    last: the x before.  ahead: where it comes to if the answers go on as before.  ``ahead`` is sent, unless ``last`` is
    better, or the cut answer by more than is made up soon.  All of them are clipped into today's box, and what is
    further off than ``most`` in a joint is taken as the point on the way to it: residuals are convex.
    """
    x = np.empty(problem.n)
    read = problem if problem.readable else problem.copy()
    native.late(read, cut, last, ahead, joints, most, VIOLATION_TOLERANCE, x)
    return x
