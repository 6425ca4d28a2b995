"""The passes from which a motion is solved: a corner that traps the forward pass may not trap the backward one."""

from __future__ import annotations

from typing import NamedTuple

import numpy as np

from hqp.arrays import Mat, Vec

from .branches import start
from .contacts import runs
from .smoothing import Course
from .tracker import Pass, Tracker
from .weaving import woven

SHORT = 0.1
"""Duration of a lag above which the motion needs another pass [s]."""


class Judged(NamedTuple):
    """A pass and its errors ``(T, 7)``."""

    motion: Pass
    errors: Mat


def solved(tracker: Tracker) -> Pass:
    """The whole motion, by the pass that leaves feet, hands, soles and trunk least behind, by their levels.

    The first frame is the first anchor; if a part lags for a while, the last frame is the next.  While feet or hands
    lag, more passes follow: one led by the motion without self-collision, one led by the best parts of all passes, and
    one from the worst frame of the best, then again one led by all.
    """
    found = _ends(tracker)
    for another in (_led_by_free, _led_by_all, _from_the_worst, _led_by_all):
        if not any(lost(tracker, best(tracker, found).errors)[: tracker.stacks.reaching]):
            break
        if tracker.stacks.collision or another is not _led_by_free:
            found.append(another(tracker, found))
    return best(tracker, found).motion


def best(tracker: Tracker, found: list[Judged]) -> Judged:
    """The pass that loses least in the first level in which they differ."""
    return min(found, key=lambda each: lost(tracker, each.errors))


def lost(tracker: Tracker, errors: Mat) -> tuple[float, ...]:
    """Sums of the errors ``(T, 7)`` beyond 1 in lags of ``SHORT`` at least, by level, first the most important."""
    sums = iter([_lag(errors[:, k], max(1, round(SHORT / tracker.dt))) for k in range(errors.shape[1])])
    return tuple(sum(next(sums) for _ in level) for level in tracker.stacks.judged)


def _lag(errors: Vec, frames: int) -> float:
    """Sum of a part's errors ``(T,)`` beyond 1 where they are beyond it for some frames at least."""
    return sum(float((errors[a:b] - 1.0).sum()) for a, b in runs(errors > 1.0) if b - a >= frames)


def _ends(tracker: Tracker) -> list[Judged]:
    """The pass from the first frame, and if it lags the one from the last."""
    first = _from(tracker, 0, None)
    lags = any(lost(tracker, first.errors))
    return [first, _from(tracker, len(tracker.targets) - 1, first.motion)] if lags else [first]


def _from(tracker: Tracker, anchor: int, hint: Pass | None) -> Judged:
    """The pass from an anchor both ways."""
    q = start(tracker, anchor, *([] if hint is None else [hint.q[anchor]]))
    rest, last = np.zeros(tracker.robot.nv), len(tracker.targets) - 1
    found = tracker.run(q, rest, anchor, last)
    if anchor:
        found = tracker.run(q, rest, anchor, 0).reversed().then(found)
    return Judged(found, tracker.errors(found.q))


def _from_the_worst(tracker: Tracker, found: list[Judged]) -> Judged:
    """The pass from the worst frame of the best one."""
    motion, errors = best(tracker, found)
    return _from(tracker, int(errors.max(axis=1).argmax()), motion)


def _led_by_free(tracker: Tracker, _: list[Judged]) -> Judged:
    """The pass led by the motion without self-collision: trunk and limbs that follow the person may bar each other's
    way."""
    free = tracker.without_collision()
    return _led(tracker, Course(tracker, best(free, _ends(free)).motion.q))


def _led_by_all(tracker: Tracker, found: list[Judged]) -> Judged:
    """The pass led by the parts of all passes that are least behind."""
    losses = [np.maximum(each.errors - 1.0, 0.0).sum(axis=1) for each in found]
    return _led(tracker, Course(tracker, woven(tracker, [each.motion for each in found], losses), own=True))


def _led(tracker: Tracker, course: Course) -> Judged:
    """The pass whose pelvis and joints stay near a course below hands and feet."""
    q = tracker.settle(course.first, 0, course)
    found = tracker.run(q, np.zeros(tracker.robot.nv), 0, len(tracker.targets) - 1, course)
    return Judged(found, tracker.errors(found.q))
