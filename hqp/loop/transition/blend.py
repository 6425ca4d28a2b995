"""From one stack to another without a jump: neighbours on a path of stacks are blended, one pair after the other.

    x = x_a + h (x_b - x_a),    h = 3 s^2 - 2 s^3 from 0 to 1 in ``over`` seconds

Both answers lie in the convex set of optima of every level that the two stacks share from the top, so x does: levels
above a change are as they were, exactly, and h J x_b + (1 - h) J x_a is the intermediate desired value of Lee, Mansard
and Park (2012) for a task that comes or goes.
"""

from __future__ import annotations

import math
from collections.abc import Iterable, Mapping, Sequence
from dataclasses import fields, is_dataclass
from functools import cached_property
from itertools import accumulate, pairwise
from typing import TYPE_CHECKING

import numpy as np

from hqp.arrays import Index, Vec
from hqp.declare.element import Element
from hqp.declare.reference import Reference, copied
from hqp.declare.stack import Stack
from hqp.loop.outgoing import largest_change
from hqp.loop.transition.easing import Easing, easing
from hqp.programs import envelope

try:
    from hqp import _assembly as native
except ImportError:  # no compiler was there
    native = None  # type: ignore[assignment]

if TYPE_CHECKING:
    from hqp.declare.robot import Robot, State
    from hqp.loop.line import Line
    from hqp.loop.transition.waypoints import Waypoint

STILL = 1e-9
"""Share of the largest change below which a command is the same in both stacks."""

PATIENCE = 10.0
"""A transition that has taken this many times its duration goes on at a pace of 1 / PATIENCE whatever the command
does, so that it ends."""

LIGHT = 0.25
"""A contact that was measured to bear no more than this share of the weight is let go as it is."""

NEARLY = 1.0 - 1e-6
"""How far a pair gets while its command is clipped."""


def surviving(before: Stack, holds: Mapping[str, Reference], after: Stack) -> dict[str, Reference]:
    """The hold values of one stack that are good for another."""
    return {
        element.name: holds[element.name]
        for element in after
        if element.name in holds and element.name in before and same_quantity(element, before.find(element.name))
    }


def same_quantity(one: Element, other: Element) -> bool:
    """Whether a hold value of one is one of the other: class and every field but name, law, weight and when agree."""
    if one is other:
        return True
    if type(one) is not type(other) or not is_dataclass(one):
        return False
    names = [item.name for item in fields(one) if item.name not in ("name", "law", "weight", "when")]
    return all(getattr(one, name) == getattr(other, name) for name in names)


def without_successor(before: Stack, after: Stack) -> tuple[Element, ...]:
    """Contacts in ``subject_to`` of one stack that another one does not have there."""
    kept = {e.name: e for e in after.subject_to}
    contacts = (e for e in before.subject_to if e.is_contact)
    return tuple(e for e in contacts if e.name not in kept or not same_quantity(e, kept[e.name]))


class Transition:
    """Where a session stands on its path: the pair of lines that is blended, and how far."""

    def __init__(
        self,
        lines: Sequence[Line],
        path: Sequence[Waypoint],
        over: float,
        dt: float,
        kind: str,
        *,
        ordinary: bool = False,
        given: Iterable[Reference] = (),
    ) -> None:
        """ordinary: whether the latest tick was, with every task within reach.  given: the references of that tick."""
        self._given, self._kept = {reference.name: reference for reference in given}, dict[str, Reference]()
        self._ticks, self._ordinary = over / dt, ordinary
        self._left = PATIENCE * self._ticks
        self.cap = self.most = largest_change(kind, dt)
        """Largest change of a command in a tick; most: in this one."""
        self._at, self._s = 0, 0.0
        self.taken = False
        """Whether the second line of the pair has begun."""
        self.within = False
        """Whether another transition blends its answers with those of a third stack."""
        self.released_rows = () if kind == "torque" else without_successor(path[0].stack, path[-1].stack)
        self._begun, self._felt = len(path) == 2, False
        self._go(lines, path)

    def _go(self, lines: Sequence[Line], path: Sequence[Waypoint]) -> None:
        """Take that way."""
        self._lines, self._path = list(lines), list(path)
        self._spans = [0.0 if point.switch else 1.0 for point in self._path[:-1]]
        self._done = [0.0, *accumulate(self._spans)]
        self._pace = sum(self._spans) / self._ticks
        released = bool(self.released_rows) and self._ordinary
        self._easings = [
            easing(*pair, one.stack, other.stack, released=released) if span else None
            for span, pair, (one, other) in zip(self._spans, pairwise(self._lines), pairwise(self._path), strict=True)
        ]

    def feel(self, references: Iterable[Reference], robot: Robot) -> None:
        """Choose the way by the loads that contacts were measured to bear, before the first tick.

        Where the ground is known to be under those that are taken up, and those that are released bear little, answers
        may be blended as they are: forces follow from the torques, and so from what was measured.
        """
        if self._begun:
            return
        self._begun = True
        light = LIGHT * sum(body[3] for body in robot.bodies) * float(np.linalg.norm(robot.gravity))
        loads = {r.name: load for r in references if (load := getattr(r, "load", None)) is not None}
        taken = {name for point in self._path for name in point.taken}
        released = {name for point in self._path for name in point.released}
        there = all(loads.get(name, 0.0) >= envelope.native.ContactWatch.LEAST_LOAD for name in taken)
        if there and all(loads.get(name, math.inf) <= light for name in released):
            self._felt = True
            self._go((self._lines[0], self._lines[-1]), (self._path[0], self._path[-1]))

    @property
    def pair(self) -> tuple[Line, Line]:
        """The lines that are blended now."""
        return self._lines[self._at], self._lines[self._at + 1]

    @property
    def progress(self) -> float:
        """0 at the start, 1 at the end of the whole path."""
        at = self._at
        return (self._done[at] + self._spans[at] * smooth(self._s)) / self._done[-1]

    @property
    def done(self) -> bool:
        """Whether the last stack has taken over."""
        return self.arriving and self._s >= 1.0

    @property
    def depth(self) -> int:
        """How many transitions are under way, this one included."""
        inner = self._lines[self._at].transition
        return 1 + (inner.depth if inner is not None else 0)

    @property
    def released(self) -> tuple[str, ...]:
        """Contacts that must bear nothing now, for they leave the dynamics."""
        return self._path[self._at].released

    def __contains__(self, name: str) -> bool:
        return name in self.names

    @cached_property
    def names(self) -> frozenset[str]:
        """Elements of all stacks that are blended, those of transitions under way among them."""
        found = {element.name for line in self._lines for element in line.stack}
        inner = self._lines[0].transition
        return frozenset(found if inner is None else found | inner.names)

    def outgoing(self, references: Iterable[Reference]) -> tuple[Reference, ...]:
        """References of a stack on its way out: those of this tick, and the last one of elements that have none now."""
        kept, given = self._kept, {reference.name: reference for reference in references}
        for name, last in self._given.items():
            if name not in given and last.finite:
                kept[name] = Reference(**{**vars(copied(last)), "load": None})  # which was measured then
        for name in given:
            kept.pop(name, None)
        self._given = given
        return (*given.values(), *kept.values())

    @property
    def last_references(self) -> tuple[Reference, ...]:
        """Of the latest tick, and those kept from ticks before."""
        return (*self._given.values(), *self._kept.values())

    @property
    def arriving(self) -> bool:
        """Whether the second stack of the pair is the last one."""
        return self._at == len(self._lines) - 2

    def here(self, state: State, given: Sequence[str]) -> tuple[Reference, ...]:
        """References that hold a contact on its way out where it is, not where it was.  given: names that have one."""
        ease = self.ease
        if ease is not None:
            ease.here = ease.stands and ease.names.isdisjoint(given)
        if not state.valid or (ease is not None and ease.here):
            return ()
        return tuple([element.hold(state) for element in self.released_rows if element.name not in given])

    @property
    def ease(self) -> Easing | None:
        """What eases the rows that only one stack of the pair has, None where they differ in more than these."""
        return self._easings[self._at]

    def target(self, *, wait: bool = False) -> float:
        """h that this tick comes to unless a command would change too fast.  wait: no further than before."""
        return smooth(self._s if wait else min(1.0, self._s + self._step))

    def blend(self, a: Vec, b: Vec, last: Vec, joints: Index | slice, h: float) -> tuple[Vec, float]:
        """x of this tick, and its largest change of a command: as far from a to b as h says, and as the largest change
        allows where a point between the two does: ``cap``, and after a measured touch-down or lift-off, which is
        answered at once, so much more than the answers change by themselves."""
        ease = self.ease
        weight, s = h if ease is None else ease.weight(h), inverse(h)
        self._left -= s > self._s
        x, reach = between(a, b, last, weight, joints)
        self.most = self.cap
        if reach > self.cap and self._felt:
            stood = smooth(self._s) if ease is None else ease.weight(smooth(self._s))
            self.most += between(a, b, last, stood, joints)[1]
        if reach > self.most:
            least = smooth(min(s, self._s + (self._pace / PATIENCE if self._left < 0 else 0.0)))
            least = least if ease is None else ease.weight(least)
            fastest = self._fastest((a - last)[joints], (b - a)[joints], weight)
            weight = max(least, fastest) if fastest > 0.0 else weight
            s = inverse(weight if ease is None else ease.share(weight))
            x, reach = between(a, b, last, weight, joints)
        self._s = 1.0 if h >= 1.0 and weight >= 1.0 else max(self._s, s)
        return x, reach

    def clipped(self) -> None:
        """What was sent is not the blend: a pair does not end there."""
        self._s = min(self._s, NEARLY)

    @property
    def _step(self) -> float:
        return self._pace if self._spans[self._at] else 1.0

    def _fastest(self, start: Vec, difference: Vec, h: float) -> float:
        """The largest h below ``h`` for which |start + h difference| stays within the cap, 0 where there is none."""
        size = np.abs(difference)
        moving = size > STILL * self.cap
        size, middle = size[moving], -start[moving] / difference[moving]
        reach = self.most / size
        low, high = float((middle - reach).max(initial=0.0)), float((middle + reach).min(initial=h))
        return high if low <= high else 0.0

    def advance(self) -> None:
        """Take the next pair where this one is done."""
        if self._s >= 1.0 and self._at < len(self._lines) - 2:
            self._at, self._s, self.taken = self._at + 1, 0.0, False


def between(a: Vec, b: Vec, last: Vec, weight: float, joints: Index | slice) -> tuple[Vec, float]:
    """a + weight (b - a), and its largest distance from the last x over these joints."""
    if native is not None and isinstance(joints, slice):
        x = np.empty(a.size)
        return x, native.blend(a, b, last, weight, joints.start, joints.stop, x)
    x = a + weight * (b - a)
    return x, largest((x - last)[joints])


def largest(change: Vec) -> float:
    """The largest magnitude."""
    return float(np.abs(change).max()) if change.size else 0.0


def smooth(s: float) -> float:
    """3 s^2 - 2 s^3."""
    return s * s * (3.0 - 2.0 * s)


def inverse(h: float) -> float:
    """s with smooth(s) = h."""
    return 0.5 - math.sin(math.asin(1.0 - 2.0 * min(max(h, 0.0), 1.0)) / 3.0)
