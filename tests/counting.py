"""Counts that do not depend on the load of the machine: operations of a call, reversals of torques."""

from __future__ import annotations

import sys
from collections.abc import Callable
from types import FrameType
from typing import Any

import numpy as np


def calls(function: Callable[..., Any], *given: Any) -> int:
    """Count the Python and C functions that one call of a function calls, itself included."""
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


def reversals(torques: Any, least: Any, dt: float) -> float:
    """Return how often a second torques ``(ticks, n)`` of the worst joint turn, by changes above ``least`` ``(n,)``."""
    most = 0
    for change, size in zip(np.diff(torques, axis=0).T, least, strict=True):
        large = change[np.abs(change) > size]
        most = max(most, int(np.sum(large[1:] * large[:-1] < 0.0)))
    return most / (dt * len(torques))
