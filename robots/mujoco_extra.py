"""The one place where MuJoCo, an optional extra, is imported."""

from __future__ import annotations

from hqp.errors import ModelError

try:
    import mujoco
except ImportError as error:
    raise ModelError("the plant needs MuJoCo, which is not installed: pip install 'hqp[mujoco]'") from error

__all__ = ["mujoco"]
