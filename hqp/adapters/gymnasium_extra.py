"""The one place where gymnasium, an optional extra, is imported."""

from __future__ import annotations

from hqp.errors import HqpError

try:
    import gymnasium  # pyright: ignore[reportMissingImports]
except ImportError as error:
    raise HqpError(f"this adapter needs {error.name}, which is not installed: pip install 'hqp[gym]'") from error

__all__ = ["gymnasium"]
