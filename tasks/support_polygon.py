"""The centre of mass over the feet."""

from __future__ import annotations

import math
from collections.abc import Iterable, Sequence, Set
from dataclasses import dataclass, replace
from typing import Any, ClassVar

import numpy as np
from numpy.typing import ArrayLike

from hqp.arrays import Mat, Vec
from hqp.declare import plans
from hqp.declare.element import Element
from hqp.declare.reference import Reference, numbers
from hqp.declare.robot import Robot, State

from .barrier import _Barrier
from .contact import PointContact
from .edge import EdgeContact
from .fields import set_names, set_number
from .friction import CenterOfPressure

FLAT = 2e-5
"""A corner this near to the line between its neighbours does not count [m]: rows of feet in line do not come and go."""


@dataclass(frozen=True, kw_only=True)
class SupportPolygon(_Barrier):
    """The centre of mass c above the convex hull of points on the ground, a margin inside: n . (c - p) <= -margin,

    one row for each point p, n the outward normal of the edge of the hull that starts there, free for a point inside
    the hull.  J = n . J_com; the points are those of contacts, which stand still.

    Without points and polygon they are those of the stack's contacts (contacts: a subset of these, by name): the
    corners of its CenterOfPressure, those of sole = (x_min, x_max, y_min, y_max) [m] in the frame of a face that has
    none, the origin of a PointContact or a wheel.  points: ((frame, x, y, z), ...) in the frames' axes [m], found anew
    each tick.  polygon: ((x, y), ...) in the world [m]; ``at`` gives another one for a tick.  margin [m].  of: contact
    of each point, which is not part of the hull while the contact is out; filled in with them.  rate [1/s], recovery
    [m/s], acceleration [m/s^2]: see ``Within``, slower by default, because a foot can push the body aside only a
    little.  Raises DeclarationError for fields, fewer than three points and faces of unknown size, FrameNotFound on
    binding.
    """

    steered: ClassVar[bool] = True

    contacts: str | Sequence[str] | None = None
    sole: tuple[float, float, float, float] | None = None
    points: tuple[tuple[Any, ...], ...] = ()
    polygon: tuple[tuple[float, float], ...] = ()
    margin: float = 0.0
    recovery: float = 0.1
    of: tuple[str, ...] = ()

    def __post_init__(self) -> None:
        for what in ("points", "polygon"):
            given = getattr(self, what)
            if not isinstance(given, tuple) and np.size(given) == 0:  # the default is a tuple
                raise self.invalid(what, given, "at least three points")
        super().__post_init__()
        set_names(self, "contacts")
        set_number(self, "margin", 0.0)
        if self.sole is not None:
            CenterOfPressure(contact="sole", rectangle=self.sole)  # raises the error
        for what, count in (("points", 4), ("polygon", 2)):
            self._set_rows(what, count)
        if bool(self.points) + bool(self.polygon) + (self.contacts is not None or self.sole is not None) > 1:
            raise self.invalid("points", self.points or self.polygon, "one of contacts, points and polygon")
        if self.polygon and len(hull(np.array(self.polygon, dtype=np.float64))) < 3:
            raise self.invalid("polygon", self.polygon, "corners that are not on one line")

    def _set_rows(self, what: str, count: int) -> None:
        given = getattr(self, what)
        try:
            rows = tuple(tuple(p) for p in given)
            values = [[float(x) for x in p[count == 4 :]] for p in rows]
            fits = all(len(p) == count and isinstance(p[0], str) >= (count == 4) for p in rows)
            fits = fits and all(math.isfinite(x) for p in values for x in p)
        except (TypeError, ValueError, OverflowError):
            rows, fits = (), False
        if not fits or 0 < len(rows) < 3:
            allowed = "((frame, x, y, z), ...)" if count == 4 else "((x, y), ...)"
            raise self.invalid(what, given, f"{allowed} [m], at least three")
        object.__setattr__(self, what, rows)

    def default_name(self) -> str:
        """support_polygon."""
        return "support_polygon"

    def among(self, elements: Sequence[Element]) -> Element:
        """Return the element with the points of these contacts; raises DeclarationError."""
        if self.points or self.polygon:
            return self
        contacts = {e.name: e for e in elements if e.is_contact}
        wanted = (self.contacts,) if isinstance(self.contacts, str) else self.contacts or tuple(contacts)
        points: list[tuple[Any, ...]] = []
        of: list[str] = []
        for name in wanted:
            if name not in contacts:
                raise self.invalid(
                    "contacts", name, ", ".join(contacts) or "names of contacts of the stack, which has none"
                )
            points += self._corners(contacts[name], elements)
            of += [name] * (len(points) - len(of))
        if len(points) < 3:
            raise self.invalid("points", tuple(points), "at least three, of the stack's contacts or points=...")
        return replace(self, contacts=None, sole=None, points=tuple(points), of=tuple(of))

    def goes_with(self, out: Set[str]) -> bool:
        """Without any of its contacts there is no support."""
        return bool(self.of) and set(self.of) <= out

    def _corners(self, contact: Any, elements: Iterable[Element]) -> list[tuple[Any, ...]]:
        """Points of one contact, in the axes of its frame."""
        frame = getattr(contact, "frame", None) or getattr(contact, "wheel", None)
        if isinstance(contact, PointContact) or contact.grounded:
            return [(frame, 0.0, 0.0, 0.0)]
        known = [e for e in elements if isinstance(e, CenterOfPressure) and e.contact == contact.name]
        if not known and self.sole is not None and not isinstance(contact, EdgeContact):
            known = [CenterOfPressure(contact=contact.name, rectangle=self.sole)]
        if not known or frame is None:
            allowed = "sole=(x_min, x_max, y_min, y_max), points=... or a CenterOfPressure of it"
            raise self.invalid(f"the sole of {contact.name} has no size", None, allowed)
        return [(frame, x, y, 0.0) for x, y in known[0].corners()]

    def rows(self, robot: Robot) -> int:
        """One for each point; raises FrameNotFound, DeclarationError without points."""
        for frame, *_ in self.points:
            robot.frame(frame)
        count = len(self.points or self.polygon)
        if count == 0:
            raise self.invalid("points", (), "points or a polygon; in a stack they are taken from its contacts")
        return count

    def hold(self, state: State) -> Reference:
        """The declared polygon ``(m, 2)`` [m]; no value for points of frames."""
        return Reference(self.name, np.array(self.polygon, dtype=np.float64) if self.polygon else None)

    def at(self, polygon: ArrayLike) -> Reference:
        """The polygon of this tick, as many corners ``(m, 2)`` in the world [m] as declared; a corner may occur twice.

        Raises DeclarationError for shapes, and for an element whose points are those of frames.
        """
        if not self.polygon:
            raise self.invalid(
                "polygon", polygon, "polygon=... in the declaration, for points of frames move by themselves"
            )
        return Reference(self.name, numbers(self.name, "polygon", polygon, (len(self.polygon), 2)))

    def corners(self, state: State, polygon: Mat | None = None) -> Mat:
        """The points in the world ``(m, 2)`` [m]."""
        if self.polygon:
            return np.array(self.polygon if polygon is None else polygon, dtype=np.float64)
        placed = [state.position(f) + state.rotation(f) @ np.array(p, dtype=np.float64) for f, *p in self.points]
        return np.array(placed)[:, :2]

    def edges(self, state: State, polygon: Mat | None = None) -> tuple[Mat, Vec]:
        """Outward normals ``(m, 2)`` and n . p ``(m,)`` of the edges that start at each point; zero, inf for none."""
        corners = self.corners(state, polygon)
        normals, offsets = np.zeros_like(corners), np.full(len(corners), math.inf)
        found = among_present(corners, present(self.of, state))
        for i, j in zip(found, found[1:] + found[:1], strict=True):
            along = corners[j] - corners[i]
            length = math.hypot(*along)
            if length > 0.0:
                normals[i] = np.array([along[1], -along[0]]) / length
                offsets[i] = float(normals[i] @ corners[i])
        return normals, offsets

    def bounds(self, state: State, polygon: Mat | None = None) -> tuple[float, Vec]:
        """(-inf, n . (p - c) - margin) [m], infinite for a point inside."""
        normals, offsets = self.edges(state, polygon)
        return -math.inf, offsets - normals @ state.com()[:2] - self.margin

    def jacobian(self, state: State, polygon: Mat | None = None) -> Mat:
        """n . J_com ``(m, nv)``."""
        return self.edges(state, polygon)[0] @ state.com_jacobian()[:2]

    def drift(self, state: State, polygon: Mat | None = None) -> Vec:
        """n . dJ_com/dt v ``(m,)`` [m/s^2]."""
        return self.edges(state, polygon)[0] @ state.com_drift()[:2]

    def row_names(self, robot: Robot) -> tuple[str, ...]:
        """The frames of the points, numbered."""
        return tuple(f"{frame} {i}" for i, (frame, *_) in enumerate(self.points))

    def plan(self, robot: Robot) -> plans.SupportPolygon:
        """The native operation."""
        self.rows(robot)
        points = tuple((plans.frame(robot, f), tuple(map(float, p))) for f, *p in self.points)
        polygon = tuple((float(x), float(y)) for x, y in self.polygon)
        return plans.SupportPolygon(points, polygon, self.margin, self.rate, self.recovery, self.outset, self.of)


def present(of: Sequence[str], state: State) -> list[int]:
    """Indices of the points that are present: points of contacts that are in."""
    return [i for i, name in enumerate(of) if name not in state.out]


def among_present(points: Mat, there: Sequence[int]) -> list[int]:
    """The hull of those points alone, of all where none is named."""
    return [there[i] for i in hull(points[list(there)])] if there else hull(points)


def hull(points: Mat) -> list[int]:
    """Corners of the convex hull, counter-clockwise from the lowest x (Andrew's monotone chain), without flat ones."""
    at: list[list[float]] = points.tolist()
    order = sorted(range(len(at)), key=at.__getitem__)
    halves: list[list[int]] = []
    for sequence in (order, order[::-1]):
        half: list[int] = []
        for i in sequence:
            while len(half) >= 2 and _turn(at[half[-2]], at[half[-1]], at[i]) <= 0.0:
                half.pop()
            half.append(i)
        halves.append(half[:-1])
    found = halves[0] + halves[1]
    while len(found) > 3:
        n = len(found)
        off = [_off(at[found[k - 1]], at[found[k]], at[found[(k + 1) % n]]) for k in range(n)]
        least = min(range(n), key=off.__getitem__)
        if off[least] > FLAT:
            break
        del found[least]
    return found or order[:1]


def _turn(o: Sequence[float], a: Sequence[float], b: Sequence[float]) -> float:
    """Twice the area of the triangle, positive counter-clockwise [m^2]."""
    (x, y), (u, v), (s, t) = o, a, b
    return (u - x) * (t - y) - (v - y) * (s - x)


def _off(o: Sequence[float], a: Sequence[float], b: Sequence[float]) -> float:
    """Distance of a from the line from o to b [m]."""
    return abs(_turn(o, a, b)) / max(math.dist(o, b), FLAT)
