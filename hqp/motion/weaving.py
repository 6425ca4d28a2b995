"""One motion from several passes over the same frames: each part of it from a pass that is on target there."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np

from hqp.arrays import Mat, Vec

from .tracker import Pass, Tracker


def woven(tracker: Tracker, passes: Sequence[Pass], losses: Sequence[Vec]) -> Mat:
    """Configurations ``(T, nq)`` of the way through the passes that loses least.

    losses: errors of each pass by frame ``(T,)``.  A change of pass adds the number of frames that the slowest joint
    takes at its speed limit.
    """
    robot, lost = tracker.robot, np.array(losses)
    taken = np.array([[robot.state(q).angles for q in each.q] for each in passes])[:, :, robot.actuated]
    taken /= robot.velocity_limit[robot.actuated] * tracker.dt
    total, before = lost[:, 0], np.zeros(lost.T.shape, dtype=int)
    for i in range(1, lost.shape[1]):
        sums = total[:, None] + np.abs(taken[:, None, i] - taken[None, :, i]).max(axis=2)
        before[i], total = sums.argmin(axis=0), sums.min(axis=0) + lost[:, i]
    way = [int(total.argmin())]
    for earlier in before[:0:-1]:
        way.append(int(earlier[way[-1]]))
    return np.array([passes[k].q[i] for i, k in enumerate(reversed(way))])
