"""What a tick says of an element that was not served as declared."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass
from typing import TypeAlias

from hqp.problem import Status

Notes: TypeAlias = "tuple[Note, ...] | Callable[[], tuple[Note, ...]]"
"""Notes, or what makes them."""


@dataclass(frozen=True, slots=True)
class Note:
    """What went wrong with which element."""

    element: str
    status: Status
    detail: str


def made(notes: Notes) -> tuple[Note, ...]:
    """The notes themselves."""
    return notes() if callable(notes) else notes


def added(notes: Notes, more: Notes) -> Notes:
    """Those notes and some more, without making their texts."""
    if not notes:
        return more
    if callable(notes) or callable(more):
        return lambda: (*made(notes), *made(more))
    return (*notes, *more)
