"""Stored problem sets as hierarchies; see data/problems/README.md."""

from __future__ import annotations

from collections.abc import Iterator
from pathlib import Path

import numpy as np

from hqp import Hierarchy, Rows, Selection
from hqp.arrays import Mat, Vec

FOLDER = Path(__file__).with_name("data") / "problems"


def names() -> tuple[str, ...]:
    """Names of the sets, in alphabetical order."""
    return tuple(sorted(path.stem for path in FOLDER.glob("*.npz")))


def load(name: str, limit: int | None = None, selections: bool = True) -> tuple[Hierarchy, ...]:
    """Problems of a set, the first ``limit`` of them.

    selections: write a level of simple bounds as a Selection, as a session does. Raises FileNotFoundError with the
    names of the sets for an unknown name.
    """
    path = FOLDER / f"{name}.npz"
    if not path.is_file():
        raise FileNotFoundError(f"no problem set {name!r}; there are {', '.join(names())}")
    return tuple(_read(path, limit, selections))


def _read(path: Path, limit: int | None, selections: bool) -> Iterator[Hierarchy]:
    with np.load(path) as data:
        n, sizes = int(data["n"]), data["m"][:limit]
        A, lower, upper, simple = data["A"], data["lb"], data["ub"], data["sb"].astype(np.intp)
    start = 0
    for rows in sizes:
        levels = []
        for m in rows:
            part = slice(start, start + int(m))
            levels.append(Rows(_coefficients(A[part], simple[part], selections), lower[part], upper[part]))
            start += int(m)
        yield Hierarchy(tuple(levels), n=n)


def _coefficients(A: Mat, simple: Vec, selections: bool) -> Mat | Selection:
    if not selections or not simple.size or simple.min() < 0:
        return A
    return Selection(simple, A[np.arange(simple.size), simple])
