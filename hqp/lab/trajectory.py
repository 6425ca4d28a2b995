"""Targets over time: a named motion, a function of time, or a file of samples."""

from __future__ import annotations

import csv
import importlib
import math
import sys
from collections.abc import Callable, Mapping
from functools import partial
from pathlib import Path
from typing import Any, TypeAlias

import numpy as np

from hqp.arrays import Vec
from hqp.declare.reference import Reference
from hqp.declare.stack import Stack
from hqp.errors import DeclarationError, closest

Motion: TypeAlias = "Callable[[float], Mapping[str, Any]]"
"""Targets at a time [s]: by element a value, or (value, velocity)."""

NAMED = {
    "hold": "every target stays where it is at home",
    "circle": "positions go round a circle of 5 cm radius, once in 2 s",
    "step": "positions jump 10 cm after 0.2 s",
    "unreachable": "positions move 1.5 m ahead within 1 s",
    "nan": "a circle whose targets are NaN for 0.1 s in the middle",
}


class Trajectory:
    """References over time for the positions, poses and centres of mass of a stack.

    source: a name of ``NAMED``, a function of time, a CSV or Parquet file, or ``module:function``.  A file has a column
    ``t`` [s] and columns ``element.0``, ``element.1``, ... for each value, interpolated linearly and held at the end.
    Raises DeclarationError for an unknown source, element or column.
    """

    def __init__(self, source: str | Path | Motion, stack: Stack, robot: Any, seconds: float) -> None:
        self.name = str(source) if isinstance(source, (str, Path)) else getattr(source, "__qualname__", "function")
        self._motion = _motion(source, stack, robot, seconds)
        self._at: dict[str, Any] = {}
        for name in self._motion(0.0):
            element: Any = stack.find(name)
            self._at[name] = getattr(element, "at", None) or partial(Reference, name)

    def __call__(self, t: float) -> tuple[Reference, ...]:
        """References at time t [s]."""
        return self.references(self.values(t))

    def values(self, t: float) -> Mapping[str, Any]:
        """Targets at time t [s]: by element a value, or (value, velocity)."""
        return self._motion(t)

    def references(self, values: Mapping[str, Any]) -> tuple[Reference, ...]:
        """References of targets, as a user's loop makes them with ``element.at``."""
        return tuple(
            self._at[name](value[0], velocity=value[1]) if isinstance(value, tuple) else self._at[name](value)
            for name, value in values.items()
        )


def _motion(source: str | Path | Motion, stack: Stack, robot: Any, seconds: float) -> Motion:
    if callable(source):
        return source
    text = str(source)
    if text in NAMED:
        return _named(text, stack, robot, seconds)
    if Path(text).suffix in (".csv", ".parquet"):
        return _samples(Path(text))
    module, colon, function = text.partition(":")
    if colon:
        sys.path.insert(0, "")  # a module beside the stack's file
        try:
            found: Motion = getattr(importlib.import_module(module), function)
        except (ImportError, AttributeError) as error:
            raise DeclarationError("trajectory", f"cannot be imported: {error}", value=text) from error
        finally:
            sys.path.remove("")
        return found
    near = ", ".join(closest(text, NAMED) or NAMED)
    allowed = f"{near}, FILE.csv, FILE.parquet or module:function"
    raise DeclarationError("trajectory", "unknown", value=text, allowed=allowed)


def _named(name: str, stack: Stack, robot: Any, seconds: float) -> Motion:
    from hqp.tasks import Pose, Position

    state = robot.state()
    homes: dict[str, Vec] = {
        e.name: e.value(state) for e in stack if isinstance(e, (Position, Pose)) and e not in stack.subject_to
    }
    robot.current = None

    def circle(t: float) -> dict[str, Any]:
        angle, radius = math.pi * t, 0.05
        offset = radius * np.array([0.0, math.sin(angle), 1.0 - math.cos(angle)])
        rate = radius * math.pi * np.array([0.0, math.cos(angle), math.sin(angle)])
        return {n: _moved(p, offset, rate) for n, p in homes.items()}

    def moved(distance: float) -> dict[str, Any]:
        ahead = np.array([1.0, 0.0, 0.2])
        return {n: _moved(p, distance * ahead) for n, p in homes.items()}

    def lost(t: float) -> dict[str, Any]:
        if abs(t - 0.5 * seconds) < 0.05:
            return {n: np.full(p.shape, np.nan) for n, p in homes.items()}
        return circle(t)

    motions: dict[str, Motion] = {
        "hold": lambda t: moved(0.0),
        "circle": circle,
        "step": lambda t: moved(0.1 if t > 0.2 else 0.0),
        "unreachable": lambda t: moved(1.5 * min(t, 1.0)),
        "nan": lost,
    }
    return motions[name]


def _moved(value: Vec, offset: Vec, rate: Vec | None = None) -> Any:
    """A position or a pose shifted by an offset, a position with its rate too."""
    if value.ndim == 1:
        moved = value + offset[: value.size]
        return moved if rate is None else (moved, rate[: value.size])
    pose = value.copy()
    pose[:3, 3] += offset
    return pose


def _samples(path: Path) -> Motion:
    columns = _read(path)
    times = columns.pop("t", None)
    if times is None or not columns:
        raise DeclarationError("trajectory", "needs a column t and columns element.0, ...", value=str(path))
    groups: dict[str, list[tuple[int, Vec]]] = {}
    for column, values in columns.items():
        element, dot, index = column.rpartition(".")
        if not dot or not index.isdigit():
            raise DeclarationError("trajectory", "bad column", value=column, allowed="element.0, element.1, ...")
        groups.setdefault(element, []).append((int(index), values))
    ordered = {
        name: [values for _, values in sorted(parts, key=lambda part: part[0])] for name, parts in groups.items()
    }

    def at(t: float) -> dict[str, Any]:
        return {name: np.array([np.interp(t, times, values) for values in parts]) for name, parts in ordered.items()}

    return at


def _read(path: Path) -> dict[str, Vec]:
    try:
        if path.suffix == ".parquet":
            import pyarrow.parquet

            table = pyarrow.parquet.read_table(path)
            return {name: table[name].to_numpy().astype(np.float64) for name in table.column_names}
        with path.open(newline="") as file:
            header, *lines = list(csv.reader(file))
        numbers = np.array(lines, dtype=np.float64)
    except (OSError, ValueError) as error:
        raise DeclarationError("trajectory", f"cannot be read: {error}", value=str(path)) from error
    return {name: numbers[:, i] for i, name in enumerate(header)}
