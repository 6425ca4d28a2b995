"""Which elements are in a tick: by its phase, by references that say so, and by the contacts that they go with."""

from __future__ import annotations

from collections.abc import Sequence
from typing import TYPE_CHECKING, Any

from hqp.declare.element import Element
from hqp.errors import DeclarationError, closest
from hqp.explanation.notes import Note
from hqp.problem import Status

if TYPE_CHECKING:
    from hqp.declare.reference import Reference
    from hqp.declare.stack import Stack
    from hqp.programs.formulation import Program

NOTHING_ELSE = frozenset({"name", "on", "load"})
"""What a reference has that says no more than whether its element is in."""


class Presence:
    """The sets of elements that are out, each known once it was asked for.

    known: by phase, None for none.  now: those that were out in the latest tick, None before it.  usual: those of no
    phase.  Raises DeclarationError for a phase of the stack in which constraints and actuators do not determine the
    motion.
    """

    __slots__ = ("_declared", "_members", "_program", "_sets", "known", "now", "usual")

    def __init__(self, stack: Stack, program: Program) -> None:
        self._program = program
        self._members = {element.name: element for element in stack}
        self._sets: dict[Any, frozenset[str]] = {}
        self._declared = {phase: stack.out_of(phase) for phase in (None, *stack.phases())}
        self.known: dict[str | None, frozenset[str]] = {}
        for phase, declared in self._declared.items():
            self.known[phase] = out = self._followed(declared)
            if phase is not None and (why := program.refuses(out)):
                raise DeclarationError(f"phase {phase}", why, allowed="contacts that determine the motion")
        self.now: frozenset[str] | None = None
        self.usual = self.known[None]

    def member(self, name: str) -> Element:
        """The element of that name."""
        return self._members[name]

    def marks(self, out: frozenset[str]) -> tuple[bool, ...]:
        """Of each element whether it is one of these."""
        return tuple([name in out for name in self._members])

    def back(self, out: frozenset[str]) -> tuple[str, ...]:
        """Elements with a hold value that come back where these are out now."""
        gone = () if self.now is None else self.now - out
        return tuple(n for n, e in self._members.items() if n in gone and type(e).hold is not Element.hold)

    @property
    def phases(self) -> tuple[str, ...]:
        """The phases that the stack names."""
        return tuple(phase for phase in self.known if phase is not None)

    @property
    def parts(self) -> dict[str, Any]:
        """For a file: who is out in each phase, the first of them none, and which elements go with which."""
        declared = [{"name": phase or "", "out": sorted(out)} for phase, out in self._declared.items()]
        return {"phases": declared, "follows": [f for e in self._members.values() if (f := self._follower(e))]}

    def _follower(self, element: Element) -> dict[str, Any] | None:
        """Which elements, any one of them or all together, take this one with them."""
        names = [name for name in self._members if name != element.name]
        if alone := [name for name in names if element.goes_with({name})]:
            return {"name": element.name, "every": False, "of": alone}
        if not element.goes_with(set(names)):
            return None
        needed = [name for name in names if not element.goes_with(set(names) - {name})]
        return {"name": element.name, "every": True, "of": needed}

    def require(self, phase: str | None) -> None:
        """Raise DeclarationError for a phase that the stack does not name."""
        if phase not in self.known:
            near = (
                ", ".join(closest(str(phase), self.phases) or self.phases) or "none, no element of the stack has a when"
            )
            raise DeclarationError("phase", "unknown phase", value=phase, allowed=near)

    def of(self, phase: str | None, references: Sequence[Reference]) -> frozenset[str]:
        """Names of the elements that are out; the same object for the same set."""
        if phase not in self.known:
            phase = None
        said = tuple([(r.name, r.on) for r in references if getattr(r, "on", None) is not None])
        if not said:
            return self.known[phase]
        key = phase, said
        if key not in self._sets:
            off, on = (self._named(said, what) for what in (False, True))
            self._sets[key] = self._followed((self._declared[phase] | off) - on)
        return self._sets[key]

    def supported(self, out: frozenset[str]) -> tuple[frozenset[str], tuple[Note, ...]]:
        """What of it may be out, with notes on contacts that have to stay."""
        if not (why := self._program.refuses(out)):
            return out, ()
        stay = [name for name in self._members if name in out and self._members[name].is_contact]
        rest = self._followed(frozenset(n for n in out if n not in stay and not self._members[n].goes_with(out)))
        return rest, tuple(Note(name, Status.INVALID_REFERENCE, f"{why}: it stays active") for name in stay)

    def spoken(self, references: Sequence[Reference], out: frozenset[str]) -> tuple[Reference, ...]:
        """The references of elements that are in which say more than that."""
        return tuple([r for r in references if getattr(r, "name", None) not in out and not self._silent(r)])

    def _silent(self, reference: Reference) -> bool:
        on = getattr(reference, "on", None)
        return on is not None and reference.name in self._members and vars(reference).keys() <= NOTHING_ELSE

    def _named(self, said: Sequence[tuple[str, bool | None]], which: bool) -> set[str]:
        names = {name for name, on in said if on is which and name in self._members}
        for name in names:
            if self._members[name].quantity == "load":
                raise DeclarationError(name, "a load has no rows, so on() does not apply", allowed="at(...) with zeros")
        return names

    def _followed(self, out: frozenset[str]) -> frozenset[str]:
        """With the elements that go with them; the same object for the same set."""
        found = out | {name for name, element in self._members.items() if element.goes_with(out)}
        return next((known for known in self.known.values() if known == found), found)
