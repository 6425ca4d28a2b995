"""One BLAS thread while solvers are timed: threads that wait for each other cost milliseconds a tick."""

from __future__ import annotations

from contextlib import AbstractContextManager
from typing import Any

from hqp.errors import HqpError


def one_thread() -> AbstractContextManager[Any]:
    """Limit BLAS to one thread inside a ``with``; raises HqpError without the extra ``lab``."""
    try:
        import rich  # noqa: F401  # of the tables that follow: fail before minutes of work, not after
        from threadpoolctl import threadpool_limits
    except ImportError as error:
        raise HqpError(f"compare and bench need {error.name}: pip install 'hqp[lab]'") from error
    limits: AbstractContextManager[Any] = threadpool_limits(limits=1)
    return limits
