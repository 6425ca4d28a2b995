"""What a level pulls whose rows differ in length: rounding of long rows must not hide the short ones.

A slack of 1e-10, which is rounding of a row of 1e6, pulls by 1e-4: as hard as a row of 1 that misses by 1e-4.
Householder with column pivoting over rows from the longest to the shortest is stable row by row (Cox and Higham 1998):
in its coordinates what a step can meet stands in rows of its own. They say what the step takes away, the other rows
what the level pulls after it.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from hqp.arrays import Mat, Vec
from hqp.tolerances import FLAT_ROW, GRADED_ROWS, NULL_SPACE_ROUNDING


def is_graded(lengths: Vec, zero: float) -> bool:
    """Whether some row is so much shorter than the longest; rows up to ``zero`` are none."""
    return bool(np.any((lengths > zero) & (lengths < GRADED_ROWS * lengths.max(initial=0.0))))


@dataclass(frozen=True, slots=True, eq=False)
class Pull:
    """The gradient ``(k,)`` along the active rows after the best step on their face, the size of its terms, and the
    most that the step takes away of a row, relative to its length and x."""

    along: Vec
    size: float
    taken: float


def pull(face: Mat, along: Mat, slack: Vec, lengths: Vec, size: float, tolerance: float) -> Pull:
    """along' w after the step that is best for ||w||, w = slack + face step.

    face: ``(m, f)`` rows in coordinates of the face of all active rows; along: ``(m, k)`` in those of the active rows;
    slack, lengths: ``(m,)``; size: of x.  A term is what the row pulls and what it would pull, had it
    missed by its length times x, and rounding of either over tolerance: a gap is about the relative error of x.
    """
    order = np.argsort(-lengths, kind="stable")
    T, lengths = np.column_stack([face, along, slack])[order], lengths[order]
    f, rank, m = face.shape[1], 0, len(T)
    while True:
        flat = np.abs(T[rank:m, rank:f]).max(axis=1, initial=0.0) <= FLAT_ROW * lengths[rank:m]
        last = rank + np.concatenate([np.flatnonzero(~flat), np.flatnonzero(flat)])
        T[rank:m], lengths[rank:m] = T[last], lengths[last]
        m -= int(flat.sum())
        if rank >= min(m, f):
            break
        p = rank + int(np.argmax(np.square(T[rank:m, rank:f]).sum(axis=0)))
        T[:m, [rank, p]] = T[:m, [p, rank]]
        v = T[rank:m, rank].copy()
        v[0] += np.copysign(np.linalg.norm(v), v[0])
        T[rank:m] -= np.outer(2.0 * v / (v @ v), v @ T[rank:m])
        T[rank + 1 : m, rank] = 0.0
        rank += 1
    taken = np.abs(T[:rank, -1]) / (size * lengths[:rank])
    A, w = T[rank:, f:-1], T[rank:, -1]
    own = lengths[rank:]
    rounding = NULL_SPACE_ROUNDING / tolerance * own
    terms = np.linalg.norm(A, axis=1) * (np.abs(w) + size * own) + rounding * (np.abs(w) + size * rounding)
    return Pull(A.T @ w, float(terms.sum()), float(taken.max(initial=0.0)))
