"""The centre of mass over a ZMP that the support reaches, after the divergent component of motion."""

from __future__ import annotations

import math
from collections.abc import Sequence, Set
from dataclasses import dataclass, field, replace
from typing import Any, ClassVar, cast

import numpy as np
from numpy.typing import ArrayLike

from hqp.arrays import Mat, Vec
from hqp.declare import plans
from hqp.declare.element import Element, Task
from hqp.declare.law import DCM, Law
from hqp.declare.reference import Reference, numbers
from hqp.declare.robot import Robot, State

from .fields import set_names, set_number
from .polygons import nearest, shrunk, slope
from .support_polygon import SupportPolygon, hull

LEAST = 0.05
"""Least height of the pendulum [m]."""


@dataclass(frozen=True, kw_only=True)
class Balance(Task):
    """Acceleration of the centre of mass c that a ZMP p inside the support makes, fed back from the DCM xi:

        xi = c + dc/dt / omega,  p = hull[z_ref + (1 + k / omega) (xi - xi_ref)],  J_com qdd + dJ/dt v = g (c - p) / h,

    two rows, x and y; k is that of its law, ``DCM(k)``.  hull[.] is the nearest point of the convex hull of the
    support seen from above, h the height of c above p on the plane through the support, which may be sloped, and
    omega = sqrt(g / height).  ``at(zmp, dcm)`` gives z_ref and xi_ref.

    The support is that of the stack's contacts (contacts: a subset of these, by name): the corners of their
    CenterOfPressure, ``margin`` further inside [m], so that the feet can hold p; or points: ((frame, x, y, z), ...)
    [m].  height [m]: height of the pendulum that plans z_ref and xi_ref, None for the height of c above the support.
    For accelerations and torques.  Raises DeclarationError for fields, another law, fewer than three points,
    FrameNotFound on binding (Englsberger, Ott, Albu-Schaeffer 2015, eqs. 7, 16).
    """

    demands: ClassVar[bool] = True

    law: Law | None = field(default_factory=DCM)
    contacts: str | Sequence[str] | None = None
    points: tuple[tuple[Any, ...], ...] = ()
    margin: float = 0.0
    height: float | None = None
    of: tuple[str, ...] = ()
    _soles: ClassVar[Sequence[tuple[str, str, Mat]]] = ()

    def __post_init__(self) -> None:
        super().__post_init__()
        set_names(self, "contacts")
        set_number(self, "margin", 0.0)
        if self.height is not None:
            set_number(self, "height", LEAST)
        if not isinstance(self.law, DCM):
            raise self.invalid("law", self.law, "DCM(k)")
        if isinstance(self.points, tuple) and not self.points:
            return
        if self.contacts is not None:
            raise self.invalid("points", self.points, "either contacts or points")
        object.__setattr__(self, "points", SupportPolygon(points=self.points, name=self.name).points)
        soles: dict[tuple[str, str], list[Any]] = {}
        for name, (frame, *p) in zip(self.of or ("",) * len(self.points), self.points, strict=True):
            soles.setdefault((name, frame), []).append(p)
        object.__setattr__(
            self, "_soles", [(*of, np.array(sole, dtype=np.float64)[..., None]) for of, sole in soles.items()]
        )

    def among(self, elements: Sequence[Element]) -> Element:
        """Return the element with the points of these contacts; raises DeclarationError."""
        if self.points:
            return self
        found = cast(SupportPolygon, SupportPolygon(contacts=self.contacts, name=self.name).among(elements))
        soles: dict[tuple[str, str], list[tuple[float, float]]] = {}
        for name, (frame, x, y, _) in zip(found.of, found.points, strict=True):
            soles.setdefault((name, frame), []).append((x, y))
        corners = [(name, (f, *p, 0.0)) for (name, f), sole in soles.items() for p in shrunk(sole, self.margin)]
        of, points = zip(*corners, strict=True)
        return replace(self, contacts=None, margin=0.0, points=points, of=of)

    def goes_with(self, out: Set[str]) -> bool:
        """Without any of its contacts there is no support."""
        return bool(self.of) and set(self.of) <= out

    def rows(self, robot: Robot) -> int:
        """Two; raises FrameNotFound, DeclarationError without points."""
        for frame, *_ in self.points:
            robot.frame(frame)
        if not self.points:
            raise self.invalid("points", (), "points; in a stack they are taken from its contacts")
        return 2

    def corners(self, state: State) -> Mat:
        """The points in the world ``(m, 3)`` [m], of contacts that are out none."""
        there = [sole for sole in self._soles if sole[0] not in state.out] or self._soles
        return np.concatenate([state.position(f) + (state.rotation(f) @ sole)[..., 0] for _, f, sole in there])

    def value(self, state: State) -> Vec:
        """c from above ``(2,)`` [m]."""
        return state.com()[:2]

    def jacobian(self, state: State) -> Mat:
        """J_com ``(2, nv)``."""
        return state.com_jacobian()[:2]

    def drift(self, state: State) -> Vec:
        """dJ_com/dt v ``(2,)`` [m/s^2]."""
        return state.com_drift()[:2]

    def dcm(self, state: State) -> Vec:
        """xi ``(2,)`` [m], the capture point: with its ZMP there, the robot comes to rest (Pratt et al. 2006)."""
        return _dcm(state, self.omega(state))

    def omega(self, state: State) -> float:
        """sqrt(g / h) [1/s], h the declared height or that above the support."""
        return self._omega(state, self.corners(state))

    def zmp(self, state: State, reference: ArrayLike) -> tuple[Vec, Vec]:
        """Return p ``(2,)``, and its value without the hull ``(2,)`` [m], for z_ref and xi_ref ``(4,)`` [m]."""
        return self._zmp(state, reference, self.corners(state))

    def error(self, state: State, reference: Any) -> Vec:
        """Minus the requested acceleration, g (p - c) / h ``(2,)`` [m/s^2]."""
        corners, c = self.corners(state), state.com()
        p, _ = self._zmp(state, reference, corners)
        return _gravity(state.robot) / self._over(corners, p, c[2]) * (p - c[:2])

    def _zmp(self, state: State, reference: ArrayLike, corners: Mat) -> tuple[Vec, Vec]:
        given, omega = np.asarray(reference, dtype=np.float64), self._omega(state, corners)
        wanted = given[:2] + (1.0 + cast(DCM, self.law).k / omega) * (_dcm(state, omega) - given[2:])
        return nearest(corners[hull(corners[:, :2]), :2], wanted), wanted

    def _omega(self, state: State, corners: Mat) -> float:
        above = self.height or self._over(corners, (c := state.com())[:2], c[2])
        return math.sqrt(_gravity(state.robot) / above)

    def _over(self, corners: Mat, p: Vec, z: float) -> float:
        """Height of z above the plane through the support at p [m]."""
        mean = corners.mean(axis=0)
        return max(float(z - mean[2] - slope(corners) @ (p - mean[:2])), LEAST)

    def hold(self, state: State) -> Reference:
        """ZMP and DCM where the centre of mass is."""
        c = state.com()[:2]
        return Reference(self.name, np.concatenate((c, c)))

    def at(self, zmp: ArrayLike, dcm: ArrayLike) -> Reference:  # type: ignore[override]
        """z_ref and xi_ref of this tick, ``(2,)`` each [m]; raises DeclarationError for shapes."""
        both = numbers(self.name, "zmp", zmp, (2,)), numbers(self.name, "dcm", dcm, (2,))
        return Reference(self.name, np.concatenate(both))

    def row_names(self, robot: Robot) -> tuple[str, ...]:
        """The axes."""
        return ("x", "y")

    def plan(self, robot: Robot) -> plans.Balance:
        """The native operation."""
        self.rows(robot)
        points = tuple((plans.frame(robot, f), tuple(map(float, p))) for f, *p in self.points)
        k, height = float(cast(DCM, self.law).k), float(self.height or 0.0)
        return plans.Balance(points, k, height, _gravity(robot), self.of)


def _dcm(state: State, omega: float) -> Vec:
    return np.asarray(state.com()[:2] + state.com_velocity()[:2] / omega)


def _gravity(robot: Robot) -> float:
    """g [m/s^2]."""
    return math.hypot(*robot.gravity.tolist())
