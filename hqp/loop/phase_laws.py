"""Laws that hold in a phase: the demand of an element goes over to that of its new law; nothing is compiled.

An element that was out has its law at once.  hqp/cpp/rows/law_change.hpp has the rule.
"""

from __future__ import annotations

from collections.abc import Container, Mapping, Sequence
from typing import TYPE_CHECKING, Any

from hqp.declare.law import Law
from hqp.programs.assembly import rows_law

if TYPE_CHECKING:
    from hqp.programs.assembly import Assembly


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


def parts(assembly: Assembly, laws: Mapping[str, Mapping[str, Law]], phases: Sequence[str]) -> list[dict[str, Any]]:
    """For a file: elements with laws of phases, all laws of each, the declared one first, and which holds in which."""
    found = []
    for name in dict.fromkeys(name for of in laws.values() for name in of):
        member = assembly.members[name]
        by_phase = [laws.get(phase, {}).get(name, member.declared) for phase in phases]
        every = [law for law in dict.fromkeys((member.declared, *by_phase)) if law is not None]
        numbers = [rows_law(law, member.part.stop - member.part.start) for law in every]
        found.append({"name": name, "laws": numbers, "of": [every.index(law) for law in by_phase if law is not None]})
    return found
