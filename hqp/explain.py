"""An account of one solution: what each element asked for, what it got, and to which elements it lost."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass

import numpy as np

from hqp.certify import Certificate, certificate
from hqp.errors import closest
from hqp.formulation import Place
from hqp.problem import Hierarchy, Rows, Solution

SHARE = 0.01
"""Losses below this share of the whole are not told."""

MET = 1e-7
"""A residual below this counts as met, relative to 1 + the size of what was asked."""


@dataclass(frozen=True)
class Loss:
    """Who took how much: ``share`` (0 to 1) of the push on a level's residual that this element holds against."""

    element: str
    share: float


@dataclass(frozen=True)
class Account:
    """One element: its level, the norm of its residual in its own units, and its losses, largest first."""

    element: str
    level: str
    rows: int
    residual: float
    met: bool
    losses: tuple[Loss, ...]
    active: tuple[str, ...]


@dataclass(frozen=True)
class Explanation:
    """The accounts of a tick and its certificate; ``str()`` is a table."""

    status: str
    accounts: tuple[Account, ...]
    certificate: Certificate

    def __getitem__(self, element: str) -> Account:
        """The account of an element; raises KeyError with the closest names."""
        for account in self.accounts:
            if account.element == element:
                return account
        near = ", ".join(closest(element, [a.element for a in self.accounts]))
        raise KeyError(f"no element {element!r}; closest: {near}")

    def __str__(self) -> str:
        header = ("level", "element", "rows", "residual", "outcome")
        lines = [(a.level, a.element, str(a.rows), f"{a.residual:.3g}", _outcome(a)) for a in self.accounts]
        widths = [max(len(row[i]) for row in (header, *lines)) for i in range(4)]
        table = [
            "  ".join((*(cell.ljust(width) for cell, width in zip(row[:4], widths, strict=True)), row[4]))
            for row in (header, *lines)
        ]
        return "\n".join((*table, f"{self.status}; {self.certificate}"))


def explain(
    problem: Hierarchy, solution: Solution, places: Mapping[str, Place], row_names: Mapping[str, tuple[str, ...]]
) -> Explanation:
    """Who lost to whom: level k's gradient A_k' w_k is held by -sum_j A_j' lambda_kj, and each element's share of it.

    row_names: names of single rows where an element has them (joints of a limit).
    """
    verdict = certificate(problem, solution.x)
    pushes = [_shares(problem, verdict, places, k) for k in range(len(problem.levels))]
    accounts = []
    for name, place in places.items():
        weight = place.element.weight
        w = solution.residuals[place.level][place.part] / weight
        residual = float(np.sqrt(w @ w))
        rows = problem.levels[place.level]
        met = residual <= MET * (1.0 + _asked(rows, place.part) / weight)
        losses = () if met else pushes[place.level]
        active = _active(solution, place, row_names.get(name, ()))
        count = place.part.stop - place.part.start
        accounts.append(Account(name, place.declared, count, residual, met, losses, active))
    return Explanation(solution.status.name, tuple(accounts), verdict)


def _shares(problem: Hierarchy, verdict: Certificate, places: Mapping[str, Place], k: int) -> tuple[Loss, ...]:
    levels, multipliers = problem.levels, verdict.multipliers[k]
    starts = np.concatenate(([0], np.cumsum([rows.m for rows in levels]))).astype(int)
    g = levels[k].dense(problem.n).T @ multipliers[starts[k] :]
    if not g.any():
        return ()
    against = {}
    for name, place in places.items():
        if place.level < k:
            lam = multipliers[starts[place.level] :][place.part]
            force = -float(g @ (levels[place.level].dense(problem.n)[place.part].T @ lam))
            if force > 0.0:  # an element may also push the level's way; only those that hold against it took something
                against[name] = force
    total = sum(against.values())
    losses = (Loss(name, force / total) for name, force in against.items() if force > SHARE * total)
    return tuple(sorted(losses, key=lambda loss: -loss.share))


def _asked(rows: Rows, part: slice) -> float:
    bounds = np.where(np.isfinite(rows.lower[part]), rows.lower[part], 0.0)
    return float(np.sqrt(bounds @ bounds))


def _active(solution: Solution, place: Place, names: tuple[str, ...]) -> tuple[str, ...]:
    marks = solution.active[place.level][place.part]
    if place.element.equality:
        return ()
    side = {1: "upper", -1: "lower"}
    return tuple(
        f"{names[i] if names else i} {side.get(int(mark), 'fixed')}" for i, mark in enumerate(marks) if mark != 0
    )


def _outcome(account: Account) -> str:
    if account.active:
        listed = ", ".join(account.active[:4]) + (", ..." if len(account.active) > 4 else "")
        return f"active: {listed}"
    if account.met:
        return "met"
    if not account.losses:
        return "lost within its own level"
    return "lost to " + ", ".join(f"{loss.element} {100.0 * loss.share:.0f} %" for loss in account.losses[:4])
