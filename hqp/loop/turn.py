"""One thread at a time in a session; after an interrupt anywhere in a call a thread may continue."""

from __future__ import annotations

import sys
from collections.abc import Callable
from threading import get_ident
from types import FrameType
from typing import TypeAlias, TypeVar

from hqp.errors import ConcurrentUse

T = TypeVar("T")

Turn: TypeAlias = "dict[None, int]"
"""Thread in the session.  ``setdefault`` takes the turn, atomically, in a ``try`` whose end returns it.

It holds the thread's number, so that a thread recognises its own turn if an interrupt kept it from being returned.
"""


def require(turn: Turn, session: object) -> None:
    """Raise ConcurrentUse where another thread has the turn, or this one in a call of the session under way."""
    if turn.get(None, me := get_ident()) != me:
        raise ConcurrentUse(
            "another thread uses this session: make one session per thread, each on its own robot.copy()"
        )
    outside = False
    frame: FrameType | None = sys._getframe(2)
    while frame is not None:
        mine = frame.f_locals.get("self") is session
        if mine and outside:
            raise ConcurrentUse("a call of this session is under way: do not call the session from inside it")
        outside, frame = outside or not mine, frame.f_back


def alone(turn: Turn, session: object, what: Callable[[], T]) -> T:
    """Call a function without another thread in the session, and return its result."""
    me = get_ident()
    if turn:
        require(turn, session)
    try:
        if turn.setdefault(None, me) != me:
            require(turn, session)
        return what()
    finally:
        if turn.get(None) == me:
            turn.clear()
