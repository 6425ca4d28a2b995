"""The last seconds of a loop as numbers: residual of every level, change of the command, time of a tick."""

from __future__ import annotations

from collections import deque
from dataclasses import dataclass, field
from itertools import pairwise

import numpy as np

from hqp.arrays import Index, Mat, Vec

from .channel import HEAD
from .description import StackDescription

SECONDS = 10.0
"""Time span of the page's curves [s]."""

BINS = 140


@dataclass
class History:
    """Ticks as they come from the channel; curves are the largest value of each of ``BINS`` stretches of time.

    A tick of an earlier stack, which has other levels, is dropped with everything before it.
    """

    stack: StackDescription
    latest: Vec | None = None
    _chunks: deque[tuple[Vec, Mat, Vec, Vec]] = field(default_factory=deque)
    _last: Vec | None = None
    _last_sequence: float = -1.0

    def restart(self, stack: StackDescription) -> None:
        """Begin anew with another stack."""
        self.stack, self._last = stack, None
        self._chunks.clear()

    def add(self, slots: Mat) -> None:
        """Take new ticks ``(k, width)`` from the channel."""
        slots = slots[slots[:, 2] == self.stack.version]
        if not len(slots):
            return
        bounds = np.cumsum((0, *self.stack.sizes)) + HEAD
        residuals = [slots[:, i:j] for i, j in pairwise(bounds[4:])]
        norms = np.stack([np.sqrt(np.square(w).sum(axis=1)) for w in residuals], axis=1)
        commands = slots[:, bounds[2] : bounds[3]]
        follows = self._last is not None and slots[0, 0] == self._last_sequence + 1
        before = self._last[None] if follows and self._last is not None else commands[:1]
        change = np.abs(np.diff(np.vstack((before, commands)), axis=0)).max(axis=1, initial=0.0)
        self._chunks.append((slots[:, 1].copy(), norms, change, 1e6 * slots[:, 4:HEAD].sum(axis=1)))
        self._last, self._last_sequence = commands[-1].copy(), slots[-1, 0]
        self.latest = slots[-1].copy()
        while self._chunks and self._chunks[0][0][-1] < slots[-1, 1] - SECONDS:
            self._chunks.popleft()

    def part(self, index: int) -> Vec:
        """A vector of the latest tick: 0 q, 1 v, 2 command, 3 x, 4 and on the levels' residuals."""
        assert self.latest is not None
        start = HEAD + sum(self.stack.sizes[:index])
        return self.latest[start : start + self.stack.sizes[index]]

    @property
    def status(self) -> int:
        """Position of the latest tick's status among all of them."""
        return -1 if self.latest is None else int(self.latest[3])

    def curves(self) -> Curves:
        """Everything the page draws over time."""
        if not self._chunks:
            nothing = np.zeros(0)
            return Curves(np.zeros((len(self.stack.levels), 0)), nothing, nothing, nothing)
        clock, norms, change, times = (np.concatenate(part) for part in zip(*self._chunks, strict=True))
        place = np.clip((BINS * (clock - clock[-1] + SECONDS) / SECONDS).astype(np.intp), 0, BINS - 1)
        binned = [_largest(place, norms[:, k]) for k in range(norms.shape[1])]
        return Curves(np.array(binned), _largest(place, change), _largest(place, times), times)


@dataclass(frozen=True)
class Curves:
    """Largest value in each stretch of time, NaN where there was no tick; times of every tick [us]."""

    norms: Mat
    change: Vec
    times: Vec
    all_times: Vec


def _largest(place: Index, values: Vec) -> Vec:
    curve = np.full(BINS, -np.inf)
    np.maximum.at(curve, place, np.nan_to_num(values, nan=0.0))
    curve[np.isneginf(curve)] = np.nan
    return curve
