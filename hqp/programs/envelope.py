"""The native session (hqp/cpp/session), which every session in Python needs."""

from __future__ import annotations

from typing import Any

from hqp.errors import HqpError
from hqp.native import ADVICE, missing

try:
    from hqp import _session
except ImportError:  # built without a compiler
    native: Any = None
else:
    native = _session
"""Sessions, rate limits and watches; None if they are not compiled."""


def require_compiled() -> None:
    """Raise HqpError if a native part is not compiled: a session needs them all."""
    if gone := missing():
        raise HqpError(f"a session needs the compiled parts of hqp; missing: {', '.join(gone)}. {ADVICE}")
