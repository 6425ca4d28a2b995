"""References that fit no element."""

from __future__ import annotations

from collections.abc import Iterable
from typing import NoReturn

from hqp.declare.reference import Reference
from hqp.errors import DeclarationError, UnknownReference, closest


def refuse(reference: object, names: Iterable[str]) -> NoReturn:
    """Raise DeclarationError if it is no Reference, UnknownReference if the stack lacks its element."""
    if not isinstance(reference, Reference):
        raise DeclarationError("step", "not a Reference", value=reference, allowed="element.at(...)")
    near = ", ".join(closest(reference.name, names) or list(names)[:3])
    raise UnknownReference(f"the stack has no element {reference.name!r} for this reference; closest: {near}")
