"""The references of a tick: those that were given, and hold values for all other elements."""

from __future__ import annotations

from collections.abc import Iterable, Mapping
from typing import NoReturn

from hqp.declare.element import Element
from hqp.declare.reference import Reference, copied
from hqp.declare.robot import State
from hqp.declare.stack import Stack
from hqp.errors import DeclarationError, UnknownReference, closest
from hqp.explanation.notes import Note
from hqp.problem import Status
from hqp.programs.assembly import OWN
from hqp.programs.formulation import Program


class References:
    """One reference an element, good for one tick; what cannot be used is left out by name.

    holds: hold values.  current: what this tick takes.  given: those of ``current`` that the caller gave.  without: why
    an element of the user's own has no hold value; it is asked again every tick, and left out until it has one.
    """

    __slots__ = ("current", "given", "holds", "without")

    def __init__(self, holds: Mapping[str, Reference]) -> None:
        self.holds = dict(holds)
        self.current: dict[str, Reference] = {}
        self.given: list[Reference] = []
        self.without: dict[str, str] = {}

    def take_holds(self, stack: Stack, state: State) -> None:
        """Hold values of elements that have none yet, at the first step or after a change of stack."""
        self.without = {}
        for element in stack:
            if element.name not in self.holds:
                self._take_hold(element, state)
        self.current = {element.name: self._held(element.name) for element in stack}

    def renew(self, element: Element, state: State) -> None:
        """A fresh hold value for an element that comes back; the former one stays if taking it raises."""
        former = self.holds.pop(element.name, None)
        self.without.pop(element.name, None)
        try:
            self._take_hold(element, state)
        except BaseException:
            if former is not None:
                self.holds[element.name] = former
            raise
        self.current[element.name] = self._held(element.name)

    def put(self, held: Iterable[Reference]) -> None:
        """Fresh hold values that native code took."""
        for each in held:
            self.holds[each.name] = self.current[each.name] = each

    def _held(self, name: str) -> Reference:
        return self.holds.get(name) or Reference(name)

    def _take_hold(self, element: Element, state: State) -> None:
        try:
            held: object = element.hold(state)
        except Exception as error:
            if type(element).__module__.startswith(OWN):
                raise
            self.without[element.name] = f"its hold value raised {type(error).__name__}: {error}"
            return
        if isinstance(held, Reference):
            self.holds[element.name] = copied(held)
        else:
            self.without[element.name] = f"its hold value must be a Reference, given {type(held).__name__}"

    def lacking(self) -> tuple[str, ...]:
        """Elements that have neither a hold value nor a reference in this tick."""
        return tuple(name for name in self.without if self.current[name].value is None) if self.without else ()

    def apply(self, references: tuple[Reference, ...]) -> None:
        """Put this tick's references in place of the hold values; raises UnknownReference, DeclarationError."""
        current = self.current
        for old in self.given:
            current[old.name] = self._held(old.name)
        self.given = []
        for reference in references:
            if not isinstance(reference, Reference) or reference.name not in current:
                refuse(reference, current)
            name = reference.name
            held = self._held(name).value
            if reference.value is None:
                reference = reference.aiming_at(held)
            elif held is not None and reference.value.shape != held.shape:
                given = reference.value.shape
                raise DeclarationError(name, f"value has shape {given}", allowed=f"shape {held.shape}")
            self.given.append(reference)  # first: wherever this ends, the next tick takes the hold value back
            current[name] = reference

    def repair(
        self, program: Program, hard: frozenset[str], state: State, unusable: tuple[str, ...]
    ) -> tuple[Note, ...]:
        """Refill without what cannot be used: hold values for members of ``subject_to``, free rows for all others."""
        given = {reference.name for reference in self.given}
        for name, error in program.errors.items():
            if name in given and isinstance(error, DeclarationError) and self._held(name).value is None:
                raise error  # a reference of the wrong length, which only the element could tell
        wrong = tuple(name for name in unusable if name in given and not self.current[name].finite)
        notes = []
        for name in wrong:
            self.current[name] = self._held(name)
        self.given = [reference for reference in self.given if reference.name not in wrong]
        broken = unusable
        out = tuple(name for name in wrong if name not in hard)
        if wrong:
            program.fill(state, self.current, self.given)
            broken = tuple(dict.fromkeys(program.unusable() + self.lacking()))
        for name in wrong:
            done = "left out of this tick" if name in out or name in broken else "its hold value is used instead"
            notes.append(Note(name, Status.INVALID_REFERENCE, f"its reference is not finite: {done}"))
        for name in broken:
            if name not in wrong:
                reason = self.without.get(name) or program.reason(name)
                notes.append(Note(name, Status.INVALID_ELEMENT, f"{reason}: left out of this tick"))
        left_out = dict.fromkeys((*out, *broken))
        if left_out:
            program.fill(state, self.current, self.given, tuple(left_out))
        return tuple(notes)


def refuse(reference: object, names: Iterable[str]) -> NoReturn:
    """Raise DeclarationError for what is no reference, UnknownReference for one of an element that is not there."""
    if not isinstance(reference, Reference):
        raise DeclarationError("step", "not a Reference", value=reference, allowed="element.at(...)")
    near = ", ".join(closest(reference.name, names) or list(names)[:3])
    raise UnknownReference(f"the stack has no element {reference.name!r} for this reference; closest: {near}")
