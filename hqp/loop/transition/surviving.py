"""Hold values that are good for another stack, and contacts that it does not have."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import fields, is_dataclass

from hqp.declare.element import Element
from hqp.declare.reference import Reference
from hqp.declare.stack import Stack


def surviving(before: Stack, after: Stack) -> tuple[str, ...]:
    """Names of the elements of a stack that another one has with the same hold value."""
    return tuple(e.name for e in after if e.name in before and same_quantity(e, before.find(e.name)))


def surviving_holds(before: Stack, holds: Mapping[str, Reference], after: Stack) -> dict[str, Reference]:
    """The hold values of one stack that are good for another."""
    return {name: holds[name] for name in surviving(before, after) if name in holds}


def same_quantity(one: Element, other: Element) -> bool:
    """Return true if hold values are interchangeable: class and all fields except name, law, weight and when agree."""
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
