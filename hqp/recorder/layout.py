"""Where the arrays of a live hierarchy lie, so that a tick's rows are a few copies, and come back as they were."""

from __future__ import annotations

import math
from dataclasses import fields, replace
from typing import Any

import numpy as np

from hqp.problem import Hierarchy, Motion, Rows, Selection


class Memory:
    """The buffers that a hierarchy's arrays are views of, each once; ``size`` bytes in all."""

    def __init__(self, problem: Hierarchy) -> None:
        self._problem = problem.copy()  # what never changes: shapes, selections, prices
        self.parts: list[tuple[memoryview, int, int]] = []
        """Each buffer and its place in a tick's bytes."""
        self.size = 0
        self._begin: dict[int, int] = {}
        self._views = [self._view(array) for array in _arrays(problem)]

    def _view(self, array: Any) -> tuple[int, tuple[int, ...], tuple[int, ...]]:
        """Place, shape and strides of an array in a tick's bytes."""
        owner: Any = array
        while isinstance(owner.base, np.ndarray):
            owner = owner.base
        if not owner.flags.c_contiguous:
            owner = array
        key = id(owner)
        if key not in self._begin:
            self._begin[key] = self.size
            bytes_ = memoryview(owner.data).cast("B") if owner.size else memoryview(b"")
            self.parts.append((bytes_, self.size, self.size + owner.nbytes))
            self.size += owner.nbytes
        offset = array.__array_interface__["data"][0] - owner.__array_interface__["data"][0]
        return self._begin[key] + offset, array.shape, array.strides

    def problem(self, content: bytes) -> Hierarchy:
        """The hierarchy of a tick, from its bytes, in arrays of its own."""
        found = [np.ndarray(shape, np.float64, content, place, strides).copy() for place, shape, strides in self._views]
        return rebuilt(self._problem, found)


def _arrays(problem: Hierarchy) -> list[Any]:
    """All that is refilled from tick to tick, in a fixed order."""
    found: list[Any] = []
    for rows in problem.levels:
        found += [rows.lower, rows.upper] if isinstance(rows.A, Selection) else [rows.A, rows.lower, rows.upper]
    found += [a for a in (problem.metric, problem.origin) if a is not None]
    if problem.motion is not None:
        found += [problem.motion.F] if problem.motion.f is None else [problem.motion.F, problem.motion.f]
    return found


def rebuilt(pattern: Hierarchy, arrays: list[Any]) -> Hierarchy:
    """The hierarchy with other arrays, in the order of ``_arrays``; numbers are taken as they are."""
    rest = iter(arrays)
    levels = [
        _rows(rows.A, next(rest), next(rest)) if isinstance(rows.A, Selection) else _rows(*(next(rest) for _ in "Alu"))
        for rows in pattern.levels
    ]
    metric = None if pattern.metric is None else next(rest)
    origin = None if pattern.origin is None else next(rest)
    motion = pattern.motion
    if motion is not None:
        motion = Motion(next(rest), None if motion.f is None else next(rest))
    made = object.__new__(Hierarchy)
    for item in fields(Hierarchy):  # whatever stays as it is
        object.__setattr__(made, item.name, getattr(pattern, item.name))
    for name, value in (("levels", tuple(levels)), ("metric", metric), ("origin", origin), ("motion", motion)):
        object.__setattr__(made, name, value)
    object.__setattr__(made, "stacked", None)
    return made


def _rows(A: Any, lower: Any, upper: Any) -> Rows:
    """Rows without a check: what was recorded may be what went wrong."""
    made = object.__new__(Rows)
    for name, value in (("A", A), ("lower", lower), ("upper", upper)):
        object.__setattr__(made, name, value)
    return made


def pattern_of(problem: Hierarchy) -> dict[str, Any]:
    """What a file needs beside the arrays of a tick, as JSON."""
    levels = []
    for rows in problem.levels:
        if isinstance(rows.A, Selection):
            levels.append({"index": rows.A.index.tolist(), "scale": rows.A.scale.tolist()})
        else:
            levels.append({"shape": list(rows.A.shape)})
    motion = None
    if problem.motion is not None:
        motion = {"F": list(problem.motion.F.shape), "f": problem.motion.f is not None}
    return {
        "n": problem.n,
        "constraints": problem.constraints,
        "levels": levels,
        "metric": problem.metric is not None,
        "origin": problem.origin is not None,
        "prices": None if problem.prices is None else problem.prices.tolist(),
        "shares": None if problem.shares is None else problem.shares.tolist(),
        "guard": problem.guard,
        "guard_floor": problem.guard_floor,
        "pace": problem.pace,
        "motion": motion,
    }


def from_pattern(told: dict[str, Any]) -> Hierarchy:
    """The hierarchy of a pattern, its arrays zero."""
    n, levels = int(told["n"]), []
    for level in told["levels"]:
        A: Any = (
            np.zeros(level["shape"])
            if "shape" in level
            else Selection(np.array(level["index"], np.intp), np.array(level["scale"]))
        )
        m = A.index.size if isinstance(A, Selection) else A.shape[0]
        levels.append(Rows(A, np.zeros(m), np.zeros(m)))
    motion = told["motion"]
    if motion is not None:
        F = np.ones(motion["F"])
        motion = Motion(F, np.zeros(F.shape[0]) if motion["f"] else None)
    made = Hierarchy(
        tuple(levels),
        told["constraints"],
        n=n,
        prices=None if told["prices"] is None else np.array(told["prices"]),
        shares=None if told["shares"] is None else np.array(told["shares"]),
        guard=told["guard"],
        guard_floor=told["guard_floor"],
        pace=told.get("pace", math.inf),
        motion=motion,
    )
    return replace(made, metric=np.eye(n) if told["metric"] else None, origin=np.zeros(n) if told["origin"] else None)


def arrays_of(problem: Hierarchy) -> list[Any]:
    """All arrays of a hierarchy that change from tick to tick."""
    return _arrays(problem)
