"""A log of a run: named numbers tick by tick, in memory and as npz."""

from __future__ import annotations

import json
import math
from collections.abc import Mapping
from pathlib import Path
from typing import Any

import numpy as np

from hqp.arrays import Vec
from hqp.session import Tick


class Recorder:
    """Rows of numbers under names; every call of ``add`` is one tick, and every tick has the same names."""

    def __init__(self) -> None:
        self._columns: dict[str, list[Vec]] = {}
        self._arrays: dict[str, np.ndarray[Any, np.dtype[np.float64]]] = {}
        self.length = 0

    def add(self, **values: Any) -> None:
        """Append a tick; what is given is copied."""
        for name, value in values.items():
            self._columns.setdefault(name, []).append(np.array(value, dtype=np.float64))
        self.length += 1

    def add_to_last(self, **values: Any) -> None:
        """More of the tick that was added last."""
        for name, value in values.items():
            self._columns.setdefault(name, []).append(np.array(value, dtype=np.float64))

    def last(self, name: str) -> Vec:
        """The latest value of a name."""
        return self._columns[name][-1]

    def __getitem__(self, name: str) -> np.ndarray[Any, np.dtype[np.float64]]:
        """All ticks of a name, ``(ticks, ...)``."""
        column = self._columns[name]
        kept = self._arrays.get(name)
        if kept is None or len(kept) != len(column):
            kept = self._arrays[name] = np.array(column)
        return kept

    def __contains__(self, name: str) -> bool:
        return name in self._columns

    def save(self, path: Path, parameters: Mapping[str, Any]) -> Path:
        """Write a compressed npz with an array a name, and the parameters as JSON under ``parameters``."""
        path.parent.mkdir(parents=True, exist_ok=True)
        text = json.dumps(dict(parameters), default=str)
        np.savez_compressed(path, parameters=np.array(text), **{name: self[name] for name in self._columns})  # type: ignore[arg-type]
        return path


LEVELS = 8
"""Room for the levels of a hierarchy."""


def level_residuals(tick: Tick) -> Vec:
    """Norm of what each level of a tick's hierarchy falls short by ``(LEVELS,)``, NaN beyond the last one."""
    norms = np.full(LEVELS, np.nan)
    if tick.solution is not None:
        for k, w in enumerate(tick.solution.residuals[:LEVELS]):
            norms[k] = math.sqrt(w @ w)
    return norms
