"""Contacts that the stack assumes and that are not there: measured loads against what every tick takes for granted."""

from __future__ import annotations

from collections.abc import Iterable

from hqp.declare.element import Constraint, Element
from hqp.errors import DeclarationError

LEAST_LOAD = 1.0
"""A contact that carries less than this is not there [N]."""

PATIENCE = 0.02
"""For how long it has to carry less before it counts as lost [s]: a wheel on rollers bounces for a few ticks."""


class ContactWatch:
    """Counts the ticks for which each contact has carried less than LEAST_LOAD, by the loads given for it.

    A contact without a measured load is not judged, and one whose load is missing for a tick keeps its count.
    """

    def __init__(self, stack: Iterable[Element], dt: float) -> None:
        elements = tuple(stack)
        self._ticks = {
            e.name: 0 for e in elements if isinstance(e, Constraint) and e.equality and e.quantity == "motion"
        }
        self._patience = max(1, round(PATIENCE / dt))
        self._dt = dt
        self._names = frozenset(e.name for e in elements)
        self._out: frozenset[str] = frozenset()
        self.missing: set[str] = set()
        """Names of contacts that carried nothing when last measured."""

    def measure(self, name: str, load: float) -> None:
        """Take a load [N]; raises DeclarationError for an element that is no contact."""
        if name not in self._names:
            return  # of no element: the session tells
        if name not in self._ticks:
            allowed = ", ".join(self._ticks) or "a contact; the stack has none"
            raise DeclarationError(name, "a load was given for what is no contact", value=load, allowed=allowed)
        if name in self._out:
            return
        if load < LEAST_LOAD:
            self._ticks[name] += 1
            self.missing.add(name)
        elif load >= LEAST_LOAD:  # a NaN is neither
            self._ticks[name] = 0
            self.missing.discard(name)

    def judge(self, out: frozenset[str]) -> None:
        """Contacts that are out of the tick are not judged: nothing assumes them."""
        for name in self._ticks:
            if name in out:
                self._ticks[name] = 0
                self.missing.discard(name)
        self._out = out

    def lost(self) -> list[tuple[str, str]]:
        """Names of contacts that are not there, with what was measured."""
        return [
            (name, f"has carried less than {LEAST_LOAD:g} N for {1e3 * ticks * self._dt:.0f} ms, by the loads given")
            for name, ticks in self._ticks.items()
            if ticks >= self._patience
        ]
