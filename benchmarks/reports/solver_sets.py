"""Which solvers a part runs: all that load, and those exact enough to be held to the papers' tolerances."""

from __future__ import annotations

from functools import cache

from hqp import solvers
from hqp.solvers.base import Solver

EXACT = 1e-7
"""A solver whose guaranteed gap is above this (a first-order method) is not asked for nine digits."""


@cache
def every() -> dict[str, Solver]:
    """Each available solver by name; one that fails to import is left out and shows in ``broken``."""
    return {name: solver for name in solvers.available() if (solver := _load(name)) is not None}


@cache
def broken() -> tuple[str, ...]:
    """Names that are announced as available but do not load."""
    return tuple(name for name in solvers.available() if _load(name) is None)


def strict() -> dict[str, Solver]:
    """Those that minimise level by level."""
    return {name: solver for name, solver in every().items() if solver.strict}


def exact() -> dict[str, Solver]:
    """The strict ones that guarantee a gap of at most EXACT."""
    return {name: solver for name, solver in strict().items() if solver.accuracy <= EXACT}


def bounded() -> dict[str, Solver]:
    """The strict ones that take inequalities."""
    return {name: solver for name, solver in strict().items() if solver.inequalities}


def back_ends() -> dict[str, Solver]:
    """The strict ones that wrap a QP back end and refine its answer."""
    return {name: solver for name, solver in bounded().items() if hasattr(solver, "refine")}


@cache
def _load(name: str) -> Solver | None:
    try:
        return solvers.load(name)
    except ImportError:
        return None
