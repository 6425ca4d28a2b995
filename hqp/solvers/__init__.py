"""Solvers by name; each is imported on first use."""

from __future__ import annotations

import dataclasses
import importlib
import importlib.util
from collections.abc import Iterable
from typing import TYPE_CHECKING, Any

from hqp.errors import DeclarationError, SolverNotInstalled, closest
from hqp.native import ADVICE
from hqp.native import missing as missing_parts
from hqp.solvers.base import Solver, Workspace

if TYPE_CHECKING:
    from importlib.metadata import EntryPoint

    from hqp.solvers import cascade, chiaverini, daqp, lexicographic, nullspace, weighted

__all__ = [
    "Solver",
    "Workspace",
    "available",
    "cascade",
    "chiaverini",
    "daqp",
    "default",
    "exact",
    "known",
    "lexicographic",
    "load",
    "nullspace",
    "select",
    "weighted",
]

GROUP = "hqp.solvers"

_BUILT_IN = {
    "nullspace": "hqp.solvers.nullspace:Nullspace",
    "chiaverini": "hqp.solvers.chiaverini:Chiaverini",
    "cascade": "hqp.solvers.cascade:Cascade",
    "daqp": "hqp.solvers.daqp:Daqp",
    "lexicographic": "hqp.solvers.lexicographic:Lexicographic",
    "reference": "hqp.solvers.reference:Reference",  # loads by name, but is not listed: it is there to judge others
    "weighted": "hqp.solvers.weighted:Weighted",
}

_BACKENDS = ("proxqp", "osqp", "daqp", "piqp", "clarabel", "quadprog")
_PACKAGES = {"proxqp": "proxsuite", "highs": "highspy", "qpswift": "qpSWIFT"}
_ALONE = ("proxqp", "osqp")
"""Back ends through their own packages; every other one goes through qpsolvers."""
_DEFAULT_BACKEND = "proxqp"  # back end of cascade and weighted
_EXTRA = ("proxqp", "osqp", "daqp", "piqp", "clarabel")
ALLOWED = "a name that `hqp solvers` lists, or a Solver"
"""Allowed values of an argument that takes a solver."""
_INSTALL = "pip install 'hqp[solvers]'"


def __getattr__(name: str) -> object:
    """``hqp.solvers.lexicographic`` and the other modules of solvers, imported on first use."""
    if name in _BUILT_IN:
        return importlib.import_module(f"hqp.solvers.{name}")
    raise AttributeError(f"module 'hqp.solvers' has no attribute {name!r}")


def known() -> dict[str, str]:
    """Every solver name hqp can speak of, and '' if it loads or the pip line that would make it."""
    names = {name: _missing(_needs(name, {})) for name in _BUILT_IN if name not in ("cascade", "reference")}
    if "solver" in missing_parts():
        names["lexicographic"] = ADVICE
    names.update({f"cascade:{backend}": _missing(backend) for backend in _BACKENDS})
    names.update({point.name: "" for point in _entry_points()})
    return names


def available() -> tuple[str, ...]:
    """The names that ``load`` accepts here and now."""
    return tuple(name for name, missing in known().items() if not missing)


def default() -> str:
    """The solver where none is named: ``lexicographic``, or ``cascade`` where it was not compiled."""
    return "cascade" if "solver" in missing_parts() else "lexicographic"


def exact() -> str:
    """Name of the solver for exact results regardless of time: ``lexicographic``, or ``reference`` without a
    compiler."""
    return "reference" if "solver" in missing_parts() else "lexicographic"


def select(given: str | Solver | Iterable[str | Solver]) -> tuple[str | Solver, ...]:
    """Names and solvers of an argument that takes one or several: "all" that are available, ``default()`` for "".

    Raises DeclarationError for other values.
    """
    if isinstance(given, str):
        return available() if given == "all" else (given or default(),)
    found = (given,) if isinstance(given, Solver) or not isinstance(given, Iterable) else tuple(given)
    for one in found:
        if not isinstance(one, (str, Solver)):
            raise DeclarationError("solvers", "not a solver", value=one, allowed=ALLOWED)
    return found


def load(name: str = "", **options: Any) -> Solver:
    """The solver of that name, ``"cascade:proxqp"`` being ``load("cascade", backend="proxqp")``; ``default()`` for "".

    Raises DeclarationError for an unknown name or option, SolverNotInstalled (with the pip line) where a
    package is missing.
    """
    if not isinstance(name, str):
        raise DeclarationError("solvers", "not a name", value=name, allowed=ALLOWED)
    name = name or default()
    base, _, backend = name.partition(":")
    if backend:
        options = {"backend": backend, **options}
    backend = _needs(base, options)
    _check_backend(base, backend)
    needed = _missing(backend)
    if needed:
        raise SolverNotInstalled(f"solver {name!r} is not installed: {needed}")
    factory = _factory(base)
    if dataclasses.is_dataclass(factory):
        allowed = [field.name for field in dataclasses.fields(factory) if field.init]
        strangers = sorted(set(options) - set(allowed))
        if strangers:
            raise DeclarationError(
                f"solver {name}", "unknown option", value=strangers[0], allowed=", ".join(allowed) or "none"
            )
    return factory(**options)  # type: ignore[no-any-return]


def _factory(name: str) -> Any:
    target = _BUILT_IN.get(name)
    if target is not None:
        module, _, attribute = target.partition(":")
        return getattr(importlib.import_module(module), attribute)
    for point in _entry_points():
        if point.name == name:
            return point.load()
    near = closest(name, known())
    what = f"unknown name; closest: {', '.join(near)}" if near else "unknown name"
    raise DeclarationError("solver", what, value=name, allowed=", ".join(known()))


def _entry_points() -> Iterable[EntryPoint]:
    """Solvers of other packages."""
    from importlib.metadata import entry_points  # reads the installed packages, which `import hqp` avoids

    return entry_points(group=GROUP)


def _needs(name: str, options: dict[str, Any]) -> str:
    """The back end without which a solver cannot work, '' for none."""
    if name in ("cascade", "weighted"):
        return str(options.get("backend", _DEFAULT_BACKEND))
    return "daqp" if name == "daqp" else ""


def _check_backend(solver: str, backend: str) -> None:
    """Raise DeclarationError for a back end that neither hqp nor qpsolvers knows."""
    if not backend or backend in _BACKENDS:
        return
    names, more = {*_BACKENDS, *_PACKAGES}, ""
    if importlib.util.find_spec("qpsolvers") is not None:
        import qpsolvers

        names |= set(qpsolvers.available_solvers)
    else:
        more = f", and more with qpsolvers: {_INSTALL}"
    if backend not in names:
        near = ", ".join(closest(backend, names) or _BACKENDS)
        raise DeclarationError(f"solver {solver}", f"unknown back end; closest: {near}{more}", value=backend)


def _missing(backend: str) -> str:
    """The pip line for a back end's missing packages, "" if it has all."""
    needed = [_PACKAGES.get(backend, backend), *(() if backend in _ALONE else ("qpsolvers",))] if backend else []
    lacking = [package for package in needed if importlib.util.find_spec(package) is None]
    if not lacking:
        return ""
    return _INSTALL if backend in _EXTRA else f"pip install {' '.join(lacking)}"
