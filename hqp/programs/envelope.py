"""Native checks of states and commands, shared by Python and C++ (hqp/cpp/session): without it there is no session."""

from __future__ import annotations

from typing import Any

from hqp.errors import HqpError
from hqp.native import ADVICE, missing

try:
    from hqp import _session
except ImportError:  # no compiler was there
    native: Any = None
else:
    native = _session
"""StateBounds, RateLimiter, Budget, Outgoing, SlowDown, Brake and Hold."""


def require_compiled() -> None:
    """Raise HqpError where a part was not compiled: a session needs them all."""
    if gone := missing():
        raise HqpError(f"a session needs the compiled parts of hqp; missing: {', '.join(gone)}. {ADVICE}")
