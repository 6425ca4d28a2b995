"""Laws that hold in a phase: the demand of an element goes over to that of its new law.

    b = (1 - s) b_old + s b_new,     s from 0 to 1 in a straight line, in 1/k seconds

k [1/s] is how fast the stiffer of the two laws is, its gain, or max(sqrt(kp), kd / 2).  So the switch changes what is
asked by no more than k |b_new - b_old| a second: no faster than the stiffer law changes it by itself while it closes
the error.  An element that was out has its law at once.  Nothing is compiled.
"""

from __future__ import annotations

from collections.abc import Container, Mapping
from typing import TYPE_CHECKING

import numpy as np

from hqp.arrays import Vec
from hqp.declare.law import Law, pace

if TYPE_CHECKING:
    from hqp.loop.line import Guards
    from hqp.programs.assembly import Assembly


class Way:
    """From laws, each by a share, to one."""

    __slots__ = ("age", "former", "law", "pace")

    def __init__(self, law: Law, former: Mapping[Law, Vec]) -> None:
        self.law, self.former, self.age = law, former, 0.0
        self.pace = np.max(np.broadcast_arrays(*(np.asarray(pace(each)) for each in (law, *former))), axis=0)
        """[1/s], of each row or of all."""

    def go_on(self, dt: float) -> dict[Law, Vec]:
        """The shares of former laws dt [s] later; none at the end."""
        self.age += dt
        left = np.where(self.pace > 0.0, 1.0 - np.minimum(1.0, self.age * self.pace), 0.0)
        return {law: left * share for law, share in self.former.items() if law != self.law} if left.any() else {}


class PhaseLaws:
    """The laws of one assembly on their way to those of a phase."""

    __slots__ = ("_asked", "_assembly", "_count", "_ways")

    def __init__(self, assembly: Assembly) -> None:
        self._assembly = assembly
        self._asked: Mapping[str, Law] = {}
        self._count = -1
        self._ways: dict[str, Way] = {}

    def obey(self, laws: Mapping[str, Law], idle: Container[str], guards: Guards) -> None:
        """The laws of the next tick, asked for once or more in it.

        laws: by element, of the phase; all others have their declared ones.  idle: elements that were out so far.
        """
        if laws is not self._asked:
            self._aim(laws, idle)
        if self._ways and guards.count != self._count:
            self._count = guards.count
            for name, way in tuple(self._ways.items()):
                shares = way.go_on(guards.dt)
                self._assembly.take_law(name, way.law, shares)
                if not shares:
                    del self._ways[name]

    def _aim(self, laws: Mapping[str, Law], idle: Container[str]) -> None:
        members = self._assembly.members
        for name in {**self._asked, **laws}:
            member = members.get(name)
            if member is None or member.law is None or member.declared is None:
                continue
            new = laws.get(name, member.declared)
            if name in idle:
                self._ways.pop(name, None)
                self._assembly.take_law(name, new)
            elif new != member.law or member.others:
                left = 1.0 - sum(member.others.values(), np.zeros(1))
                self._ways[name] = Way(new, {**member.others, member.law: left})
        self._asked = laws
