"""hqp: strict task priorities for floating-base robots, any solver, at control rate."""

from __future__ import annotations

import importlib
from typing import TYPE_CHECKING

from hqp import native, solvers
from hqp.declare.element import Constraint, Element, Inequality, Task
from hqp.declare.law import DCM, PD, P, SelfMotion
from hqp.declare.price import Price
from hqp.declare.reference import Reference
from hqp.declare.safety import Braking, RateLimits, StateBounds
from hqp.declare.stack import Level, Stack
from hqp.errors import HqpError, PurePythonWarning
from hqp.loop.session import Controller, Note, Session, Tick
from hqp.problem import Hierarchy, Motion, Rows, Selection, Solution, Status
from hqp.programs.formulation import Acceleration, Velocity
from hqp.sequence import Phase, Sequence

if TYPE_CHECKING:
    from hqp import errors, estimation, recorder, robots, serial, shapes, sweep, tasks
    from hqp.comparison import compare
    from hqp.declare.checking import check
    from hqp.declare.fingerprint import fingerprint
    from hqp.explanation.conflict import conflict
    from hqp.export.batch import Batch
    from hqp.export.loaded import load
    from hqp.goals import reach, solve_ik
    from hqp.lab import bench
    from hqp.motion import retarget
    from hqp.policies import PolicyFilter, UpperBody
    from hqp.problem.certify import Certificate, certificate
    from hqp.solvers.levels import solve_levels
    from hqp.solvers.many import solve_many
    from hqp.state_map import StateMap
    from hqp.teleoperation import Follow
    from hqp.torque import Torque
    from hqp.viewer import view

__version__ = "0.3.0"

__all__ = [
    "DCM",
    "PD",
    "Acceleration",
    "Batch",
    "Braking",
    "Certificate",
    "Constraint",
    "Controller",
    "Element",
    "Follow",
    "Hierarchy",
    "HqpError",
    "Inequality",
    "Level",
    "Motion",
    "Note",
    "P",
    "Phase",
    "PolicyFilter",
    "Price",
    "PurePythonWarning",
    "RateLimits",
    "Reference",
    "Rows",
    "Selection",
    "SelfMotion",
    "Sequence",
    "Session",
    "Solution",
    "Stack",
    "StateBounds",
    "StateMap",
    "Status",
    "Task",
    "Tick",
    "Torque",
    "UpperBody",
    "Velocity",
    "bench",
    "certificate",
    "check",
    "compare",
    "conflict",
    "errors",
    "estimation",
    "fingerprint",
    "load",
    "reach",
    "recorder",
    "retarget",
    "robots",
    "serial",
    "shapes",
    "solve_ik",
    "solve_levels",
    "solve_many",
    "solvers",
    "sweep",
    "tasks",
    "view",
]


native.check()

_MODULES = ("errors", "estimation", "recorder", "robots", "serial", "shapes", "sweep", "tasks")

_ELSEWHERE = {
    "Batch": "export.batch",
    "Certificate": "problem.certify",
    "Follow": "teleoperation",
    "StateMap": "state_map",
    "PolicyFilter": "policies",
    "Torque": "torque",
    "UpperBody": "policies",
    "bench": "lab",
    "certificate": "problem.certify",
    "check": "declare.checking",
    "compare": "comparison",
    "conflict": "explanation.conflict",
    "fingerprint": "declare.fingerprint",
    "load": "export.loaded",
    "reach": "goals",
    "retarget": "motion",
    "solve_ik": "goals",
    "solve_levels": "solvers.levels",
    "solve_many": "solvers.many",
    "view": "viewer",
}
"""Public names, and the modules that are imported on their first use."""


def __getattr__(name: str) -> object:
    """Import the parts that need Pinocchio, SciPy or tables on first use."""
    if name in _MODULES:
        return importlib.import_module(f"hqp.{name}")
    if name in _ELSEWHERE:
        return getattr(importlib.import_module(f"hqp.{_ELSEWHERE[name]}"), name)
    raise AttributeError(f"module 'hqp' has no attribute {name!r}")


def __dir__() -> list[str]:
    return [*__all__, "__doc__", "__file__", "__name__", "__path__", "__version__"]
