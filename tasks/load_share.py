"""Distribution of a common load between two contacts."""

from __future__ import annotations

import math
from collections.abc import Sequence, Set
from dataclasses import dataclass, replace
from typing import Any, ClassVar

import numpy as np
from numpy.typing import ArrayLike

from hqp.declare.element import Element, Quantity
from hqp.declare.reference import Reference, numbers
from hqp.declare.robot import Robot

from .fields import set_number
from .friction import CenterOfPressure


@dataclass(frozen=True, kw_only=True)
class LoadShare(Element):
    """Two face contacts bear one wrench together; the second one's share of it is s, from 0 to 1:

        (1 - s) w_2 - s w_1 = 0,    w_i = (f_i, m_i / a),

    six rows [N], f_i and m_i force and moment about the middle of contact i in world axes.  With them w_1 = (1 - s) w
    and w_2 = s w for the whole wrench w about the point (1 - s) p_1 + s p_2 between the middles: for any w of the
    motion, one s determines all twelve components, and only limits of the forces can conflict with it.  At s = 0 the
    second contact bears nothing and may be released.

    contacts: two, by name.  share: s without a reference; ``at(share)`` for one tick.  a [m]: ``arm``.  middles:
    ((x, y), (x, y)) in the contact frames [m], those of the contacts' CenterOfPressure in the stack by default, else
    the frames' origins.  For torques.  Raises DeclarationError for fields and for contacts that are no faces.
    """

    quantity: ClassVar[Quantity] = "force"

    contacts: tuple[str, str]
    share: float = 0.5
    arm: float = 0.1
    middles: tuple[tuple[float, float], ...] = ()

    def __post_init__(self) -> None:
        names = self.contacts
        fits = isinstance(names, (tuple, list)) and len(names) == 2 and all(isinstance(n, str) and n for n in names)
        if not fits or names[0] == names[1]:
            raise self.invalid("contacts", names, "the names of two contacts in subject_to")
        object.__setattr__(self, "contacts", tuple(names))
        super().__post_init__()
        set_number(self, "share", 0.0, most=1.0)
        set_number(self, "arm", 0.0, strict=True)
        if not isinstance(self.middles, tuple) or self.middles:
            try:
                given = np.array(self.middles, dtype=np.float64)
            except (TypeError, ValueError, OverflowError):
                given = np.full(1, math.nan)
            if given.shape != (2, 2) or not np.isfinite(given).all():
                raise self.invalid("middles", self.middles, "((x, y), (x, y)), finite")

    def default_name(self) -> str:
        """load_share."""
        return "load_share"

    def among(self, elements: Sequence[Element]) -> Element:
        """Return the element with the middles of the contacts' centres of pressure."""
        if self.middles:
            return self
        found = {e.contact: e.corners() for e in elements if isinstance(e, CenterOfPressure)}
        middles: list[tuple[float, float]] = []
        for name in self.contacts:
            corners = np.array(found.get(name, ((0.0, 0.0),)))
            x, y = (0.5 * (corners.min(axis=0) + corners.max(axis=0))).tolist()
            middles.append((x, y))
        return replace(self, middles=tuple(middles))

    def goes_with(self, out: Set[str]) -> bool:
        """Without either contact there is nothing to share."""
        return not out.isdisjoint(self.contacts)

    def rows(self, robot: Robot) -> int:
        """Six."""
        return 6

    def hold(self, state: Any) -> Reference:
        """The share as declared."""
        return Reference(self.name, np.array([self.share]))

    def at(self, share: ArrayLike) -> Reference:
        """The second contact's share in this tick, held from 0 to 1; raises DeclarationError for no number."""
        return Reference(self.name, numbers(self.name, "share", np.atleast_1d(share), (1,)))

    def row_names(self, robot: Robot) -> tuple[str, ...]:
        """The components."""
        return ("fx", "fy", "fz", "mx", "my", "mz")
