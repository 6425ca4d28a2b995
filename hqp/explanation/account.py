"""Limits on each element, tick by tick: shares from the kernel's own multipliers, in microseconds."""

from __future__ import annotations

from collections.abc import Callable, Iterator
from dataclasses import dataclass
from typing import TYPE_CHECKING, Any

import numpy as np

from hqp.arrays import Mat, Vec
from hqp.declare.robot import Robot
from hqp.errors import DeclarationError, closest
from hqp.explanation.multipliers import NOTHING, cause_of
from hqp.explanation.words import PRICE, SHARE, Explanation, HeldBack, Loss, Short, is_zero, losses_text
from hqp.programs.formulation import Program
from hqp.tolerances import NEAR

if TYPE_CHECKING:
    from hqp._lexicographic import Workspace

MOST = 0.5
"""Share of a level above which the price is the cause of its residual."""

NOTED = 0.01
"""Note a price only if it holds back more than this fraction of the request."""


NONE: frozenset[str] = frozenset()


@dataclass(frozen=True, slots=True, eq=False)
class Layout:
    """Elements of a stack: names, levels, which are inequalities, one over the weight of each; count: of levels."""

    elements: tuple[str, ...]
    levels: tuple[int, ...]
    limits: tuple[bool, ...]
    count: int
    inverse: Vec

    def place(self, element: str) -> int:
        """The number of an element; raises DeclarationError with the closest names."""
        if element not in self.elements:
            near = ", ".join(closest(element, self.elements) or self.elements)
            raise DeclarationError("account", "unknown element", value=element, allowed=near)
        return self.elements.index(element)


class TickAccount:
    """Request, residual and limits of every element; plain numbers, ``str()`` is a table.

    elements ``(E,)``: names.  residual ``(E,)``: ||w|| in the element's own units; requested ``(E,)``: ||w|| without
    motion.  shares ``(levels, E + 1)``: fraction of a level's gradient balanced by each element, its own price last; a
    row of zeros if the level is met or nothing above it holds it back.  worth ``(levels,)``: decrease of ||w|| per
    unit of additional motion, c_k ||y_k||.
    """

    __slots__ = ("_fast", "_values", "count", "layout")

    def __init__(self, count: int, layout: Layout, values: Vec, fast: frozenset[str] = frozenset()) -> None:
        self.count, self.layout, self._values, self._fast = count, layout, values, fast

    @property
    def residual(self) -> Vec:
        """||w|| of each element ``(E,)``."""
        return self._values[: 4 * len(self.elements) : 4] * self.layout.inverse

    @property
    def requested(self) -> Vec:
        """||w|| of each element without motion ``(E,)``."""
        return self._values[1 : 4 * len(self.elements) : 4] * self.layout.inverse

    @property
    def shares(self) -> Mat:
        """Fraction of each level's gradient balanced by each element, the price's last ``(levels, E + 1)``."""
        E, levels = len(self.elements), self.layout.count
        return self._values[4 * E : 4 * E + levels * (E + 1)].reshape(levels, E + 1)

    @property
    def worth(self) -> Vec:
        """Decrease of each level per unit of additional motion ``(levels,)``."""
        return self._values[-self.layout.count :]

    @property
    def elements(self) -> tuple[str, ...]:
        """Names, in the order of the numbers."""
        return self.layout.elements

    def met(self, element: str) -> bool:
        """Return true if an element's residual is zero; raises DeclarationError for an unknown name."""
        i = self.layout.place(element)
        return is_zero(float(self.residual[i]), float(self.requested[i]))

    def cause(self, element: str) -> str:
        """Cause of an element's residual, as ``explain.Account.cause``; "" if it is met."""
        if self.met(element):
            return ""
        i, layout = self.layout.place(element), self.layout
        row = self.shares[layout.levels[i]]
        pull, most = self._values[4 * i + 2 : 4 * i + 4]
        if pull <= NOTHING * most:
            return "out of reach"
        if not row.any():
            return "own level"
        return cause_of(self.losses(element), fast=element in self._fast) if row.max() > SHARE else "lost"

    def losses(self, element: str) -> tuple[Loss, ...]:
        """Losses of an element's level, largest share first; raises DeclarationError for an unknown name."""
        row = self.shares[self.layout.levels[self.layout.place(element)]]
        names, limits = (*self.elements, PRICE), (*self.layout.limits, False)
        order = np.argsort(-row, kind="stable")
        return tuple(Loss(names[i], float(row[i]), limit=limits[i]) for i in order.tolist() if row[i] > SHARE)

    def priced(self) -> Iterator[tuple[int, float]]:
        """Elements that their level's price holds back, by number, with its share."""
        if self.worth.any():
            residual, requested, shares = self.residual.tolist(), self.requested.tolist(), self.shares[:, -1].tolist()
            for i, level in enumerate(self.layout.levels):
                short = residual[i] > NOTED * requested[i] and not is_zero(residual[i], requested[i])
                if short and shares[level] > 0.0:
                    yield i, shares[level]

    def __str__(self) -> str:
        names = self.elements
        width = max((len(name) for name in names), default=0)
        lines = []
        for i, name in enumerate(names):
            why = self.cause(name)
            lost = losses_text(self.losses(name), 3) if why else "met"
            lines.append(f"{name:{width}}  {self.residual[i]:9.3g} of {self.requested[i]:9.3g}  {why or lost}")
            if why and lost:
                lines[-1] += f": {lost}"
        return "\n".join(lines)


class Accountant:
    """Makes accounts of a compiled stack: native for native stages, else through an explanation.

    workspace: the account describes its latest solve.
    """

    def __init__(self, program: Program, workspace: object, robot: Robot) -> None:
        places = program.places
        names = tuple(places)
        elements = [place.element for place in places.values()]
        limits = tuple(not element.equality for element in elements)
        inverse = np.array([1.0 / element.weight for element in elements])
        count = len(program.problem.levels)
        self.layout = Layout(names, tuple(place.level for place in places.values()), limits, count, inverse)
        self._program, self._robot, self._rate = program, robot, program.assembly.rate
        starts = np.concatenate(([0], np.cumsum([rows.m for rows in program.problem.levels]))).astype(int).tolist()
        self._owner = np.zeros(starts[-1], dtype=np.int32)
        for i, place in enumerate(places.values()):
            self._owner[starts[place.level] + place.part.start : starts[place.level] + place.part.stop] = i
        native: Workspace | None = getattr(workspace, "native", None)
        known = native is not None and native.accounts(program.problem, self._owner, len(names), NEAR)
        self._native = native if known else None
        self._multipliers: Callable[[], Vec | None] = getattr(workspace, "exact_multipliers", lambda: None)
        self._size = 4 * len(names) + count * (len(names) + 2)

    def account(self, count: int, w: Vec, x: Vec, v: Vec | None = None) -> TickAccount | None:
        """The account of the latest solve, from the slacks of all its rows and its answer x.

        v: velocity of the state, to distinguish too fast from held back; without it nothing is too fast. None if the
        kernel has no multipliers: no kernel, or an answer of another method.
        """
        values = self.values(w, x)
        if values is None:
            return None
        return self.of(count, values, self._fast(w, v) if v is not None and np.count_nonzero(self._rate) else NONE)

    def values(self, w: Vec, x: Vec) -> Vec | None:
        """The numbers of an account."""
        multipliers = self._multipliers()
        if self._native is None or multipliers is None:
            return None
        values = np.empty(self._size)
        self._native.account(w, x, multipliers, values)
        return values

    def of(self, count: int, values: Vec, fast: frozenset[str] = NONE) -> TickAccount:
        """The account of these numbers."""
        return TickAccount(count, self.layout, values, fast)

    def _fast(self, w: Vec, v: Vec) -> frozenset[str]:
        """Elements whose lack is mostly the rate of their reference."""
        problem, found = self._program.problem, set()
        starts = np.concatenate(([0], np.cumsum([rows.m for rows in problem.levels]))).astype(int)
        for name, place in self._program.places.items():
            part = slice(starts[place.level] + place.part.start, starts[place.level] + place.part.stop)
            if too_fast(self._program, name, w[part] / place.element.weight, v):
                found.add(name)
        return frozenset(found)

    def held_back(self, account: TickAccount, w: Vec) -> tuple[HeldBack, ...]:
        """Effects of prices, with the direction in which each element is short."""
        return tuple(self._held(account, w, i, share) for i, share in account.priced())

    def _held(self, account: TickAccount, w: Vec, i: int, share: float) -> HeldBack:
        name, level = self.layout.elements[i], self.layout.levels[i]
        place = self._program.places[name]
        own = w[self._owner == i]
        return HeldBack(
            name,
            place.declared,
            requested=float(account.requested[i]),
            achieved=float(account.requested[i] - account.residual[i]),
            unit=unit_of(place.element, self._program.kind),
            share=share,
            short=Short.of(own, place.element.row_names(self._robot)),
            worth=float(account.worth[level]),
        )


def unit_of(element: Any, kind: str) -> str:
    """Unit of an element's rows, such as m/s."""
    if element.quantity != "motion":
        return "N m" if element.quantity == "effort" else "N"
    units = tuple(dict.fromkeys(element.units)) or ("rad",)
    what = units[0] if len(units) == 1 else f"({', '.join(units)})"
    return what + ("/s" if kind == "velocity" else "/s^2")


def too_fast(program: Program, name: str, w: Vec, v: Vec) -> bool:
    """Return true if more than half of an element's lack, -w in its own units, is the rate of its reference."""
    member = program.assembly.members.get(name)
    if member is None or not member.element.equality:
        return False
    rows, part = program.assembly, member.part
    moving = rows.rate[part]
    if rows.order == 2:
        kd = getattr(member.law, "kd", 0.0)
        speed = v[rows.picks(part)] if member.views.J is None else member.views.J @ v / member.element.weight
        moving = rows.feedforward[part] + kd * (moving - speed)
    return float(-w @ moving) > MOST * float(w @ w) > 0.0


def of_explanation(layout: Layout, count: int, explanation: Explanation) -> TickAccount:
    """Make the account from an explanation, if the kernel has no multipliers."""
    E = len(layout.elements)
    numbers, shares = np.zeros((E, 4)), np.zeros((layout.count, E + 1))
    worth, names = np.zeros(layout.count), (*layout.elements, PRICE)
    fast = frozenset(a.element for a in explanation.accounts if a.cause == "too fast")
    for i, (name, level) in enumerate(zip(layout.elements, layout.levels, strict=True)):
        account = explanation[name]
        numbers[i] = account.residual, account.requested, float(account.cause != "out of reach"), 1.0
        numbers[i, :2] /= layout.inverse[i]
        for loss in account.losses:
            shares[level, names.index(loss.element)] = loss.share
        if account.held_back is not None:
            worth[level] = account.held_back.worth
    return TickAccount(count, layout, np.concatenate([numbers.ravel(), shares.ravel(), worth]), fast)
