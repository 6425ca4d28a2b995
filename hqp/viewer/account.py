"""Text of the page: met elements, yielding elements with the cause, joints at a limit."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, field
from types import SimpleNamespace
from typing import Any

import numpy as np

from hqp.arrays import Vec
from hqp.explanation.counters import Counters
from hqp.explanation.multipliers import explain
from hqp.explanation.words import PRICE, Explanation, Loss, is_zero
from hqp.problem import Hierarchy, Motion, Rows, Selection, Solution, Status
from hqp.programs.formulation import Place

from .description import Member, StackDescription
from .headline import make_headline

NEAR = 0.01
"""A target nearer than this counts as reached [m, rad]."""


COMING = 0.01
"""A target whose distance falls faster is on its way, though its level is not met [m/s, rad/s]."""


@dataclass(frozen=True)
class ElementView:
    """One element: state is ``met``, ``moving``, ``short`` (gives way) or ``violated``; why names the cause."""

    name: str
    state: str
    residual: float
    distance: str
    why: str


@dataclass(frozen=True)
class LevelView:
    """One level as a card: its members, the worst of their states, the norm of its residual."""

    index: int
    title: str
    elements: tuple[ElementView, ...]
    state: str
    residual: float


@dataclass(frozen=True)
class JointView:
    """A joint at a limit: its name, the limit in words, and its position in the range, 0 to 1."""

    name: str
    what: str
    place: float | None


@dataclass(frozen=True)
class Account:
    """Content of the page for one tick; apart: pairs of links at their clearance."""

    status: str
    headline: str
    reason: str
    tone: str
    levels: tuple[LevelView, ...]
    joints: tuple[JointView, ...]
    notes: tuple[str, ...]
    apart: tuple[str, ...] = ()
    counters: Counters | None = None
    explanation: Explanation | None = field(repr=False, default=None)


def make_account(
    stack: StackDescription,
    snapshot: Mapping[str, Any],
    errors: Mapping[str, tuple[float, str]],
    joints: tuple[tuple[str, ...], Vec, Vec, Vec],
    motion: tuple[Vec, Vec],
    closing: Mapping[str, float] | None = None,
) -> Account:
    """The account of a snapshot of that stack.

    errors: distance of each target from its frame [m, rad] and the same in words.  closing: rate of decrease [m/s,
    rad/s].  joints: names, lower, upper and speed limits by tangent coordinate.  motion: angles and velocities by
    tangent coordinate.
    """
    explanation = _explain(snapshot, stack)
    places = {m.name: m for m in stack.members}
    active = _active(snapshot, stack)
    limited = _joints(active, joints, motion)
    levels = []
    for k, title in enumerate(stack.levels):
        members = stack.of_level(k)
        views = tuple(element_view(m, snapshot, explanation, errors.get(m.name), stack, active) for m in members)
        residual = float(np.linalg.norm(snapshot["residuals"][k]))
        levels.append(LevelView(k, title, views, _worst(views), residual))
    missing = tuple(m for m in stack.members if m.level < 0)
    if missing:
        views = tuple(ElementView(m.name, "met", 0.0, "", "") for m in missing)
        levels.insert(0, LevelView(-1, "subject_to", views, "met", 0.0))
    notes = tuple(f"{element}: {detail}" for element, detail in snapshot["notes"])
    near = {name: error[0] <= NEAR for name, error in errors.items()}
    coming = {name for name, rate in (closing or {}).items() if rate > COMING}
    headline, reason, tone = make_headline(snapshot["status"], levels, notes, near, coming, places)
    apart = tuple(row for m in stack.members if m.kind == "CollisionAvoidance" for row, _ in active.get(m.name, ()))
    return Account(
        snapshot["status"],
        headline,
        reason,
        tone,
        tuple(levels),
        limited,
        notes,
        apart,
        snapshot["counters"],
        explanation,
    )


def _explain(snapshot: Mapping[str, Any], stack: StackDescription) -> Explanation | None:
    """The library's own account, of the rows as they were."""
    levels = tuple(
        Rows(Selection(*A) if isinstance(A, tuple) else A, lower, upper) for A, lower, upper in snapshot["rows"]
    )
    try:
        motion = None if snapshot["motion"] is None else Motion(*snapshot["motion"])
        problem = Hierarchy(
            levels, stack.constraints, snapshot["metric"], snapshot["origin"], snapshot["n"],
            prices=snapshot["prices"], motion=motion, eta=snapshot["eta"], turning=snapshot["turning"],
        )  # fmt: skip
        solution = Solution(
            snapshot["x"], Status[snapshot["solved"]], snapshot["residuals"], snapshot["active"],
            stage_points=snapshot["stage_points"],
        )  # fmt: skip
        places: dict[str, Any] = {
            m.name: Place(
                SimpleNamespace(weight=m.weight, equality=m.equality, name=m.name),  # type: ignore[arg-type]
                m.level,
                m.part,
                m.declared,
            )
            for m in stack.members
            if m.level >= 0
        }
        rows = {m.name: m.rows for m in stack.members if m.rows} | snapshot["names"]
        units = {m.name: m.unit for m in stack.members}
        return explain(problem, solution, places, rows, fast=snapshot["fast"], units=units)
    except (ValueError, np.linalg.LinAlgError, ArithmeticError):  # rows of a tick that went wrong
        return None


def _active(snapshot: Mapping[str, Any], stack: StackDescription) -> dict[str, list[tuple[str, int]]]:
    """Rows of inequalities that bind, by element: their names and sides."""
    found: dict[str, list[tuple[str, int]]] = {}
    for m in stack.members:
        if m.equality or m.level < 0 or m.level >= len(snapshot["active"]):
            continue
        marks = np.asarray(snapshot["active"][m.level])[m.part]
        names = snapshot["names"].get(m.name, m.rows)
        found[m.name] = [
            (names[i] if i < len(names) else f"row {i}", int(mark)) for i, mark in enumerate(marks) if mark
        ]
    return found


def _joints(
    active: Mapping[str, list[tuple[str, int]]],
    joints: tuple[tuple[str, ...], Vec, Vec, Vec],
    motion: tuple[Vec, Vec],
) -> tuple[JointView, ...]:
    """Joints at the end of their range or at top speed, and those that a row brakes."""
    names, lower, upper, speed = joints
    angles, v = motion
    marked = {name: side for rows in active.values() for name, side in rows}
    views = []
    for i, name in enumerate(names):
        if name == "base":
            continue
        span = upper[i] - lower[i]
        place = float((angles[i] - lower[i]) / span) if 0.0 < span < np.inf else None
        if angles[i] >= upper[i] - 2e-3:
            views.append(JointView(name, "upper end of its range", place))
        elif angles[i] <= lower[i] + 2e-3:
            views.append(JointView(name, "lower end of its range", place))
        elif abs(v[i]) >= 0.99 * speed[i]:
            views.append(JointView(name, f"top speed, {speed[i]:.3g} rad/s", place))
        elif name in marked:
            views.append(JointView(name, "held by its limits", place))
    order = ("upper end", "lower end", "top speed", "held by")
    return tuple(sorted(views, key=lambda view: [not view.what.startswith(start) for start in order]))


def element_view(
    m: Member,
    snapshot: Mapping[str, Any],
    explanation: Explanation | None,
    error: tuple[float, str] | None,
    stack: StackDescription,
    active: Mapping[str, list[tuple[str, int]]],
) -> ElementView:
    """One element of a tick; explanation: the explanation of the tick, or None."""
    w = np.asarray(snapshot["residuals"][m.level])[m.part] / m.weight
    residual = float(np.sqrt(w @ w))
    met = is_zero(residual, 0.0) if explanation is None else explanation[m.name].met
    distance = "" if error is None else error[1]
    if not m.equality:
        rows = active.get(m.name, [])
        state = "met" if met else "violated"
        return ElementView(m.name, state, residual, "", f"{len(rows)} active" if rows else "")
    if met:
        far = error is not None and error[0] > NEAR
        return ElementView(m.name, "moving" if far else "met", residual, distance, "")
    if m.level < stack.constraints or m.contact:
        return ElementView(m.name, "violated", residual, distance, _why(explanation, m.name))
    return ElementView(m.name, "short", residual, distance, _why(explanation, m.name))


def _why(explanation: Explanation | None, name: str) -> str:
    """Why an element is not met, in words."""
    if explanation is None:
        return ""
    account = explanation[name]
    held = account.held_back
    if account.cause == "price" and held is not None:
        given = f"requested {_digits(held.requested)} {held.unit}, achieved {_digits(held.achieved)}"
        return f"{given}: the price on motion outweighs the rest"
    if account.cause == "too fast":
        return "its target moves faster than the robot may"
    if account.cause == "out of reach":
        return "no motion of the robot reduces its error"
    if account.cause == "own level":
        return f"conflicts with {', '.join(account.fights)} in its own level"
    if not account.losses:
        return "no level above blocks it"
    parts = [f"{_words(loss)} {100.0 * loss.share:.0f} %" for loss in account.losses[:3]]
    return "gives way to " + ", ".join(parts)


def _words(loss: Loss) -> str:
    """The element it is lost to; for a limit the joints with active rows."""
    if loss.element == PRICE:
        return "the price on motion"
    rows = ", ".join(loss.rows[:2])
    return f"{loss.element} ({rows}{', ...' if len(loss.rows) > 2 else ''})" if rows else loss.element


def _digits(value: float) -> str:
    return f"{value:.2g}" if abs(value) < 10.0 else f"{value:.0f}"


_ORDER = ("met", "moving", "short", "violated")


def _worst(views: tuple[ElementView, ...]) -> str:
    return max((v.state for v in views), key=_ORDER.index, default="met")
