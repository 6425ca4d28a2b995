"""Presence of elements in a tick, and their laws in a phase.

An element that was out has its law at once.  hqp/cpp/rows/law_change.hpp has the rule.
"""

from __future__ import annotations

from collections.abc import Container, Mapping, Sequence
from typing import TYPE_CHECKING, Any

from hqp.declare.element import Element
from hqp.declare.law import Law
from hqp.errors import DeclarationError, closest
from hqp.programs.assembly import rows_law

if TYPE_CHECKING:
    from hqp.declare.stack import Stack
    from hqp.programs.assembly import Assembly
    from hqp.programs.formulation import Program


class Presence:
    """The sets of elements that are out by phase; hqp/cpp/session/presence.hpp has the rule of a tick.

    known: by phase, None for none.  Raises DeclarationError for a phase of the stack in which constraints and actuators
    do not determine the motion.
    """

    __slots__ = ("_declared", "_members", "_program", "known")

    def __init__(self, stack: Stack, program: Program) -> None:
        self._program = program
        self._members = {element.name: element for element in stack}
        self._declared = {phase: stack.out_of(phase) for phase in (None, *stack.phases())}
        self.known: dict[str | None, frozenset[str]] = {}
        for phase, declared in self._declared.items():
            self.known[phase] = out = self._followed(declared)
            if phase is not None and (why := program.refuses(out)):
                raise DeclarationError(f"phase {phase}", why, allowed="contacts that determine the motion")

    @property
    def phases(self) -> tuple[str, ...]:
        """The phases that the stack names."""
        return tuple(phase for phase in self.known if phase is not None)

    @property
    def parts(self) -> dict[str, Any]:
        """Data for a file: elements off in each phase, first without a phase, and which elements depend on which."""
        declared = [{"name": phase or "", "out": sorted(out)} for phase, out in self._declared.items()]
        return {"phases": declared, "follows": [f for e in self._members.values() if (f := self._follower(e))]}

    def _follower(self, element: Element) -> dict[str, Any] | None:
        """Elements that switch this one off, any one of them or all together."""
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

    def supported(self, out: frozenset[str]) -> tuple[list[str], list[str], str] | None:
        """Elements of it that may be off, contacts that must stay, and the reason; None if all may be off."""
        if not (why := self._program.refuses(out)):
            return None
        stay = [name for name in self._members if name in out and self._members[name].is_contact]
        rest = self._followed(frozenset(n for n in out if n not in stay and not self._members[n].goes_with(out)))
        return sorted(rest), stay, f"{why}: it stays active"

    def _followed(self, out: frozenset[str]) -> frozenset[str]:
        """Add dependent elements; returns the same object for equal sets."""
        found = out | {name for name, element in self._members.items() if element.goes_with(out)}
        return next((known for known in self.known.values() if known == found), found)


class PhaseLaws:
    """The laws of one assembly on their way to those of a phase."""

    __slots__ = ("_assembly",)

    def __init__(self, assembly: Assembly) -> None:
        self._assembly = assembly

    def obey(self, laws: Mapping[str, Law], out: Container[str] | None) -> None:
        """These laws from now on, of all other elements the declared ones; out: elements that were out of the tick
        before, None before the first."""
        for name, member in self._assembly.members.items():
            if member.declared is not None and (name in laws or member.laws):
                law = laws.get(name, member.declared)
                self._assembly.take_law(name, law, at_once=out is None or name in out)


def phase_law_parts(
    assembly: Assembly, laws: Mapping[str, Mapping[str, Law]], phases: Sequence[str]
) -> list[dict[str, Any]]:
    """For a file: elements with laws of phases, all laws of each, the declared one first, and which holds in which."""
    found = []
    for name in dict.fromkeys(name for of in laws.values() for name in of):
        member = assembly.members[name]
        by_phase = [laws.get(phase, {}).get(name, member.declared) for phase in phases]
        every = [law for law in dict.fromkeys((member.declared, *by_phase)) if law is not None]
        numbers = [rows_law(law, member.part.stop - member.part.start) for law in every]
        found.append({"name": name, "laws": numbers, "of": [every.index(law) for law in by_phase if law is not None]})
    return found
