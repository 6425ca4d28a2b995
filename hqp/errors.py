"""All exceptions of the library; in the control loop failures are statuses, not exceptions."""

from __future__ import annotations

import difflib
from collections.abc import Iterable
from typing import Any


class HqpError(Exception):
    """Root of every exception raised by hqp."""


class DeclarationError(HqpError, ValueError):
    """A task, constraint, law, level, stack or option was declared with something that is not allowed."""

    def __init__(self, element: str, message: str, *, value: object = None, unit: str = "", allowed: str = "") -> None:
        self.element, self.value, self.unit, self.allowed = element, value, unit, allowed
        text = f"{element}: {message}"
        if value is not None:
            text += f" (given {_shown(value)}{' ' + unit if unit else ''})"
        if allowed:
            text += f"; allowed: {allowed}"
        super().__init__(text)


class ProblemError(HqpError, ValueError):
    """Rows or a hierarchy are not well formed: shapes, non-finite numbers, lower above upper."""


class ModelError(HqpError):
    """A robot model lacks a requested part, or cannot be loaded."""


class ModelWarning(UserWarning):
    """Something in a robot's file is taken otherwise than it may be meant; the message names joint or link."""


class FrameNotFound(ModelError, KeyError):
    """A frame name is unknown to the robot; the message names the closest ones."""

    def __init__(self, name: str, known: Iterable[str], robot: str = "robot") -> None:
        super().__init__(_not_found("frame", name, known, robot))

    __str__ = Exception.__str__


class JointNotFound(ModelError, KeyError):
    """A joint or group name is unknown to the robot; the message names the closest ones."""

    def __init__(self, name: str, known: Iterable[str], robot: str = "robot") -> None:
        super().__init__(_not_found("joint or group", name, known, robot))

    __str__ = Exception.__str__


class NetworkWarning(UserWarning):
    """The viewer's page is open to the network."""


class ConfigurationNotFound(ModelError, KeyError):
    """A robot has no configuration of that name; the message names the closest ones."""

    def __init__(self, name: str, known: Iterable[str], robot: str = "robot") -> None:
        super().__init__(_not_found("configuration", name, known, robot))

    __str__ = Exception.__str__


class PurePythonWarning(UserWarning):
    """hqp was installed without its compiled parts; HQP_PURE=1 in the environment silences it."""


class StaleState(ModelError):
    """A state was used after its robot had moved on to another one."""


class DynamicsFailed(ModelError):
    """The equations of motion of a state cannot be solved; in the control loop it becomes a status."""


class ConcurrentUse(HqpError, RuntimeError):
    """Two threads were in one session or workspace at a time."""


class UnknownReference(HqpError, KeyError):
    """A reference was given for an element that the stack does not hold."""

    __str__ = Exception.__str__


class SolverError(HqpError):
    """A solver is missing, unfit for a problem, or failed."""


class SolverNotInstalled(SolverError, ImportError):
    """A solver's package is not installed; the message holds the pip line."""


class UnsupportedProblem(SolverError, ValueError):
    """A solver lacks a capability that the problem needs."""


class BackendError(SolverError, RuntimeError):
    """A third-party back end raised; the original exception is the cause."""


class NotSolved(SolverError, RuntimeError):
    """Raised by ``unwrap``: the status was not acceptable; ``problem`` is a copy of the problem."""

    def __init__(self, message: str, problem: Any = None) -> None:
        super().__init__(message)
        self.problem = problem


def closest(name: str, known: Iterable[str], count: int = 3) -> list[str]:
    """The ``count`` known names nearest to ``name``, best first, regardless of case."""
    names = list(known)
    by_lower = {k.lower(): k for k in names}
    near = difflib.get_close_matches(str(name).lower(), by_lower, n=count, cutoff=0.4)
    return [by_lower[k] for k in near]


def _shown(value: object, most: int = 200) -> str:
    """Given value, shortened; some values cannot even be printed (an integer of 5000 digits)."""
    try:
        text = repr(value)
    except Exception:
        return f"a {type(value).__name__}"
    return text if len(text) <= most else text[:most] + "..."


def _not_found(what: str, name: str, known: Iterable[str], robot: str) -> str:
    names = list(known)
    near = closest(name, names) or names[:5]
    return f"{robot} has no {what} {name!r}; closest: {', '.join(near) if near else 'none at all'}"
