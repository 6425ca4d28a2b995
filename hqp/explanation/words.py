"""An account of one solution in words: request, residual and losses of each element."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from hqp.arrays import Vec
from hqp.errors import closest
from hqp.problem.certify import Certificate
from hqp.tolerances import ZERO_RESIDUAL

SHARE = 0.01
"""Losses below this fraction of the whole are omitted."""

BINDS = 0.05
"""Share above which a limit is named before levels above: those levels alone would permit the motion."""

PRICE = "its price"
"""Name of a price among the losses."""

OUT_OF_REACH = "out of reach or singular: no motion of the robot reduces the residual"
"""Text of explanations and notes for the cause ``out of reach``."""


def is_zero(residual: float, requested: float) -> bool:
    """Return true if a residual counts as zero relative to the request, for notes, accounts, explanations and the
    viewer."""
    return residual <= ZERO_RESIDUAL * (1.0 + requested)


@dataclass(frozen=True)
class Loss:
    """One element's part in a residual: ``share`` (0 to 1) of the level's gradient that its multipliers balance.

    rows: active rows of an inequality, by name and side.  limit: true for an inequality.
    """

    element: str
    share: float
    rows: tuple[str, ...] = ()
    limit: bool = False

    @property
    def binds(self) -> bool:
        """True for a limit that counts: without it the level would come nearer, regardless of the levels above it."""
        return self.limit and self.share >= BINDS

    def __str__(self) -> str:
        rows = f" ({', '.join(self.rows[:3])}{', ...' if len(self.rows) > 3 else ''})" if self.rows else ""
        return f"{self.element} {100.0 * self.share:.0f} %{rows}"


def losses_text(losses: Sequence[Loss], most: int) -> str:
    """The first few, limits that bind before levels above them."""
    return ", ".join(str(loss) for loss in sorted(losses, key=lambda loss: not loss.binds)[:most])


@dataclass(frozen=True, slots=True)
class Short:
    """The direction in which an element is short: a unit vector ``(m,)`` over its rows, and their names."""

    direction: tuple[float, ...]
    names: tuple[str, ...] = ()

    @staticmethod
    def of(w: Vec, names: tuple[str, ...]) -> Short:
        """The direction -w / ||w||."""
        norm = float(np.sqrt(w @ w))
        return Short(tuple((-w / norm).tolist()) if norm > 0.0 else (0.0,) * w.size, names)

    def __str__(self) -> str:
        """The largest components, as in ``0.98 x, -0.2 z``."""
        size = sorted(range(len(self.direction)), key=lambda i: -abs(self.direction[i]))
        name = [self.names[i] if i < len(self.names) else f"row {i}" for i in range(len(self.direction))]
        return ", ".join(f"{self.direction[i]:.2g} {name[i]}" for i in size[:3] if abs(self.direction[i]) > 0.1)


@dataclass(frozen=True, slots=True)
class HeldBack:
    """Effect of a level's price on one element (docs/calm.md).

    requested: ||w|| without motion.  achieved: decrease of ||w|| from there [unit].  share: the price's fraction of the
    level's gradient, 0 to 1.  short: the direction in which the element is short, where motion moves its rows least.
    worth: decrease of the level's ||w|| per additional unit of motion (1 rad/s, 1 rad/s^2): c_k ||y_k||.
    """

    element: str
    level: str
    requested: float
    achieved: float
    unit: str
    share: float
    short: Short
    worth: float

    def note(self, losses: tuple[Loss, ...], cause: str = "price") -> str:
        """Request, achieved part, and the cause of the rest; cause: see Account."""
        why = "the price on motion outweighs the rest"
        if cause == "out of reach":
            why = f"the rest is {OUT_OF_REACH}"
        elif losses and losses[0].element != PRICE:
            why = f"the rest is held by {losses_text(losses, 3)}"
        achieved = f"requested {self.requested:.3g} {self.unit}, achieved {self.achieved:.3g}"
        return f"{achieved}, short along ({self.short}): {why}"

    def __str__(self) -> str:
        return self.note(())


@dataclass(frozen=True)
class Account:
    """One element: its level, the norm of its residual in its own units, and its losses, largest first.

    cause: "" if it is met, else ``lost`` to levels above, ``limit`` (held by an inequality with a share of BINDS or
    more, its rows named: the levels above alone would permit the motion), ``own level`` (opposed by named elements),
    ``out of reach`` (no motion of the robot reduces the residual), ``price`` (the price on motion outweighs the rest),
    ``too fast`` (the rate of its reference exceeds half of its residual), ``off`` (inactive in this tick, and so met).
    requested: ||w|| at the point of least motion.  unit: unit of residual and requested.  held_back: effect of the
    price, or None.
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
    requested: float = 0.0
    held_back: HeldBack | None = None
    unit: str = ""


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


def _outcome(account: Account) -> str:
    if account.cause == "off":
        return "off"
    if account.active:
        listed = ", ".join(account.active[:4]) + (", ..." if len(account.active) > 4 else "")
        return f"active: {listed}"
    if account.met:
        return "met"
    if account.cause == "out of reach":
        return OUT_OF_REACH
    if account.cause == "own level":
        return "conflicts with " + (", ".join(account.fights) or "itself") + " in its own level"
    losses = losses_text(account.losses, 4)
    if account.cause == "price":
        return f"held back by its price: {account.held_back}" + (f" ({losses})" if len(account.losses) > 1 else "")
    if account.held_back is not None and account.held_back.share > SHARE:
        losses += (
            f"; requested {account.requested:.3g}, achieved {account.requested - account.residual:.3g} {account.unit}"
        )
    if account.cause == "too fast":
        return f"too fast: {losses} allow less than the rate of its reference"
    if account.cause == "limit":
        return f"held by {losses}"
    return f"lost to {losses}" if losses else "lost"
