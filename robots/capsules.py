"""Capsules around the links of a robot, fitted to their surfaces; ``hqp capsules ROBOT`` writes them as TOML."""

from __future__ import annotations

import math
from collections.abc import Mapping, Sequence
from typing import Any

import numpy as np

from hqp.arrays import Mat, Vec, right_vectors
from hqp.collision_library import Placement, coal, convex_hull, solid
from hqp.progress import tracked
from hqp.shapes import LinkCapsule

from .surface import Surface, sphere, surface

NEAR, SHARE = 0.01, 0.1
"""Points of the capsules are on average at most NEAR [m], or SHARE of the link's size, off the link's convex hull."""
TIGHT = 0.8
"""Share of these bounds that the fit must reach, so that other points on the capsules keep them as well."""
MOST = 16
"""Most capsules of a link."""
_SKIN = 60
_ROUNDING = 1e-9
_DOT = 1e-9
_BALL, _DIRECTIONS = sphere(200), sphere(40)
_POINT, _HERE, _REQUEST = coal.Sphere(_DOT), Placement.Identity(), coal.DistanceRequest()

Capsule = tuple[Vec, Vec, float]


def fitted(robot: Any) -> tuple[LinkCapsule, ...]:
    """Capsules that hold the collision shapes of each body that moves."""
    return fit_surfaces(robot, surfaces(robot))


def surfaces(robot: Any) -> dict[int, Surface]:
    """Surface of the collision shapes that each joint carries, in its axes; raises ModelError without shapes."""
    found: dict[int, list[Surface]] = {}
    for item in robot.read_shapes("collision").geometryObjects:
        joint = int(item.parentJoint)
        if joint > 0 and type(item.geometry).__name__ not in ("Halfspace", "Plane"):
            found.setdefault(joint, []).append(surface(item, around=True))
    return {
        joint: Surface(np.concatenate([s.triangles for s in parts]), np.concatenate([s.radii for s in parts]))
        for joint, parts in sorted(found.items())
    }


def fit_surfaces(robot: Any, surfaces: Mapping[int, Surface]) -> tuple[LinkCapsule, ...]:
    """Capsules around each of the surfaces, by joint."""
    found: list[LinkCapsule] = []
    title = f"fitting capsules to {len(surfaces)} links of {robot.name}"
    for joint, part in tracked(surfaces.items(), title, lambda item: len(item[1].radii)):
        name = link_name(robot, joint)
        fits = fit(part)
        for k, (a, b, radius) in enumerate(fits):
            title = name if len(fits) == 1 else f"{name}/{k}"
            found.append(LinkCapsule(title, joint, tuple(a.tolist()), tuple(b.tolist()), radius, True))
    return tuple(found)


def fit(part: Surface) -> list[Capsule]:
    """Capsules that contain a surface and stay close to its convex hull: ends and radius [m].

    The surface is cut by planes until points of the capsules are as near to the hull as ``TIGHT`` and ``NEAR`` require,
    or there are ``MOST`` capsules.  Each piece, cut triangles included, lies in a capsule of its own: a capsule is
    convex, so it contains a triangle if it contains the corners.
    """
    room = Room(part)
    pieces = [(part, _fit_one(*_corners(part)))]
    best, least = [pieces[0][1]], room.excess([pieces[0][1]])
    while least > room.allowed and len(pieces) < MOST:
        waste = [room.waste(capsule) for _, capsule in pieces]
        for k in np.argsort(waste)[::-1]:
            halves = _halved(room, *pieces[k])
            if halves is not None:
                pieces[k : k + 1] = [(half, _fit_one(*_corners(half))) for half in halves]
                break
        else:
            break
        found = [capsule for _, capsule in pieces]
        if room.excess(found) < least:
            best, least = found, room.excess(found)
    return best


def _halved(room: Room, part: Surface, capsule: Capsule) -> tuple[Surface, Surface] | None:
    """The cut whose two capsules waste the least room; None for a surface that is a point or a segment."""
    points = part.triangles.reshape(-1, 3)
    a, b, _ = capsule
    axes = [*right_vectors(_hull(points) - points.mean(axis=0))[1], *np.eye(3)]
    if np.linalg.norm(b - a) > 1e-6:
        axes.append((b - a) / np.linalg.norm(b - a))
    best, least = None, math.inf
    for normal in axes:
        along = points @ normal
        for share in (0.3, 0.5, 0.7):
            halves = cut(part, normal, along.min() + share * np.ptp(along))
            if min(len(half.radii) for half in halves) == 0:
                continue
            waste = sum(room.waste(_roughly(*_corners(half))) for half in halves)
            if waste < least:
                best, least = halves, waste
    return best


def cut(part: Surface, normal: Vec, place: float) -> tuple[Surface, Surface]:
    """The parts of a surface below and above the plane normal . x = place; triangles across it are cut in three."""
    height = part.triangles @ normal - place
    above = height > 0.0
    whole = above.all(axis=1) | ~above.any(axis=1)
    sides = [[part.triangles[whole & (above[:, 0] == up)]] for up in (False, True)]
    radii = [[part.radii[whole & (above[:, 0] == up)]] for up in (False, True)]
    rows = np.flatnonzero(~whole)
    odd_up = above[rows].sum(axis=1) == 1  # one corner above; otherwise one below
    lone = np.where(odd_up, np.argmax(above[rows], axis=1), np.argmin(above[rows], axis=1))
    p, q, r = (part.triangles[rows, (lone + k) % 3] for k in range(3))
    hp, hq, hr = (height[rows, (lone + k) % 3][:, None] for k in range(3))
    x, y = p + (q - p) * (hp / (hp - hq)), p + (r - p) * (hp / (hp - hr))
    for up in (False, True):
        corner, rest = odd_up == up, odd_up != up
        sides[up] += [np.stack((p, x, y), axis=1)[corner]]
        sides[up] += [np.stack((q, r, x), axis=1)[rest], np.stack((r, y, x), axis=1)[rest]]
        radii[up] += [part.radii[rows][chosen] for chosen in (corner, rest, rest)]
    below, over = (Surface(np.concatenate(t), np.concatenate(r)) for t, r in zip(sides, radii, strict=True))
    return below, over


class Room:
    """The convex hull of a surface, and how far capsules stand out of it, by coal."""

    def __init__(self, part: Surface) -> None:
        points = np.concatenate([(c[:, None] + r * _BALL).reshape(-1, 3) if r > 0.0 else c for c, r in _grouped(part)])
        hull = convex_hull(points)
        self._hull = solid(hull)
        self._normals, self._offsets = hull.equations[:, :3], hull.equations[:, 3]
        spread = hull.points[hull.vertices] - points.mean(axis=0)
        sizes = np.ptp(spread, axis=0), np.ptp(spread @ right_vectors(spread)[1].T, axis=0)
        self.allowed = TIGHT * max(NEAR, SHARE * min(float(s.max()) for s in sizes))

    def waste(self, capsule: Capsule) -> float:
        """Integral of the distance to the hull over the surface of a capsule [m^3]."""
        points, area = skin(capsule)
        outside = np.max(points @ self._normals.T + self._offsets, axis=1) > 0.0
        return area * sum(map(self._away, points[outside])) / len(points)

    def excess(self, capsules: Sequence[Capsule]) -> float:
        """Mean distance from the surfaces of capsules to the hull [m]."""
        return sum(map(self.waste, capsules)) / max(sum(skin(c)[1] for c in capsules), 1e-12)

    def _away(self, point: Vec) -> float:
        result = coal.DistanceResult()
        place = Placement(np.eye(3), point)
        coal.distance(_POINT, place, self._hull, _HERE, _REQUEST, result)
        return max(float(result.min_distance) + _DOT, 0.0)


def skin(capsule: Capsule) -> tuple[Mat, float]:
    """Points spread evenly over the surface of a capsule ``(n, 3)`` [m], and its area [m^2]."""
    a, b, radius = capsule
    length = float(np.linalg.norm(b - a))
    axis = (b - a) / length if length > 0.0 else np.array([0.0, 0.0, 1.0])
    across = np.linalg.svd(axis[None])[2][1:]
    height = (np.arange(_SKIN) + 0.5) / _SKIN * (length + 2.0 * radius)  # Archimedes: even in height is even in area
    turn = np.pi * (1.0 + math.sqrt(5.0)) * np.arange(_SKIN)
    past = np.clip(height - radius, 0.0, length)
    rise = height - radius - past
    wide = np.sqrt(np.maximum(radius**2 - rise**2, 0.0))
    ring = (wide * np.cos(turn))[:, None] * across[0] + (wide * np.sin(turn))[:, None] * across[1]
    return a + np.outer(past + rise, axis) + ring, 2.0 * math.pi * radius * (length + 2.0 * radius)


def _grouped(part: Surface) -> list[tuple[Mat, float]]:
    """Corners of the hull of the triangles of each radius."""
    return [(_hull(part.triangles[part.radii == r].reshape(-1, 3)), float(r)) for r in np.unique(part.radii)]


def _corners(part: Surface) -> tuple[Mat, Vec]:
    groups = _grouped(part)
    return np.concatenate([c for c, _ in groups]), np.concatenate([np.full(len(c), r) for c, r in groups])


def _roughly(points: Mat, radii: Vec) -> Capsule:
    """A capsule around balls, its axis the best of a few directions."""
    centre = points.mean(axis=0)
    tried = [_around(points, radii, centre, d) for d in (*right_vectors(points - centre)[1], *_DIRECTIONS[:9])]
    return min(tried, key=_volume)


def _fit_one(points: Mat, radii: Vec) -> Capsule:
    """The capsule of least volume around balls ``(n, 3)``, ``(n,)`` found from several directions of its axis."""
    from scipy.optimize import minimize

    reach = points[:, None] @ _BALL.T[None]
    outer = np.unique(np.argmax(reach[:, 0] + radii[:, None], axis=0))
    few, small = points[outer], radii[outer]
    centre = points.mean(axis=0)
    starts = [*right_vectors(points - centre)[1], *_DIRECTIONS]
    ranked = sorted(starts, key=lambda d: _volume(_around(few, small, centre, d)))
    found = [
        minimize(
            lambda x: _volume(_around(few, small, x[:3], x[3:])), np.concatenate((centre, d)), method="Nelder-Mead"
        )
        for d in ranked[:2]
    ]
    return min((_around(points, radii, f.x[:3], f.x[3:]) for f in found), key=_volume)


def _around(points: Mat, radii: Vec, centre: Vec, direction: Vec) -> Capsule:
    """The smallest capsule around balls whose axis goes through a centre along a direction."""
    u = direction / max(float(np.linalg.norm(direction)), 1e-12)
    off = points - centre
    along = off @ u
    across = np.sqrt(np.maximum(np.einsum("ij,ij->i", off, off) - along**2, 0.0))
    radius = float((across + radii).max()) + _ROUNDING
    caps = np.sqrt(np.maximum((radius - radii) ** 2 - across**2, 0.0))
    low, high = float((along + caps).min()), float((along - caps).max())
    if low > high:  # one ball: both ends lie in reach of all points
        low = high = 0.5 * (low + high)
    return centre + low * u, centre + high * u, radius


def _volume(capsule: Capsule) -> float:
    a, b, r = capsule
    return math.pi * r * r * (float(np.linalg.norm(b - a)) + 4.0 / 3.0 * r)


def _hull(points: Mat) -> Mat:
    from scipy.spatial import ConvexHull, QhullError

    try:
        return np.asarray(points[ConvexHull(points).vertices])
    except (QhullError, ValueError):  # flat or few
        return np.unique(points, axis=0)


def link_name(robot: Any, joint: int) -> str:
    import pinocchio as pin

    bodies = (f.name for f in robot.model.frames if f.parentJoint == joint and f.type == pin.FrameType.BODY)
    return next(bodies, str(robot.model.names[joint]))
