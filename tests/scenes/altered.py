"""Python solver with answers that a test alters."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass
from typing import Any

from hqp.problem import Hierarchy, Shape, Solution
from hqp.solvers.base import Workspace
from hqp.solvers.lexicographic import Lexicographic


@dataclass
class Answers:
    """Change of every answer, set by a test; None keeps answers unchanged."""

    alter: Callable[[Hierarchy, Solution], Solution] | None = None


class AlteredWorkspace:
    """Workspace of the solver, with altered answers."""

    def __init__(self, whole: Workspace, answers: Answers) -> None:
        self._whole, self._answers = whole, answers

    def solve(self, problem: Hierarchy) -> Solution:
        """Return the altered answer."""
        found = self._whole.solve(problem)
        return found if self._answers.alter is None else self._answers.alter(problem, found)

    def reset(self) -> None:
        """Forget the warm start."""
        self._whole.reset()


@dataclass(frozen=True, kw_only=True, eq=False)
class Altered(Lexicographic):
    """The lexicographic solver, called from Python."""

    answers: Any = None

    def workspace(self, shape: Shape) -> Workspace:
        """Allocate for problems of this shape."""
        return AlteredWorkspace(super().workspace(shape), self.answers)
