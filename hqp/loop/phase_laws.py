"""Laws that hold in a phase: the demand of an element goes over to that of its new law.

    b = (1 - s) b_old + s b_new,     s from 0 to 1 in a straight line, in 1/k seconds

k [1/s] is how fast the stiffer of the two laws is, its gain, or max(sqrt(kp), kd / 2).  So the switch changes what is
asked by no more than k |b_new - b_old| a second: no faster than the stiffer law changes it by itself while it closes
the error.  An element that was out has its law at once.  Nothing is compiled.
"""

from __future__ import annotations

from collections.abc import Container, Mapping, Sequence
from typing import TYPE_CHECKING, Any

import numpy as np

from hqp.arrays import Vec
from hqp.declare.law import Law, pace
from hqp.programs.assembly import gains, holds, of_rows

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
        self._asked: Mapping[str, Law] | None = None
        self._count = -1
        self._ways: dict[str, Way] = {}

    def obey(self, guards: Guards, out: Container[str] | None) -> None:
        """The laws of this tick, asked for once or more in it; out: elements that were out of the one before, if any.

        Those of ``guards.laws``, of all other elements the declared ones.
        """
        if guards.laws is not self._asked:
            self._aim(guards.laws or {}, self._assembly.members if out is None else out)
            self._asked = guards.laws
        if self._ways and guards.count != self._count:
            self._count = guards.count
            for name, way in tuple(self._ways.items()):
                shares = way.go_on(guards.dt)
                self._assembly.take_law(name, way.law, shares)
                if not shares:
                    del self._ways[name]

    def _aim(self, laws: Mapping[str, Law], idle: Container[str]) -> None:
        members = self._assembly.members
        for name in {**(self._asked or {}), **laws, **self._ways}:
            member = members.get(name)
            if member is None or member.law is None or member.declared is None:
                continue
            new = laws.get(name, member.declared)
            if name in idle:
                self._ways.pop(name, None)
                self._assembly.take_law(name, new)
            elif new != (self._ways[name].law if name in self._ways else member.law):
                left = 1.0 - sum(member.others.values(), np.zeros(1))
                self._ways[name] = Way(new, {**member.others, member.law: left})


def parts(assembly: Assembly, laws: Mapping[str, Mapping[str, Law]], phases: Sequence[str]) -> list[dict[str, Any]]:
    """For a file: elements with laws of phases, all laws of each, the declared one first, and which holds in which."""
    found = []
    for name in dict.fromkeys(name for of in laws.values() for name in of):
        member = assembly.members[name]
        by_phase = [laws.get(phase, {}).get(name, member.declared) for phase in phases]
        every = [law for law in dict.fromkeys((member.declared, *by_phase)) if law is not None]
        numbers = [_numbers(law, member.part.stop - member.part.start) for law in every]
        found.append({"name": name, "laws": numbers, "of": [every.index(law) for law in by_phase if law is not None]})
    return found


def _numbers(law: Law, rows: int) -> dict[str, Any]:
    kp, kd = gains(law)
    by_row = {"kp": kp, "kd": kd, "pace": pace(law)}
    return {"held": holds(law), **{name: of_rows(value, rows) for name, value in by_row.items()}}
