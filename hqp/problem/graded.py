"""Gradient of a level whose rows differ in length: rounding of long rows must not hide the short ones.

A slack of 1e-10, which is rounding of a row of 1e6, pulls by 1e-4: as much as a row of 1 with a slack of 1e-4.
Householder with column pivoting over rows from the longest to the shortest is stable row by row (Cox and Higham 1998):
in its coordinates the residual that a step can remove has rows of its own. These rows give the reduction by the step,
the other rows the gradient after it.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from hqp.arrays import Index, Mat, Vec, row_lengths
from hqp.tolerances import FLAT_ROW, GRADED_ROWS, NULL_SPACE_ROUNDING


def is_graded(lengths: Vec, zero: float) -> bool:
    """Return true if some row is much shorter than the longest; rows up to ``zero`` do not count."""
    return bool(np.any((lengths > zero) & (lengths < GRADED_ROWS * lengths.max(initial=0.0))))


@dataclass(frozen=True, slots=True, eq=False)
class Pull:
    """The gradient ``(k,)`` along the active rows after the best step on their face, the size of its terms, and the
    most that the step takes away of a row, relative to its length and x."""

    along: Vec
    size: float
    taken: float


@dataclass(frozen=True, slots=True, eq=False)
class Errors:
    """Errors of rows, ``(m,)`` each: error of an entry on the face, error of a slack, and error of the row by which its
    slack pulls."""

    entry: Vec
    slack: Vec
    row: Vec

    @staticmethod
    def none(m: int) -> Errors:
        """Exact rows."""
        return Errors(*np.zeros((3, m)))


def pull(face: Mat, along: Mat, slack: Vec, lengths: Vec, sizes: Vec, rounding: float, errors: Errors) -> Pull:
    """along' w after the step that is best for ||w||, w = slack + face step.

    face: ``(m, f)`` rows in coordinates of the face of all active rows; along: ``(m, k)`` in those of the active rows;
    slack, lengths: ``(m,)``; sizes: ``(m,)``, sizes that errors of the rows are relative to.  A term is the pull of the
    row, plus its pull for a slack of its size, plus ``rounding`` of either: rounding of a row of unit length, divided
    by the tolerance.  Rounding of entries pulls by the slack that the step leaves of the rows as they are given: the
    reflections mix rows, and a short one has what a long one leaves.  Entries within their error add no direction; a
    slack within its error, or within the step that this pull makes of a row, is not taken away, and one that errors of
    the rows may balance stays.
    """
    found = _sorted(face, np.column_stack([along, slack]), lengths, FLAT_ROW, errors)
    T, order, rank = found.T, found.order, found.rank
    miss, steps = np.abs(slack + face @ found.step(face.shape[1])), T[:rank, -1]
    left, pivots = lengths @ miss, np.abs(np.diagonal(T)[:rank])
    rounded = found.errors.slack[:rank] + NULL_SPACE_ROUNDING * left / pivots
    doubt = rounded + errors.row @ miss / pivots
    taken = np.maximum(np.abs(steps) - doubt, 0.0) / sizes[order[:rank]]
    stays = np.append(np.flatnonzero((np.abs(steps) > rounded) & (np.abs(steps) <= doubt)), np.arange(rank, len(T)))
    A, w = T[stays, face.shape[1] : -1], T[stays, -1]
    size, own = sizes[order[stays]], lengths[order[stays]]
    terms = np.linalg.norm(A, axis=1) @ (np.abs(w) + size) + rounding * (left + rounding * (own @ size))
    return Pull(A.T @ w, float(terms), float(taken.max(initial=0.0)))


def best_step(face: Mat, slack: Vec, lengths: Vec, least: float = FLAT_ROW) -> Vec:
    """argmin ||slack + face step||, the shortest of them, ``(f,)``; least: share of a row's length above which it adds
    a direction."""
    none = Errors.none(slack.size)
    return _sorted(face, slack[:, None], lengths, least, none).step(face.shape[1])


@dataclass(frozen=True, slots=True, eq=False)
class _Reduced:
    """The rows [face, beside] after the reflections, the order of rows and of columns of the face, and how many rows,
    the first, a step can meet; errors of the rows as they are now."""

    T: Mat
    order: Index
    columns: Index
    rank: int
    errors: Errors

    def step(self, f: int) -> Vec:
        """The shortest step on the face, ``(f,)``, that meets the first rows of the last column."""
        found = np.zeros(f)
        if self.rank:
            own = row_lengths(R := self.T[: self.rank, :f])
            met = np.linalg.lstsq(R / own[:, None], self.T[: self.rank, -1] / own, rcond=None)[0]
            found[self.columns] = -met
        return found


def _sorted(face: Mat, beside: Mat, lengths: Vec, least: float, errors: Errors) -> _Reduced:
    order = np.argsort(-lengths, kind="stable")
    T, own = np.concatenate([face, beside], axis=1)[order], lengths[order]
    error = np.column_stack([errors.entry, errors.slack, errors.row])[order]
    f, rank = face.shape[1], 0
    columns = np.arange(f)
    while True:
        flat = np.abs(T[rank:, rank:f]).max(axis=1, initial=0.0) <= np.maximum(least * own[rank:], error[rank:, 0])
        clear = int(np.count_nonzero(~flat))
        if flat[:clear].any():
            last = rank + np.concatenate([np.flatnonzero(~flat), np.flatnonzero(flat)])  # the flat ones only pull
            T[rank:], own[rank:], order[rank:], error[rank:] = T[last], own[last], order[last], error[last]
        if not clear or rank == f:
            return _Reduced(T, order, columns, rank, Errors(*error.T))
        left = T[rank : rank + clear, rank:f]
        p = rank + int(np.argmax(np.einsum("ij,ij->j", left, left)))
        T[:, [rank, p]], columns[[rank, p]] = T[:, [p, rank]], columns[[p, rank]]
        v = T[rank:, rank].copy()
        share = np.abs(v) / np.linalg.norm(v)  # share of each row in the pivot row, and of the pivot row in each
        error[rank] = share @ error[rank:]
        error[rank + 1 :] += share[1:, None] * error[rank]
        v[0] += np.copysign(np.linalg.norm(v), v[0])
        T[rank:, rank:] -= np.outer(2.0 * v / (v @ v), v @ T[rank:, rank:])  # columns before it are zero there
        T[rank + 1 :, rank] = 0.0
        rank += 1
