"""Limits of contact forces: pushing only, inside the friction cone, inside the sole."""

from __future__ import annotations

import math
from abc import abstractmethod
from dataclasses import dataclass
from typing import ClassVar

import numpy as np

from hqp.arrays import Mat, Vec
from hqp.declare.element import Constraint, Quantity
from hqp.declare.robot import Robot
from hqp.numbers import whole

from .fields import set_number


@dataclass(frozen=True, kw_only=True)
class _ContactForce(Constraint):
    """Rows on the force of the ground on the robot at one contact, named by ``contact``.

    z is the ground's normal: vertical, the contact's ``normal``, or that of ``contact.at(normal=n)``.  x is the x axis
    of the contact's frame projected on the ground (y instead if x is along the normal).  In these axes the force is f
    ``(3,)`` [N] of a point or a wheel (rolling, lateral, normal), or the wrench [f, m] ``(6,)`` [N, N m] about the
    frame's origin of a face, whose z axis is near the normal.
    """

    quantity: ClassVar[Quantity] = "force"
    equality: ClassVar[bool] = False
    suffix: ClassVar[str]

    contact: str

    def __post_init__(self) -> None:
        if not isinstance(self.contact, str) or not self.contact:
            raise self.invalid("contact", self.contact, "the name of a contact in the stack")
        super().__post_init__()

    def default_name(self) -> str:
        """The contact's name and the kind of limit."""
        return f"{self.contact}_{self.suffix}"

    @abstractmethod
    def force_rows(self, dimension: int) -> tuple[Mat, Vec, Vec]:
        """(C ``(k, dimension)``, lower ``(k,)``, upper ``(k,)``) with lower <= C f <= upper, dimension 3 or 6.

        Raises DeclarationError for a dimension that has no such rows.
        """

    def rows(self, robot: Robot) -> int:
        """Number of rows k, the same on every robot."""
        return self.force_rows(6)[1].size

    def _check_dimension(self, dimension: int, *allowed: int) -> None:
        if dimension not in allowed:
            names = {3: "3 (a force)", 6: "6 (a wrench)"}
            raise self.invalid(
                f"dimension of {self.contact}", dimension, " or ".join(names[d] for d in allowed) + " for these rows"
            )


@dataclass(frozen=True, kw_only=True)
class UnilateralContact(_ContactForce):
    """The ground pushes, it does not pull: f_z >= minimum, one row.

    contact: name of the contact.  minimum [N]: a load to keep, zero by default.  Raises DeclarationError for fields.
    """

    suffix: ClassVar[str] = "unilateral"

    minimum: float = 0.0

    def __post_init__(self) -> None:
        super().__post_init__()
        set_number(self, "minimum", 0.0)

    def force_rows(self, dimension: int) -> tuple[Mat, Vec, Vec]:
        """The row of f_z."""
        self._check_dimension(dimension, 3, 6)
        C = np.zeros((1, dimension))
        C[0, 2] = 1.0
        return C, np.array([self.minimum]), np.array([math.inf])


@dataclass(frozen=True, kw_only=True)
class FrictionCone(_ContactForce):
    """No slip: the tangential force stays inside a pyramid inside the cone |f_t| <= mu f_z, one row an edge.

    With edge directions at 2 pi i / edges from x, the face between two of them requires cos(b) f_x + sin(b) f_y <= mu
    cos(pi / edges) f_z, b halfway: conservative, exact along the edge directions, so also along x (and with an even
    number of edges along -x, with a multiple of four along y).  f_z >= 0 is implied.  mu: friction coefficient.  edges:
    at least 3.  torsion [m]: with a wrench also |m_z| <= torsion f_z, two rows, divided by torsion, so that they are in
    N as the others are (a torsion of zero leaves |m_z| <= 0 in N m); inf leaves m_z free.  sole: (x_min, x_max, y_min,
    y_max) [m] in its place: m_z is limited by forces in these four corners, each inside the square |f_x|, |f_y| <= mu /
    sqrt(2) f_z inside its cone, so it is smaller near an edge and zero with the centre of pressure in a corner; eight
    rows (Caron, Pham, Nakamura 2015, eq. 19).  With neither, a session takes the sole from a ``CenterOfPressure`` of
    the same contact (the largest rectangle in its polygon); without one m_z is free.  Raises DeclarationError for
    fields.
    """

    suffix: ClassVar[str] = "friction"

    mu: float
    edges: int = 8
    torsion: float | None = None
    sole: tuple[float, float, float, float] | None = None

    def __post_init__(self) -> None:
        super().__post_init__()
        set_number(self, "mu", 0.0, strict=True)
        object.__setattr__(self, "edges", whole(self.owner, "edges", self.edges, 3))
        if self.torsion is not None:
            set_number(self, "torsion", 0.0, infinite=True)
        if self.sole is None:
            return
        if self.torsion is not None:
            raise self.invalid("torsion and sole", (self.torsion, self.sole), "at most one of them")
        try:
            sole = np.array(self.sole, dtype=np.float64)
        except (TypeError, ValueError, OverflowError):
            sole = np.zeros(0)
        if sole.shape != (4,) or not np.isfinite(sole).all() or not (sole[0] < sole[1] and sole[2] < sole[3]):
            raise self.invalid("sole", self.sole, "(x_min, x_max, y_min, y_max), finite, x_min < x_max, y_min < y_max")
        object.__setattr__(self, "sole", tuple(sole.tolist()))

    def force_rows(self, dimension: int) -> tuple[Mat, Vec, Vec]:
        """mu cos(pi / edges) f_z - cos(b) f_x - sin(b) f_y >= 0, then f_z -+ m_z / torsion >= 0 [N], or those of sole:

        mu' (X + Y) f_z -+ m_z - s (Y f_x +- mu' m_x) - t (X f_y +- mu' m_y) >= 0,    s, t = +-1, mu' = mu / sqrt(2),

        about the sole's middle, X and Y its half sizes, divided by X + Y.
        """
        torsion = None if self.torsion == math.inf else self.torsion
        if torsion is None and self.sole is None:
            self._check_dimension(dimension, 3, 6)
        else:
            self._check_dimension(dimension, 6)
        half = math.pi / self.edges
        b = half + 2.0 * half * np.arange(self.edges)
        k = self.edges + (8 if self.sole is not None else 0 if torsion is None else 2)
        C = np.zeros((k, dimension))
        C[: self.edges, 0], C[: self.edges, 1], C[: self.edges, 2] = -np.cos(b), -np.sin(b), self.mu * math.cos(half)
        if torsion is not None:
            C[self.edges :, 2], C[self.edges :, 5] = torsion, (-1.0, 1.0)
            C[self.edges :] /= torsion or 1.0
        if self.sole is not None:
            C[self.edges :] = _turning(self.mu * math.sqrt(0.5), *self.sole)
        return C, np.zeros(k), np.full(k, math.inf)


@dataclass(frozen=True, kw_only=True)
class ForceLimits(_ContactForce):
    """Limits on the force of a contact, a Weld or a coupling: |f_i| <= force, |m_i| <= moment, a row a component.

    force [N] and moment [N m]: None sets no bound; a coupling has one component, which ``force`` bounds, [N m] between
    turning joints.  The axes are the contact's, of a Weld those of its ``relative_to``.  Raises DeclarationError for
    fields, and for a moment where the constraint has none.
    """

    suffix: ClassVar[str] = "limits"

    force: float | None = None
    moment: float | None = None

    def __post_init__(self) -> None:
        super().__post_init__()
        for what in ("force", "moment"):
            if getattr(self, what) is not None:
                set_number(self, what, 0.0)
        if self.force is None and self.moment is None:
            raise self.invalid("force and moment", None, "at least one of them")

    def force_rows(self, dimension: int) -> tuple[Mat, Vec, Vec]:
        """Rows of the identity, -bound, bound."""
        if self.moment is not None:
            self._check_dimension(dimension, 6)
        most = [self.force] * min(3, dimension) + [self.moment] * (dimension - 3)
        picked = [i for i, bound in enumerate(most) if bound is not None]
        bounds = np.array([most[i] for i in picked], dtype=np.float64)
        return np.eye(dimension)[picked], -bounds, bounds


@dataclass(frozen=True, kw_only=True)
class CenterOfPressure(_ContactForce):
    """No tipping: the centre of pressure (-m_y, m_x) / f_z stays inside a convex polygon, one row a side.

    For a side from a to b, counter-clockwise, with unit outward normal n: ((n. a) f_z + n_x m_y - n_y m_x) / h >= 0
    [N], h half the longer side of the polygon's box, so that it weighs as much as friction where not all can hold; all
    sides together require f_z >= 0.  Exactly one of rectangle: (x_min, x_max, y_min, y_max), and polygon: at least
    three corners (x, y) in order, in the contact frame [m].  Raises DeclarationError for fields.
    """

    suffix: ClassVar[str] = "cop"

    rectangle: tuple[float, float, float, float] | None = None
    polygon: tuple[tuple[float, float], ...] | None = None

    def __post_init__(self) -> None:
        super().__post_init__()
        if (self.rectangle is None) == (self.polygon is None):
            given = (self.rectangle, self.polygon)
            raise self.invalid("rectangle and polygon", given, "exactly one of them")
        for what, width in (("rectangle", 4), ("polygon", 2)):
            value = getattr(self, what)
            if value is not None:
                object.__setattr__(self, what, self._numbers(what, value, width))
        corners = self.corners()
        if len(corners) < 3 or not _convex(corners):
            allowed = (
                "corners of a convex polygon, in order" if self.rectangle is None else "x_min < x_max, y_min < y_max"
            )
            raise self.invalid(
                "polygon" if self.rectangle is None else "rectangle", self.polygon or self.rectangle, allowed
            )

    def _numbers(self, what: str, value: object, width: int) -> tuple[object, ...]:
        allowed = "(x_min, x_max, y_min, y_max)" if width == 4 else "corners (x, y), finite"
        try:
            array = np.array(value, dtype=np.float64)
        except (TypeError, ValueError, OverflowError):
            raise self.invalid(what, value, allowed) from None
        right = array.shape == (4,) if width == 4 else array.ndim == 2 and array.shape[1] == 2
        if not right or not np.isfinite(array).all():
            raise self.invalid(what, value, allowed)
        return tuple(array.tolist()) if width == 4 else tuple(tuple(corner) for corner in array.tolist())

    def corners(self) -> tuple[tuple[float, float], ...]:
        """Corners of the polygon, counter-clockwise [m]."""
        if self.rectangle is not None:
            x, X, y, Y = self.rectangle
            return ((x, y), (X, y), (X, Y), (x, Y))
        corners = self.polygon or ()
        return corners if _area(corners) > 0.0 else corners[::-1]

    def force_rows(self, dimension: int) -> tuple[Mat, Vec, Vec]:
        """((n . a) f_z + n_x m_y - n_y m_x) / h >= 0 for every side [N]."""
        self._check_dimension(dimension, 6)
        a = np.array(self.corners())
        side = np.roll(a, -1, axis=0) - a
        normal = np.column_stack((side[:, 1], -side[:, 0])) / np.hypot(side[:, 0], side[:, 1])[:, None]
        C = np.zeros((len(a), 6))
        C[:, 2] = np.sum(normal * a, axis=1)
        C[:, 3], C[:, 4] = -normal[:, 1], normal[:, 0]
        C /= 0.5 * float(np.max(np.ptp(a, axis=0)))
        return C, np.zeros(len(a)), np.full(len(a), math.inf)


def _turning(mu: float, x: float, X: float, y: float, Y: float) -> Mat:
    """Rows ``(8, 6)`` of the yaw moment of forces in the corners of a rectangle, inside pyramids of mu each [N]."""
    half, wide = 0.5 * (X - x), 0.5 * (Y - y)
    rows = []
    for turn in (1.0, -1.0):
        for s in (1.0, -1.0):
            for t in (1.0, -1.0):
                rows.append([s * wide, t * half, mu * (half + wide), -turn * s * mu, -turn * t * mu, turn])
    C = np.array(rows)
    to_middle = np.eye(6)
    a, b = 0.5 * (x + X), 0.5 * (y + Y)
    to_middle[3, 2], to_middle[4, 2], to_middle[5, 0], to_middle[5, 1] = -b, a, b, -a
    moved: Mat = C @ to_middle / (half + wide)
    return moved


def _area(corners: tuple[tuple[float, float], ...]) -> float:
    """Twice the signed area, positive counter-clockwise."""
    following = (*corners[1:], *corners[:1])
    return sum(x * v - u * y for (x, y), (u, v) in zip(corners, following, strict=True))


def _convex(corners: tuple[tuple[float, float], ...]) -> bool:
    """Return true if every corner turns left, once around."""
    n, turning = len(corners), 0.0
    for i in range(n):
        (a, b), (c, d), (e, f) = corners[i], corners[(i + 1) % n], corners[(i + 2) % n]
        cross = (c - a) * (f - d) - (d - b) * (e - c)
        if cross <= 0.0:
            return False
        turning += math.atan2(cross, (c - a) * (e - c) + (d - b) * (f - d))
    return turning < 1.5 * math.tau
