"""Interface of a back end: min 1/2 x' H x + g' x subject to lower <= C x <= upper, again and again at one size."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Protocol

from hqp.arrays import Mat, Vec


@dataclass(frozen=True, slots=True, eq=False)
class QpAnswer:
    """x ``(n,)``; multipliers ``(m,)`` with H x + g + C' z = 0, z > 0 at upper and < 0 at lower sides.

    solved: true if the back end reports that it met its tolerance.  status: its own word for how it ended.
    """

    x: Vec
    multipliers: Vec
    solved: bool
    iterations: int
    status: str


class QpWorkspace(Protocol):
    """One size of problem; keeps the warm start where the back end can use one."""

    def solve(self, H: Mat, g: Vec, C: Mat, lower: Vec, upper: Vec) -> QpAnswer:
        """H ``(n, n)`` symmetric positive semidefinite, C ``(m, n)``; raises BackendError if the package raises."""
        ...


class Backend(Protocol):
    """A package that solves QPs."""

    def workspace(self, n: int, m: int) -> QpWorkspace:
        """Allocate for n variables and m rows."""
        ...
