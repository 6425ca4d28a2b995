"""An account of one solution: what each element asked for, what it got, and to which elements it lost."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass

import numpy as np

from hqp.arrays import Vec
from hqp.certify import Certificate, certificate
from hqp.errors import closest
from hqp.formulation import Place
from hqp.problem import Hierarchy, Rows, Solution

NOTHING = 1e-6
"""A gradient below this fraction of what its rows could give is zero: no motion lessens the residual."""

SHARE = 0.01
"""Losses below this fraction of the whole are omitted."""

MET = 1e-7
"""A residual below this counts as met, relative to 1 + the size of what was asked."""


@dataclass(frozen=True)
class Loss:
    """Who took how much: ``share`` (0 to 1) of the push on a level's residual that this element holds against it.

    rows: of an inequality, its rows that hold against it, by name and side.
    """

    element: str
    share: float
    rows: tuple[str, ...] = ()

    def __str__(self) -> str:
        rows = f" ({', '.join(self.rows[:3])}{', ...' if len(self.rows) > 3 else ''})" if self.rows else ""
        return f"{self.element} {100.0 * self.share:.0f} %{rows}"


@dataclass(frozen=True)
class Account:
    """One element: its level, the norm of its residual in its own units, and its losses, largest first.

    cause: why it is not met, "" where it is: ``lost`` to levels above, ``own level`` (fights: whom),
    ``out of reach`` (no motion of the robot lessens the residual), ``price`` (the rest costs more motion than it is
    worth).  asked: the norm of what was asked for, in the units of the residual.
    """

    element: str
    level: str
    rows: int
    residual: float
    met: bool
    losses: tuple[Loss, ...]
    active: tuple[str, ...]
    cause: str = ""
    fights: tuple[str, ...] = ()
    asked: float = 0.0


@dataclass(frozen=True)
class Explanation:
    """The accounts of a tick and its certificate; ``str()`` is a table.  remarks: on loads, which have no rows."""

    status: str
    accounts: tuple[Account, ...]
    certificate: Certificate
    remarks: tuple[str, ...] = ()

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
        return "\n".join((*table, *self.remarks, f"{self.status}; {self.certificate}"))


def explain(
    problem: Hierarchy, solution: Solution, places: Mapping[str, Place], row_names: Mapping[str, tuple[str, ...]]
) -> Explanation:
    """Who lost to whom: level k's gradient A_k' w_k is held by -sum_j A_j' lambda_kj, and each element's share of it.

    row_names: names of single rows where an element has them (joints of a limit).
    """
    verdict = certificate(problem, solution.x, stages=solution.stage_points, settled=True)
    pushes = [_shares(problem, solution, verdict, places, row_names, k) for k in range(len(problem.levels))]
    accounts = []
    for name, place in places.items():
        weight = place.element.weight
        w = solution.residuals[place.level][place.part] / weight
        residual = float(np.sqrt(w @ w))
        rows = problem.levels[place.level]
        asked = _asked(rows, place.part) / weight
        met = residual <= MET * (1.0 + asked)
        cause, fights = ("", ()) if met else _cause(problem, solution, places, name, pushes[place.level])
        losses = pushes[place.level] if cause in ("lost", "price") else ()
        active = _active(solution, place, row_names.get(name, ()))
        count = place.part.stop - place.part.start
        accounts.append(Account(name, place.declared, count, residual, met, losses, active, cause, fights, asked))
    return Explanation(solution.status.name, tuple(accounts), verdict)


def _cause(
    problem: Hierarchy, solution: Solution, places: Mapping[str, Place], name: str, losses: tuple[Loss, ...]
) -> tuple[str, tuple[str, ...]]:
    """Why an element is not met, and whom of its own level it fights."""
    place = places[name]
    A = problem.levels[place.level].dense(problem.n)
    pulls = {
        other: A[p.part].T @ solution.residuals[place.level][p.part]
        for other, p in places.items()
        if p.level == place.level
    }
    w = solution.residuals[place.level][place.part]
    own, most = pulls[name], float(np.linalg.norm(A[place.part]) * np.linalg.norm(w))
    if float(np.linalg.norm(own)) <= NOTHING * most:
        return "out of reach", ()
    whole = sum(pulls.values())
    if float(np.linalg.norm(whole)) <= NOTHING * sum(float(np.linalg.norm(pull)) for pull in pulls.values()):
        return "own level", tuple(other for other, pull in pulls.items() if other != name and float(pull @ own) < 0.0)
    return ("price" if losses and losses[0].element == PRICE else "lost"), ()


PRICE = "its price"


def _price(problem: Hierarchy, solution: Solution, k: int) -> Vec | None:
    """The push of level k's price on motion, c ||w|| F'(F x - f) ``(n,)``; None where it has none."""
    if problem.prices is None or not problem.prices[k] > 0.0:
        return None
    w, motion, x = solution.residuals[k], problem.motion, solution.x
    if motion is None:
        gradient = x
    else:
        off = motion.F * x if motion.F.ndim == 1 else motion.F @ x
        off = off if motion.f is None else off - motion.f
        gradient = motion.F * off if motion.F.ndim == 1 else motion.F.T @ off
    return np.asarray(float(problem.prices[k]) * float(np.sqrt(w @ w)) * gradient)


def _shares(
    problem: Hierarchy,
    solution: Solution,
    verdict: Certificate,
    places: Mapping[str, Place],
    row_names: Mapping[str, tuple[str, ...]],
    k: int,
) -> tuple[Loss, ...]:
    levels, multipliers = problem.levels, verdict.multipliers[k]
    starts = np.concatenate(([0], np.cumsum([rows.m for rows in levels]))).astype(int)
    g = levels[k].dense(problem.n).T @ multipliers[starts[k] :]
    scale = float(np.linalg.norm(levels[k].dense(problem.n)) * np.linalg.norm(multipliers[starts[k] :]))
    if not float(np.linalg.norm(g)) > NOTHING * scale:
        return ()
    against: dict[str, float] = {}
    held: dict[str, tuple[str, ...]] = {}
    price = _price(problem, solution, k)
    if price is not None and (force := -float(g @ price)) > 0.0:
        against[PRICE] = force
    for name, place in places.items():
        if place.level < k:
            lam = multipliers[starts[place.level] :][place.part]
            force = -float(g @ (levels[place.level].dense(problem.n)[place.part].T @ lam))
            if force > 0.0:  # an element may also push the level's way; only those that hold against it took something
                against[name] = force
                if not place.element.equality:
                    held[name] = _named(row_names.get(name, ()), lam)
    total = sum(against.values())
    losses = (Loss(name, force / total, held.get(name, ())) for name, force in against.items() if force > SHARE * total)
    return tuple(sorted(losses, key=lambda loss: -loss.share))


def _named(names: tuple[str, ...], lam: Vec) -> tuple[str, ...]:
    """Rows with a multiplier, largest first, by name and side."""
    order = np.argsort(-np.abs(lam))
    most = float(np.abs(lam).max(initial=0.0))
    return tuple(
        f"{names[i] if i < len(names) else f'row {i}'} {'upper' if lam[i] > 0.0 else 'lower'}"
        for i in order
        if abs(lam[i]) > SHARE * most
    )


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
    if account.cause == "out of reach":
        return "out of reach: no motion of the robot lessens it"
    if account.cause == "own level":
        return "fights " + (", ".join(account.fights) or "itself") + " in its own level"
    if account.cause == "price":
        given = max(0.0, account.asked - account.residual)
        return f"held back by its price: asked {account.asked:.3g}, given {given:.3g}"
    if not account.losses:
        return "lost"
    return "lost to " + ", ".join(str(loss) for loss in account.losses[:4])
