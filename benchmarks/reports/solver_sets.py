"""Sets of solvers: all that load, and those exact enough for the papers' tolerances."""

from __future__ import annotations

from functools import cache

from hqp import solvers
from hqp.solvers.base import Solver

EXACT = 1e-7
"""Largest guaranteed gap of an exact solver; first-order methods exceed it."""


@cache
def every() -> dict[str, Solver]:
    """Load each available solver by name; omit those that fail to import, which ``broken`` lists."""
    return {name: solver for name in solvers.available() if (solver := _load(name)) is not None}


@cache
def broken() -> tuple[str, ...]:
    """Names of available solvers that do not load."""
    return tuple(name for name in solvers.available() if _load(name) is None)


def strict() -> dict[str, Solver]:
    """Solvers that minimise level by level."""
    return {name: solver for name, solver in every().items() if solver.strict}


def exact() -> dict[str, Solver]:
    """Strict solvers that guarantee a gap of at most EXACT."""
    return {name: solver for name, solver in strict().items() if solver.accuracy <= EXACT}


def bounded() -> dict[str, Solver]:
    """Strict solvers that take inequalities."""
    return {name: solver for name, solver in strict().items() if solver.inequalities}


def back_ends() -> dict[str, Solver]:
    """Strict solvers that wrap a QP back end and refine its answer."""
    return {name: solver for name, solver in bounded().items() if hasattr(solver, "refine")}


@cache
def _load(name: str) -> Solver | None:
    try:
        return solvers.load(name)
    except ImportError:
        return None
