"""A log of a run: named numbers tick by tick, in memory and as npz."""

from __future__ import annotations

import json
import math
from collections.abc import Mapping
from pathlib import Path
from typing import Any

import numpy as np

from hqp.arrays import Vec
from hqp.loop.session import Tick


class Recorder:
    """Rows of numbers under names; every call of ``add`` is one tick, and every tick has the same names and shapes."""

    FIRST = 1024
    """Capacity in ticks at first; doubled when it is full."""

    def __init__(self) -> None:
        self._columns: dict[str, list[Vec]] = {}
        self._slots: dict[str, tuple[slice, tuple[int, ...]]] = {}
        self._table: np.ndarray[Any, np.dtype[np.float64]] = np.empty((0, 0))
        self.length = 0

    def add(self, **values: Any) -> None:
        """Append a tick with copies of the values.  Raises ValueError for other names or shapes than at first."""
        if not self._slots:
            self._begin(values)
        elif values.keys() != self._slots.keys():
            raise ValueError(f"a tick has {', '.join(self._slots)}, given {', '.join(values)}")
        if self.length == len(self._table):
            self._table = np.concatenate((self._table, np.empty_like(self._table)))
        row = self._table[self.length]
        for (slot, shape), value in zip(self._slots.values(), values.values(), strict=True):
            row[slot] = value if len(shape) < 2 else np.ravel(value)
        self.length += 1

    def _begin(self, values: Mapping[str, Any]) -> None:
        """Give every name its place in a row."""
        at = 0
        for name, value in values.items():
            shape = np.shape(value)
            size = math.prod(shape)
            self._slots[name] = slice(at, at + size), shape
            at += size
        self._table = np.empty((self.FIRST, at))

    def add_to_last(self, **values: Any) -> None:
        """Add values to the latest tick."""
        for name, value in values.items():
            self._columns.setdefault(name, []).append(np.array(value, dtype=np.float64))

    def last(self, name: str) -> Vec:
        """The latest value of a name."""
        return self[name][-1]  # type: ignore[no-any-return]

    def __getitem__(self, name: str) -> np.ndarray[Any, np.dtype[np.float64]]:
        """All ticks of a name, ``(ticks, ...)``."""
        if name in self._columns:
            return np.array(self._columns[name])
        slot, shape = self._slots[name]
        return self._table[: self.length, slot].reshape(-1, *shape)

    def __contains__(self, name: str) -> bool:
        return name in self._columns or name in self._slots

    def save(self, path: Path, parameters: Mapping[str, Any]) -> Path:
        """Write a compressed npz with an array a name, and the parameters as JSON under ``parameters``."""
        path.parent.mkdir(parents=True, exist_ok=True)
        text = json.dumps(dict(parameters), default=str)
        np.savez_compressed(
            path, parameters=np.array(text), **{name: self[name] for name in (*self._slots, *self._columns)}
        )  # type: ignore[arg-type]
        return path


LEVELS = 8
"""Room for the levels of a hierarchy."""


def level_residuals(tick: Tick) -> Vec:
    """Residual norm of each level of a tick's hierarchy ``(LEVELS,)``, NaN beyond the last one."""
    norms = np.full(LEVELS, np.nan)
    if tick.solution is not None:
        for k, w in enumerate(tick.solution.residuals[:LEVELS]):
            norms[k] = math.sqrt(w @ w)
    return norms
