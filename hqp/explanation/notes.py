"""Notes of a tick on elements that were not served as declared."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass
from typing import TypeAlias

from hqp.problem import Status

STATUSES = tuple(Status)
"""By the number that native code has for each."""

Notes: TypeAlias = "tuple[Note, ...] | Callable[[], tuple[Note, ...]]"
"""Notes, or a function that makes them."""


@dataclass(frozen=True, slots=True)
class Note:
    """Problem of one element."""

    element: str
    status: Status
    detail: str


def of_native(records: Sequence[tuple[str, int, str]]) -> tuple[Note, ...]:
    """Notes of elements, the number of a status and a text."""
    return tuple([Note(element, STATUSES[status], text) for element, status, text in records])


def made(notes: Notes) -> tuple[Note, ...]:
    """The notes themselves."""
    return notes() if callable(notes) else notes


def added(notes: Notes, more: Notes) -> Notes:
    """Append notes without making their texts."""
    if not notes:
        return more
    if callable(notes) or callable(more):
        return lambda: (*made(notes), *made(more))
    return (*notes, *more)
