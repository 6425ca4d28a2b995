"""Places of the arrays of a live hierarchy: a tick's rows are saved and restored by a few copies."""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from dataclasses import fields, replace
from typing import Any, TypeVar

import numpy as np

from hqp.arrays import Index, Mat, Vec
from hqp.problem import ETA, Hierarchy, Motion, Rows, Selection

T = TypeVar("T")

LINE = 64
"""Parts of a tick begin at multiples of so many bytes."""


class Memory:
    """The buffers that a hierarchy's arrays are views of, each once, but for rows that are multiples of others.

    Only one triangle of symmetric blocks is kept.  copies, symmetric: see ``Program.copies`` and ``Program.symmetric``.
    ``size`` bytes a tick; ``parts``: arrays to copy, and their place there.
    """

    def __init__(
        self,
        problem: Hierarchy,
        copies: Sequence[tuple[Mat, Mat, Index, Vec]] = (),
        symmetric: Sequence[tuple[Mat, Index]] = (),
    ) -> None:
        self._problem = problem.copy()  # constant parts: shapes, selections, prices
        self.parts: list[tuple[memoryview, int, int]] = []
        self.size = 0
        self._owners: list[tuple[Any, int]] = []
        self._begin: dict[int, int] = {}
        self._whole = 0
        self._views = [self._view(array) for array in _arrays(problem)]
        kept = [(target, *rest) for target, *rest in copies if target.size and target.flags.c_contiguous]
        self._copies = [(self._view(A), self._view(source), rows, factors) for A, source, rows, factors in kept]
        begins = [view[0] for view, *_ in self._copies]
        self._symmetric = [(self._view(array), rows) for array, rows in symmetric if array.flags.c_contiguous]
        gaps = [(start, start + item[0].nbytes) for start, item in zip(begins, kept, strict=True)]
        for (place, shape, strides), rows in self._symmetric:  # the lower triangle; the rest are whole lines
            for k, i in enumerate(rows.tolist()):
                left = -(-(shape[1] - k) * strides[1] // LINE) * LINE
                gaps.append((place + i * strides[0], place + max(i * strides[0], (i + 1) * strides[0] - left)))
        gaps.sort()
        self._places: list[int] = []
        for owner, begin in self._owners:
            content = memoryview(owner.data).cast("B")
            for start, stop in _between(begin, begin + owner.nbytes, gaps):
                self.parts.append((content[start - begin : stop - begin], self.size, self.size + stop - start))
                self._places.append(start)
                self.size += -(-(stop - start) // LINE) * LINE

    def _view(self, array: Any) -> tuple[int, tuple[int, ...], tuple[int, ...]]:
        """Place, shape and strides of an array in all the buffers, one after the other."""
        owner: Any = array
        while isinstance(owner.base, np.ndarray):
            owner = owner.base
        if not owner.flags.c_contiguous:
            owner = array
        key = id(owner)
        if key not in self._begin:
            self._begin[key] = self._whole
            if owner.size:
                self._owners.append((owner, self._whole))
            self._whole += owner.nbytes
        offset = array.__array_interface__["data"][0] - owner.__array_interface__["data"][0]
        return self._begin[key] + offset, array.shape, array.strides

    def problem(self, content: bytes) -> Hierarchy:
        """The hierarchy of a tick, from its bytes, in arrays of its own."""
        whole = bytearray(self._whole)
        for (_, begin, end), place in zip(self.parts, self._places, strict=True):
            whole[place : place + end - begin] = content[begin:end]

        def array(view: tuple[int, tuple[int, ...], tuple[int, ...]]) -> Any:
            place, shape, strides = view
            return np.ndarray(shape, np.float64, whole, place, strides)

        for block, index in self._symmetric:
            A, below = array(block), np.tril_indices(index.size, -1)
            A[index[below[0]], below[1]] = A[index[below[1]], below[0]]
        for target, source, rows, factors in self._copies:
            A = array(target)
            np.multiply(array(source)[rows, : A.shape[1]], factors[:, None], out=A)
        return rebuilt(self._problem, [array(view).copy() for view in self._views])


def _between(begin: int, end: int, gaps: list[tuple[int, int]]) -> Iterator[tuple[int, int]]:
    """Parts of an interval outside the gaps, which are sorted."""
    for start, stop in gaps:
        if begin <= start < end:
            if start > begin:
                yield begin, start
            begin = max(begin, stop)
    if begin < end:
        yield begin, end


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
        motion = _unchecked(Motion, F=next(rest), f=None if motion.f is None else next(rest))
    made = object.__new__(Hierarchy)
    for item in fields(Hierarchy):  # constant fields
        object.__setattr__(made, item.name, getattr(pattern, item.name))
    for name, value in (("levels", tuple(levels)), ("metric", metric), ("origin", origin), ("motion", motion)):
        object.__setattr__(made, name, value)
    object.__setattr__(made, "stacked", None)
    return made


def _rows(A: Any, lower: Any, upper: Any) -> Rows:
    return _unchecked(Rows, A=A, lower=lower, upper=upper)


def _unchecked(kind: type[T], **values: Any) -> T:
    """A value without a check of its numbers: a recorded value may be the fault."""
    made = object.__new__(kind)
    for name, value in values.items():
        object.__setattr__(made, name, value)
    return made


def pattern_of(problem: Hierarchy) -> dict[str, Any]:
    """Data of a file beside the arrays of a tick, as JSON."""
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
        "eta": problem.eta,
        "turning": None if problem.turning is None else problem.turning.tolist(),
        "motion": motion,
    }


def from_pattern(pattern: dict[str, Any]) -> Hierarchy:
    """The hierarchy of a pattern, its arrays zero."""
    n, levels = int(pattern["n"]), []
    for level in pattern["levels"]:
        A: Any = (
            np.zeros(level["shape"])
            if "shape" in level
            else Selection(np.array(level["index"], np.intp), np.array(level["scale"]))
        )
        m = A.index.size if isinstance(A, Selection) else A.shape[0]
        levels.append(Rows(A, np.zeros(m), np.zeros(m)))
    motion = pattern["motion"]
    if motion is not None:
        F = np.ones(motion["F"])
        motion = Motion(F, np.zeros(F.shape[0]) if motion["f"] else None)
    made = Hierarchy(
        tuple(levels),
        pattern["constraints"],
        n=n,
        prices=None if pattern["prices"] is None else np.array(pattern["prices"]),
        eta=pattern.get("eta", ETA),
        turning=None if pattern.get("turning") is None else np.array(pattern["turning"]),
        motion=motion,
    )
    return replace(
        made, metric=np.eye(n) if pattern["metric"] else None, origin=np.zeros(n) if pattern["origin"] else None
    )


def arrays_of(problem: Hierarchy) -> list[Any]:
    """All arrays of a hierarchy that change from tick to tick."""
    return _arrays(problem)
