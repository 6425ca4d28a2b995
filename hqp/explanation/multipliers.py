"""Causes of each unmet level in one solution, from its multipliers (words.py has the text)."""

from __future__ import annotations

from collections.abc import Callable, Container, Mapping, Sequence

import numpy as np

from hqp.arrays import Mask, Mat, Vec, row_lengths
from hqp.explanation.words import PRICE, SHARE, Account, Explanation, HeldBack, Loss, Short, is_zero
from hqp.problem import Hierarchy, Motion, Solution
from hqp.problem.certify import Certificate, certificate
from hqp.problem.pricing import Above, Coordinates, is_met, stack_rows
from hqp.problem.stage_conditions import stage_multipliers
from hqp.programs.formulation import Place
from hqp.tolerances import NEAR

NOTHING = 1e-6
"""A gradient below this fraction of its possible size is zero: no motion lessens the residual."""


def explain(
    problem: Hierarchy,
    solution: Solution,
    places: Mapping[str, Place],
    row_names: Mapping[str, tuple[str, ...]],
    *,
    fast: Container[str] = (),
    units: Mapping[str, str] | None = None,
    shares: Mat | None = None,
    kinds: Mapping[str, Sequence[tuple[str, str]]] | None = None,
) -> Explanation:
    """Shares that balance each residual: A_k' w_k = -sum_j A_j' lambda_kj, and each element's share of it.

    A level with a price is judged in its own stage, where c_k ||w_k|| F'(F x - f) holds against it too.  row_names:
    names of single rows where an element has them (joints of a limit).  fast: elements whose lack is the rate of their
    reference.  units: units of the elements' rows.  shares: ``(levels, elements + 1)`` of every element in the order of
    places, the price's last, if the kernel has computed them (hqp.explanation.account).  kinds: meaning of the (lower,
    upper) bound of each row, see ``Inequality.bound_kinds``.
    """
    kinds = kinds or {}
    verdict = certificate(problem, solution.x, stages=solution.stage_points, settled=True)
    pushes = [_shares(problem, solution, verdict, places, row_names, kinds, k) for k in range(len(problem.levels))]
    if shares is not None:
        pushes = [_from_shares(row, places, push) for row, push in zip(shares.tolist(), pushes, strict=True)]
    still = Coordinates.of(problem.motion, problem.n).still
    accounts = []
    for name, place in places.items():
        weight = place.element.weight
        w = solution.residuals[place.level][place.part] / weight
        residual = float(np.sqrt(w @ w))
        off = problem.levels[place.level].slack(still)[place.part] / weight
        requested = float(np.sqrt(off @ off))
        met = is_zero(residual, requested)
        losses = pushes[place.level]
        cause, fights = ("", ()) if met else _cause(problem, solution, places, name, losses, name in fast)
        losses = losses if cause in ("lost", "limit", "price", "too fast") else ()
        names, unit = row_names.get(name, ()), (units or {}).get(name, "")
        held = None
        price = next((loss.share for loss in losses if loss.element == PRICE), 0.0)
        if price > 0.0:
            worth = _worth(problem, solution, place.level)
            short = Short.of(w, names)
            held = HeldBack(name, place.declared, requested, requested - residual, unit, price, short, worth)
        active = _active(solution, place, names, kinds.get(name, ()))
        count = place.part.stop - place.part.start
        accounts.append(
            Account(name, place.declared, count, residual, met, losses, active, cause, fights, requested, held, unit)
        )
    return Explanation(solution.status.name, tuple(accounts), verdict)


def cause_of(losses: Sequence[Loss], *, fast: bool) -> str:
    """Price if its share is the largest, else active limit, else levels above; too fast precedes price and limit."""
    price, limit = losses[0].element == PRICE, any(loss.binds for loss in losses)
    if fast and (price or limit):
        return "too fast"
    return "price" if price else "limit" if limit else "lost"


def _cause(
    problem: Hierarchy,
    solution: Solution,
    places: Mapping[str, Place],
    name: str,
    losses: tuple[Loss, ...],
    fast: bool,
) -> tuple[str, tuple[str, ...]]:
    """Cause of an element's residual, and the elements of its own level that it opposes."""
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
    if not losses:
        return "lost", ()
    return cause_of(losses, fast=fast), ()


def _point(solution: Solution, k: int) -> Vec | None:
    """x_k of a level that was solved in a stage of its own."""
    points = solution.stage_points
    return None if points is None or np.isnan(points[k, 0]) else points[k]


def _worth(problem: Hierarchy, solution: Solution, k: int) -> float:
    """c_k ||F x_k - f||."""
    x = _point(solution, k)
    x = solution.x if x is None else x
    moved = (problem.motion or Motion(np.ones(problem.n))).offset(x)
    return _price(problem, k) * float(np.sqrt(moved @ moved))


def _price(problem: Hierarchy, k: int) -> float:
    return 0.0 if problem.prices is None else float(problem.prices[k])


def _multipliers(problem: Hierarchy, solution: Solution, verdict: Certificate, k: int) -> tuple[Vec, Vec | None]:
    """Multipliers of the rows above level k ``(m_0 + ... + m_{k-1},)`` for the gradient A_k' w_k, and the push of its
    price."""
    above = sum(rows.m for rows in problem.levels[:k])
    x = _point(solution, k)
    if x is None or problem.prices is None or solution.stage_points is None or not problem.prices[k] > 0.0:
        return verdict.multipliers[k][:above], None
    found, _ = stage_multipliers(problem, solution.stage_points, k, verdict.tolerance)
    w = solution.residuals[k]
    norm = float(np.sqrt(w @ w))
    motion = (problem.motion or Motion(np.ones(problem.n))).gradient(x)
    A = stack_rows(problem.levels[:k], problem.n).dense(problem.n)
    passing = norm * np.where(_holds(problem, solution, k, found), 0.0, found)
    return norm * found - passing, _price(problem, k) * norm * motion + A.T @ passing


def _slowed(problem: Hierarchy, solution: Solution, k: int) -> Mat:
    """Contribution of each row of an unmet level above level k to its gradient by the motion beyond x_a ``(rows above,
    n)``.

    The second term of R_k (hqp.problem.pricing), row by row, in the scale of A_k' w_k.
    """
    at, own = Coordinates.of(problem.motion, problem.n), _point(solution, k)
    w, price = solution.residuals[k], _price(problem, k)
    scale = price * float(np.sqrt(w @ w)) if price > 0.0 else 1.0
    F = np.diag(at.F) if at.F.ndim == 1 else at.F
    found, above = [], Above.none(problem.n)
    for a, rows in enumerate(problem.levels[:k]):
        added, point = np.zeros((rows.m, problem.n)), _point(solution, a)
        unmet = _price(problem, a) > 0.0 and point is not None and not is_met(rows, point)
        if unmet and point is not None and problem.turning is not None:
            moved = F @ ((solution.x if own is None else own) - point)
            off = rows.slack(point)
            share = np.where(rows.equality, float(off @ off), off * off)
            held = above.hard.dense(problem.n)[above.hard.equality]
            columns = share[:, None] * at.columns(rows.dense(problem.n), held)
            added = scale * float(problem.turning[a]) * (columns * moved) @ F
        found.append(added)
        above = above.after(problem, a, solution.x if point is None else point, at)
    return np.concatenate([*found, np.zeros((0, problem.n))])


def _holds(problem: Hierarchy, solution: Solution, k: int, multipliers: Vec) -> Mask:
    """Mask of rows above level k that hold it back: rows active at the solution, and rows close to rest
    (tolerances.NEAR)."""
    at, rows = Coordinates.of(problem.motion, problem.n), stack_rows(problem.levels[:k], problem.n)
    A = rows.dense(problem.n)
    bound = np.where(multipliers > 0.0, rows.upper, rows.lower)
    near = np.abs(bound - A @ at.still) <= NEAR * row_lengths(at.rows(A))
    return np.asarray(near | (np.concatenate([np.zeros(0), *solution.active[:k]]) != 0))


def _shares(
    problem: Hierarchy,
    solution: Solution,
    verdict: Certificate,
    places: Mapping[str, Place],
    row_names: Mapping[str, tuple[str, ...]],
    kinds: Mapping[str, Sequence[tuple[str, str]]],
    k: int,
) -> tuple[Loss, ...]:
    levels, w = problem.levels, solution.residuals[k]
    starts = np.concatenate(([0], np.cumsum([rows.m for rows in levels]))).astype(int)
    A = levels[k].dense(problem.n)
    g = A.T @ w
    if not float(np.linalg.norm(g)) > NOTHING * float(np.linalg.norm(A)) * float(np.linalg.norm(w)):
        return ()
    multipliers, price = _multipliers(problem, solution, verdict, k)
    slowed = _slowed(problem, solution, k)
    against: dict[str, float] = {}
    held: dict[str, tuple[str, ...]] = {}
    scale = _inner(problem)
    if price is not None and (force := -scale(g, price)) > 0.0:
        against[PRICE] = force
    for name, place in places.items():
        if place.level < k:
            lam = multipliers[starts[place.level] :][place.part]
            pushed = slowed[starts[place.level] :][place.part].sum(axis=0)
            force = -scale(g, levels[place.level].dense(problem.n)[place.part].T @ lam + pushed)
            if force > 0.0:  # an element may also push in the level's direction, which is no loss
                against[name] = force
                if not place.element.equality:
                    held[name] = _named(row_names.get(name, ()), kinds.get(name, ()), lam)
    total = sum(against.values())
    losses = (
        Loss(name, force / total, held.get(name, ()), name in held)
        for name, force in against.items()
        if force > SHARE * total
    )
    return tuple(sorted(losses, key=lambda loss: -loss.share))


def _from_shares(shares: list[float], places: Mapping[str, Place], found: tuple[Loss, ...]) -> tuple[Loss, ...]:
    """Losses by the kernel's shares, with the rows that were found for each element."""
    rows = {loss.element: loss.rows for loss in found}
    limits = {name for name, place in places.items() if not place.element.equality}
    parts = zip((*places, PRICE), shares, strict=True)
    losses = [Loss(e, s, rows.get(e, ()), e in limits) for e, s in parts if s > SHARE]
    return tuple(sorted(losses, key=lambda loss: -loss.share))


def _inner(problem: Hierarchy) -> Callable[[Vec, Vec], float]:
    """The product in which gradients are compared: the product of motion if there is one, so that units agree."""
    if problem.motion is None:
        return lambda a, b: float(a @ b)
    P = Coordinates.of(problem.motion, problem.n).P
    return lambda a, b: float((a * P) @ (b * P)) if P.ndim == 1 else float((a @ P) @ (b @ P))


def _named(names: tuple[str, ...], kinds: Sequence[tuple[str, str]], lam: Vec) -> tuple[str, ...]:
    """Rows with a multiplier, largest first, by name and side."""
    order = np.argsort(-np.abs(lam)).tolist()
    most = float(np.abs(lam).max(initial=0.0))
    return tuple(
        _side(names[i] if i < len(names) else f"row {i}", kinds[i] if kinds else ("", ""), 1 if lam[i] > 0.0 else -1)
        for i in order
        if abs(lam[i]) > SHARE * most
    )


def _side(name: str, kind: tuple[str, str], mark: int) -> str:
    """A row and which of its bounds: ``elbow upper``, ``elbow upper acceleration``."""
    if mark not in (1, -1):
        return f"{name} fixed"
    return " ".join(filter(None, (name, "upper" if mark > 0 else "lower", kind[mark > 0])))


def _active(
    solution: Solution, place: Place, names: tuple[str, ...], kinds: Sequence[tuple[str, str]]
) -> tuple[str, ...]:
    marks = solution.active[place.level][place.part]
    if place.element.equality:
        return ()
    return tuple(
        _side(names[i] if i < len(names) else str(i), kinds[i] if kinds else ("", ""), int(mark))
        for i, mark in enumerate(marks)
        if mark != 0
    )
