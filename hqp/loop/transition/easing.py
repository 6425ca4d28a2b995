"""Rows that only one of two stacks has ask for what the other stack gives, or for something on the way there.

    b' = J x_other + k (b - J x_other),    k = h^p where the row comes, (1 - h)^p where it goes,    p = 3/4

the intermediate desired value of Lee, Mansard and Park (2012).  A task that is far from its target is out of reach at
once; its answer is costly to find, and more than a transition can use.  Answers are blended all the same, by so much
that the row gets h b + (1 - h) J x_other or its mirror image, as it does without this.
"""

from __future__ import annotations

import math
from typing import TYPE_CHECKING

import numpy as np

from hqp.arrays import Mat, Vec
from hqp.declare.law import P
from hqp.declare.stack import Stack
from hqp.problem import Selection
from hqp.programs.formulation import Program

if TYPE_CHECKING:
    from hqp.loop.line import Line

try:
    from hqp import _assembly as native
except ImportError:  # no compiler was there
    native = None  # type: ignore[assignment]

EXPONENT = 0.75
"""p: at 1 nothing would be blended, and what two stacks decide differently would jump."""


def added(before: Stack, after: Stack) -> tuple[str, ...]:
    """Equalities on motion that one stack has and another one does not, () where they differ in anything else."""
    new = {e.name: e for e in after if e.name not in before}
    if not new or not all(e.equality and e.quantity == "motion" for e in new.values()):
        return ()
    if [e for e in after.subject_to if e.name not in new] != list(before.subject_to):
        return ()
    kept = [level for level in after.levels if any(e.name not in new for e in level)]
    if len(kept) != len(before.levels):
        return ()
    for level, old in zip(kept, before.levels, strict=True):
        if level != old and level.replace(*(e for e in level if e.name not in new)) != old:
            return ()
    return tuple(new)


class Easing:
    """Rewrites rows after each fill and before each solve of their stack, the first or the second one of a pair."""

    def __init__(self, program: Program, names: tuple[str, ...], *, second: bool) -> None:
        self.second = second
        self.names = frozenset(names)
        self.here = False
        """Whether b is without the error: a contact on its way out is held where it is, not where it was."""
        self._rows: list[tuple[Mat, Vec, Vec]] = []
        self._pull: list[tuple[Vec, Vec] | None] = []
        for name in names:
            place = program.places[name]
            rows, part = program.problem.levels[place.level], place.part
            if not isinstance(rows.A, Selection):
                self._rows.append((rows.A[part], rows.lower[part], rows.upper[part]))
            member = program.assembly.members[name]
            linear: tuple[Vec, Vec] | None = None
            gain = member.law.gain if isinstance(member.law, P) else getattr(member.law, "kp", None)
            bound = None if member.law is None else min(member.law.max_velocity, member.law.max_acceleration)
            if gain is not None and bound == math.inf and program.kind != "torque":
                gains = np.broadcast_to(np.asarray(gain, dtype=np.float64), rows.lower[part].shape)
                linear = program.assembly.error[member.part], place.element.weight * gains
            self._pull.append(linear)
        self._whole = len(self._rows) == len(names)
        self.stands = not second and self._whole and all(pull is not None for pull in self._pull)
        """Whether ``here`` is possible: b is linear in the error."""
        self._other: Vec | None = None
        self._k = 1.0
        self._native = None if native is None or not self._whole else native.EasedRows()
        if self._native is not None:
            for rows_of, pull in zip(self._rows, self._pull, strict=True):
                self._native.add(*rows_of, *(pull or (None, None)))

    def aim(self, other: Vec, h: float) -> None:
        """Ask for that share of the way from the other stack's answer."""
        self._other = other
        self._k = (h if self.second else 1.0 - h) ** EXPONENT if self._whole else 1.0
        if self._native is not None:
            self._native.aim(other, self._k, self.here)

    def before(self, solve: object) -> object | None:
        """The solve of that capsule with this ahead of it, as native modules run it; None where it is not native."""
        return None if self._native is None else self._native.before(solve)

    def __call__(self) -> None:
        """Rewrite the rows."""
        if self._native is not None:
            self._native.rewrite()
            return
        if self._other is None or (self._k == 1.0 and not self.here):
            return
        for i, (A, lower, upper) in enumerate(self._rows):
            if not lower[0] > -math.inf:  # left out of this tick
                continue
            if self.here and (linear := self._pull[i]) is not None:
                error, pull = linear
                lower += pull * error
                upper[:] = lower
            there = A @ self._other
            there *= 1.0 - self._k
            for bound in (lower, upper):
                bound *= self._k
                bound += there

    def weight(self, h: float) -> float:
        """How much of the second answer is blended in, 0 to 1."""
        if self.second:
            return min(1.0, h / self._k) if self._k > 0.0 else 0.0
        return max(0.0, 1.0 - (1.0 - h) / self._k) if self._k > 0.0 else 1.0

    def share(self, weight: float) -> float:
        """The h that a weight stands for."""
        return weight * self._k if self.second else 1.0 - (1.0 - weight) * self._k


def easing(first: Line, second: Line, before: Stack, after: Stack, *, released: bool) -> Easing | None:
    """What eases the rows that only one stack of a pair has, None where they differ in more than these.

    A contact that comes is where it is to be.  released: whether rows of a contact that goes are eased; where tasks are
    out of reach on the way out, their answer moves too fast with what is asked of that contact.
    """
    names = added(before, after)
    if names and not any(e.name in names for e in after.subject_to):
        return Easing(second.program, names, second=True)
    names = added(after, before) if released else ()
    if not names:
        return None
    return Easing(first.program, names, second=False)
