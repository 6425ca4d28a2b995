"""Values of declarations by kind."""

from __future__ import annotations

import os
from collections.abc import Sequence
from pathlib import Path
from typing import Any

from hqp.errors import DeclarationError


def require(owner: str, field: str, value: object, kind: type | tuple[type, ...], allowed: str) -> None:
    """Raise DeclarationError for a value of another type."""
    if not isinstance(value, kind):
        raise DeclarationError(owner, f"bad {field}", value=_given(value), allowed=allowed)


def require_robot(owner: str, robot: object) -> None:
    """Raise DeclarationError for anything but a robot."""
    if not hasattr(robot, "actuated"):
        raise DeclarationError(owner, "bad robot", value=_given(robot), allowed="a robot of hqp.robots.load")


def require_state(owner: str, state: object) -> None:
    """Raise DeclarationError for anything but a state."""
    if not hasattr(state, "finite"):
        raise DeclarationError(owner, "not a State", value=_given(state), allowed="robot.state(q, v)")


def names(owner: str, field: str, given: Any, allowed: str) -> tuple[str, ...]:
    """Return a sequence of names; raises DeclarationError for anything else, also for a single one."""
    if isinstance(given, str) or not isinstance(given, Sequence) or not all(isinstance(name, str) for name in given):
        raise DeclarationError(owner, f"bad {field}", value=_given(given), allowed=allowed)
    return tuple(given)


def file_path(owner: str, given: Any) -> Path:
    """Return the path of a file; raises DeclarationError for another kind."""
    require(owner, "path", given, (str, os.PathLike), "a path, str or os.PathLike")
    return Path(given)


def file_bytes(owner: str, given: Any) -> bytes:
    """Return the bytes of a file that ``export`` has written; raises DeclarationError if it cannot be read."""
    path = file_path(owner, given)
    try:
        return path.read_bytes()
    except OSError as error:
        allowed = "a file that export has written"
        raise DeclarationError(owner, f"no file: {error.strerror}", value=str(path), allowed=allowed) from error


def _given(value: object) -> object:
    """Return the value as an error shows it, which leaves None out."""
    return "None" if value is None else value
