"""Contacts that the stack assumes and that are not there, by measured loads (hqp/cpp/session/contact_watch.hpp)."""

from __future__ import annotations

from typing import TYPE_CHECKING

from hqp.declare.element import Constraint, Element
from hqp.declare.stack import Stack
from hqp.errors import DeclarationError

if TYPE_CHECKING:
    from hqp._session import ContactWatch


def assumed(element: Element) -> bool:
    """Whether every tick takes for granted that something bears the element."""
    return isinstance(element, Constraint) and element.equality and element.quantity == "motion"


def measure(watch: ContactWatch, stack: Stack, name: str, load: float) -> None:
    """Take a load [N]; raises DeclarationError for an element that is no contact."""
    if not watch.measure(name, load) and name in stack:  # what is no element the session tells
        allowed = ", ".join(watch.names) or "a contact of the stack, which has none"
        raise DeclarationError(name, "not a contact: it takes no measured load", value=load, allowed=allowed)
