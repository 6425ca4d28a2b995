"""From one stack to another without a jump: neighbours on a path of stacks are blended, one pair after the other.

    x = x_a + h (x_b - x_a),    h = 3 s^2 - 2 s^3 from 0 to 1 in ``over`` seconds

Both answers lie in the convex set of optima of every level that the two stacks share from the top, so x does: levels
above a change are as they were, exactly, and h J x_b + (1 - h) J x_a is the intermediate desired value of Lee, Mansard
and Park (2012) for a task that comes or goes.  Where x is a torque, a contact may only change while it bears nothing:
it is unloaded under the old set of contacts (its force then is (1 - h) times what it was), the set is changed while it
bears zero, and a new one is loaded under the new set (its force is h times what it will be).
"""

from __future__ import annotations

from collections.abc import Sequence
from typing import TYPE_CHECKING

import numpy as np

from hqp.arrays import Index, Vec
from hqp.element import Element
from hqp.robot import Robot
from hqp.stack import Level, Stack

if TYPE_CHECKING:
    from hqp.session import Session

LARGEST_CHANGE = {"velocity": 0.02, "acceleration": 1.0, "torque": 1.0}
"""A transition slows down rather than change a command by more in one tick [rad/s, rad/s^2, N m]."""

SLOWEST = 0.2
"""Share of its pace that a transition keeps whatever the command does, so that it ends."""


def path(before: Stack, after: Stack, robot: Robot, *, torque: bool) -> list[Stack]:
    """The stacks of a transition, first and last included; two but for torque with another set of contacts."""
    if not torque:
        return [before, after]
    old, new = ({e.name: e for e in stack.subject_to if e.is_contact} for stack in (before, after))
    released = [e for name, e in old.items() if new.get(name) != e]
    taken = [e for name, e in new.items() if old.get(name) != e]
    found = [before]
    if released:
        found.append(unloaded(before, released, robot))
    if taken:
        found.append(unloaded(after, taken, robot))
    return [*found, after]


def unloaded(stack: Stack, contacts: Sequence[Element], robot: Robot) -> Stack:
    """The stack with those contacts bearing no force, before all its levels, and nothing else asked of their force."""
    from hqp.tasks import ContactForce
    from hqp.tasks.targets import COMPONENTS

    names = {e.name for e in contacts}
    others = [e.name for e in stack if getattr(e, "contact", None) in names]
    rest = stack.without(*others) if others else stack
    zero = []
    for contact in contacts:
        basis = getattr(contact, "force_basis", None)
        size = contact.rows(robot) if basis is None else np.shape(basis())[0]
        name = f"{contact.name} bears nothing"
        zero.append(ContactForce(contact=contact.name, components=COMPONENTS[:size], name=name))
    return Stack(Level(*zero, name="unloaded"), *rest.levels, subject_to=rest.subject_to)


class Transition:
    """Where a session stands on its path: the pair of sessions that is blended, and how far."""

    def __init__(self, sessions: Sequence[Session], over: float, dt: float, kind: str) -> None:
        self._sessions, self._pace = list(sessions), dt * (len(sessions) - 1) / over
        self._cap = LARGEST_CHANGE[kind]
        self._at, self._s = 0, 0.0

    @property
    def pair(self) -> tuple[Session, Session]:
        """The sessions that are blended now."""
        return self._sessions[self._at], self._sessions[self._at + 1]

    @property
    def progress(self) -> float:
        """0 at the start, 1 at the end of the whole path."""
        return (self._at + smooth(self._s)) / (len(self._sessions) - 1)

    @property
    def done(self) -> bool:
        """Whether the last stack has taken over."""
        return self._at == len(self._sessions) - 2 and self._s >= 1.0

    @property
    def depth(self) -> int:
        """How many transitions are under way, this one included."""
        inner = self._sessions[self._at]._transition
        return 1 + (inner.depth if inner is not None else 0)

    def knows(self, name: str) -> bool:
        """Whether a reference of that name is for a stack of this transition."""
        return any(session.knows(name) for session in self._sessions)

    def blend(self, a: Vec, b: Vec, last: Vec, joints: Index) -> Vec:
        """x of this tick: as far from a to b as the schedule says, no further than the largest change allows.

        joints: which entries of x are a command.
        """
        target = min(1.0, self._s + self._pace)
        difference, start = (b - a)[joints], (a - last)[joints]
        h = smooth(target)
        reach = float(np.abs(start + h * difference).max(initial=0.0))
        if reach > self._cap:
            h = max(smooth(self._s + SLOWEST * (target - self._s)), self._fastest(start, difference, h))
        self._s = 1.0 if h >= 1.0 else max(self._s, inverse(h))
        return a + h * (b - a)

    def _fastest(self, start: Vec, difference: Vec, h: float) -> float:
        """The largest h below ``h`` for which |start + h difference| stays within the cap, 0 where there is none."""
        with np.errstate(divide="ignore", invalid="ignore"):
            ends = np.sort(np.stack([(-self._cap - start) / difference, (self._cap - start) / difference]), axis=0)
        still = difference == 0.0
        low = float(np.max(np.where(still, -np.inf, ends[0]), initial=0.0))
        high = float(np.min(np.where(still, np.inf, ends[1]), initial=h))
        return high if low <= high else 0.0

    def advance(self) -> None:
        """Take the next pair where this one is done."""
        if self._s >= 1.0 and self._at < len(self._sessions) - 2:
            self._at, self._s = self._at + 1, 0.0


def smooth(s: float) -> float:
    """3 s^2 - 2 s^3."""
    return s * s * (3.0 - 2.0 * s)


def inverse(h: float) -> float:
    """s with smooth(s) = h."""
    return float(0.5 - np.sin(np.arcsin(1.0 - 2.0 * min(max(h, 0.0), 1.0)) / 3.0))
