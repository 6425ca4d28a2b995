"""What a call does, as counts: the same on a busy machine and on a quiet one."""

from __future__ import annotations

import sys
from collections.abc import Callable
from types import FrameType
from typing import Any


def calls(function: Callable[..., Any], *given: Any) -> int:
    """How many functions of Python and of C one call of a function calls, itself included."""
    counted = 0

    def count(frame: FrameType, event: str, argument: Any) -> None:
        nonlocal counted
        counted += event in ("call", "c_call")

    sys.setprofile(count)
    try:
        function(*given)
    finally:
        sys.setprofile(None)
    return counted - 1  # setprofile itself
