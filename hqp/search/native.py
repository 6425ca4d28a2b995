"""Whole descents in one native call, for stacks whose rows and solver are native."""

from __future__ import annotations

from collections.abc import Sequence
from typing import TYPE_CHECKING

import numpy as np

from hqp.arrays import Vec
from hqp.declare.element import Element, Inequality
from hqp.declare.reference import Reference
from hqp.declare.robot import Robot
from hqp.programs.assembly import LARGEST, kinematics

from .descent import LAST, LEAST, POLISH, PROGRESS, STEP, Descent
from .sessions import Session

if TYPE_CHECKING:
    from hqp._assembly import Descents

CONTINUED = "continued by the general path"
REASONS = ("", "the solver found no solution", "no step improves it", "stalled", "step limit reached", CONTINUED)
"""Ends of a native descent, by number; after the last of them the general path continues."""


class NativeDescents:
    """Run descents of one session in native code.

    ``descend`` returns None if the general path must do it, and the reason ``CONTINUED`` if that must go on from there.

    members: the elements of each group, ``subject_to`` first.  guard_rate: share of the way to their bounds that rows
    of inequalities allow a step.  still, stalled: a smaller step ends a descent that has not met its targets, and so do
    more steps that lead no further, None for any number.  Inequalities whose rows lack their violation, readable
    rows, joints that are no ``tree_joints`` and references that are not finite are left to the general path.
    """

    def __init__(
        self,
        session: Session,
        members: Sequence[Sequence[Element]],
        guard_rate: float,
        still: float,
        stalled: int | None,
    ) -> None:
        self._session, self._members, self._guard_rate = session, members, guard_rate
        self._still, self._stalled = still, stalled
        self._names = [element.name for elements in members for element in elements]
        self._made: dict[frozenset[str], Descents] = {}
        self._references: tuple[Reference, ...] = ()
        self._targets: frozenset[str] = frozenset()
        self._aimed = self._possible_now = False
        self._possible = self._fits()
        self._merit, self._errors = np.zeros(len(members)), np.zeros(len(self._names))

    def _fits(self) -> bool:
        assembly, robot = self._session.program.assembly, self._session.robot
        if assembly.written or assembly.native_rows is None or robot.tree_joints is None:
            return False
        if not assembly.members.keys() >= set(self._names):  # loads, which have no rows
            return False
        if not all(has_native_error(element, robot) for elements in self._members for element in elements):
            return False
        bind = getattr(self._session.workspace, "kernel", None)
        kernel = None if bind is None else bind(self._session.program.problem)
        if kernel is None:
            return False
        assembly.native_rows.answers(kernel[3], kernel[1], LARGEST)
        return True

    def aim(self, references: tuple[Reference, ...], targets: frozenset[str]) -> None:
        """References of every element that takes one, and the names of those that count."""
        self._references, self._targets, self._aimed = references, targets, False

    def leave(self) -> None:
        """The session steps by itself: nothing of a native descent must stay."""
        self._aimed = False

    def descend(self, q: Vec, tolerance: float, most: int, seconds: float) -> Descent | None:
        """Descend from q, see ``Search.descend``; return None if the general path must begin."""
        native = self._ready()
        if native is None:
            return None
        q = np.array(q, dtype=np.float64)
        end, steps = native.run(q, self._merit, self._errors, tolerance, most, seconds)
        if REASONS[end] == CONTINUED and not steps:
            return None
        errors = dict(zip(self._names, self._errors.tolist(), strict=True))
        return Descent(q, tuple(self._merit.tolist()), steps, REASONS[end], errors)

    def _ready(self) -> Descents | None:
        """The native descents with their references taken."""
        if not self._possible:
            return None
        native = self._made.get(self._targets) or self._make()
        if not self._aimed:
            self._aimed = True
            self._possible_now = native.aim(self._references)
        return native if self._possible_now else None

    def _make(self) -> Descents:
        from hqp._assembly import Descents, Pace
        from hqp.tasks import JointLimits

        session, members = self._session, []
        assembly, robot = session.program.assembly, session.robot
        assert assembly.native_rows is not None
        for group, elements in enumerate(self._members):
            for e in elements:
                part, bounded = assembly.members[e.name].part, isinstance(e, Inequality)
                limit = isinstance(e, JointLimits)
                rate = e.weight * (1.0 if limit else self._guard_rate) if bounded else 0.0
                counts = e.name in self._targets and not limit
                members.append((part.start, part.stop, rate, group if counts else -1))
        pace = Pace(STEP, LEAST, PROGRESS, POLISH, self._still, self._stalled, LAST)
        live = kinematics(robot)
        assert live is not None
        native = Descents(assembly.native_rows, live, members, len(self._members), robot.nq, pace)
        self._made[self._targets] = native
        return native


def has_native_error(element: Element, robot: Robot) -> bool:
    """Return true if the rows of an element hold its error; bounds do if a step goes a share of the remaining way."""
    from hqp.tasks import CollisionAvoidance, Cone, JointLimits, SupportPolygon, Within

    if isinstance(element, Within):
        plan = element.plan(robot)
        return plan is not None and not plan.rates
    return not isinstance(element, Inequality) or isinstance(
        element, (CollisionAvoidance, Cone, JointLimits, SupportPolygon)
    )
