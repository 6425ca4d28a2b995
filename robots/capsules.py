"""Capsules around the links of a robot: fitted to its shapes once, kept as TOML, read when a robot needs them.

``hqp capsules ROBOT`` fits and writes them; the catalogue's are in ``robots/capsules``.
"""

from __future__ import annotations

import math
import sys
from collections.abc import Iterable, Mapping, Sequence
from pathlib import Path
from typing import Any

import numpy as np

from hqp.arrays import Mat, Vec
from hqp.errors import ModelError
from hqp.shapes import LinkCapsule

from . import geometry

if sys.version_info >= (3, 11):
    import tomllib
else:
    import tomli as tomllib

FOLDER = Path(__file__).parent / "capsules"
SPLIT = 0.45
"""Share of a capsule that its link fills below which two capsules are tried."""
WORTH = 0.8
"""Two capsules are kept where they have at most this share of the volume of one."""
_DIRECTIONS = 60


def stored(robot: Any, path: Path | None = None) -> tuple[LinkCapsule, ...] | None:
    """Capsules of a file, by default that of the catalogue for the robot's name or file; None if there is none."""
    names = [robot.name] + ([robot.source.stem] if robot.source is not None else [])
    paths = [path] if path is not None else [FOLDER / f"{name}.toml" for name in names]
    found = next((p for p in paths if p.is_file()), None)
    if found is None:
        return None
    table = tomllib.loads(found.read_text())
    try:
        return tuple(_placed(robot, entry) for entry in table["capsule"])
    except KeyError as error:
        raise ModelError(f"{found}: capsules do not fit {robot.name}: {error}") from error


def _placed(robot: Any, entry: dict[str, Any]) -> LinkCapsule:
    index = robot.frame(entry["link"])
    placement = robot.model.frames[index].placement
    a, b = (tuple((placement * np.array(entry[end], dtype=np.float64)).tolist()) for end in ("a", "b"))
    return LinkCapsule(entry.get("name", entry["link"]), robot.body(index), a, b, float(entry["radius"]))


def fitted(robot: Any) -> tuple[LinkCapsule, ...]:
    """Capsules that hold the collision shapes of each body that moves, one or two of them."""
    return fit_clouds(robot, clouds(robot))


def clouds(robot: Any) -> dict[int, Mat]:
    """Points ``(n, 3)`` [m] of the collision shapes that each joint carries; raises ModelError without shapes."""
    found: dict[int, list[Mat]] = {}
    for item in robot.geometry.geometryObjects:
        joint = int(item.parentJoint)
        if joint == 0 or type(item.geometry).__name__ == "Halfspace":
            continue
        at, radius = geometry.points(item.geometry)
        if hasattr(item.geometry, "vertices"):
            at = at * np.asarray(item.meshScale)
        if radius > 0.0:  # a ball around each point
            at = np.vstack([at + radius * d for d in _sphere()])
        found.setdefault(joint, []).append(at @ item.placement.rotation.T + item.placement.translation)
    return {joint: np.vstack(parts) for joint, parts in sorted(found.items())}


def fit_clouds(robot: Any, clouds: Mapping[int, Mat]) -> tuple[LinkCapsule, ...]:
    """One or two capsules around each of the clouds of ``clouds``."""
    found: list[LinkCapsule] = []
    for joint, points in clouds.items():
        name = link_name(robot, joint)
        fits = fit(points)
        for k, (a, b, radius) in enumerate(fits):
            title = name if len(fits) == 1 else f"{name}/{k}"
            found.append(LinkCapsule(title, joint, tuple(a.tolist()), tuple(b.tolist()), radius))
    return tuple(found)


def fit(cloud: Mat) -> list[tuple[Vec, Vec, float]]:
    """One capsule around points ``(n, 3)``, or two where they leave much less room: ends and radius [m]."""
    hull = _hull(cloud)
    one = _fit_one(hull)
    if len(hull) < 8 or _hull_volume(hull) > SPLIT * _volume(one):
        return [one]
    a, b, _ = one
    axis = b - a if np.linalg.norm(b - a) > 1e-6 else np.linalg.svd(hull - hull.mean(0))[2][0]
    best = [one]
    for direction in (axis, *np.linalg.svd(hull - hull.mean(0))[2]):
        place = cloud @ (direction / np.linalg.norm(direction))
        for share in (0.35, 0.5, 0.65):
            cut = place.min() + share * np.ptp(place)
            halves = [cloud[place <= cut + 1e-3], cloud[place >= cut - 1e-3]]
            if min(map(len, halves)) >= 4:
                two = [_fit_one(_hull(h)) for h in halves]
                if sum(map(_volume, two)) < sum(map(_volume, best)):
                    best = two
    return best if len(best) == 1 or sum(map(_volume, best)) < WORTH * _volume(one) else [one]


def _fit_one(points: Mat) -> tuple[Vec, Vec, float]:
    """The capsule of least volume found from several directions of its axis."""
    from scipy.optimize import minimize

    centre = points.mean(axis=0)
    starts = [*np.linalg.svd(points - centre)[2], *_sphere()[:_DIRECTIONS]]
    ranked = sorted(starts, key=lambda d: _volume(_around(points, centre, d)))
    best = None
    for direction in ranked[:2]:
        start = np.concatenate((centre, direction))
        found = minimize(lambda x: _volume(_around(points, x[:3], x[3:])), start, method="Nelder-Mead")
        capsule = _around(points, found.x[:3], found.x[3:])
        if best is None or _volume(capsule) < _volume(best):
            best = capsule
    assert best is not None
    return best


def _around(points: Mat, centre: Vec, direction: Vec) -> tuple[Vec, Vec, float]:
    """The smallest capsule around points whose axis goes through a centre along a direction."""
    u = direction / max(float(np.linalg.norm(direction)), 1e-12)
    along = (points - centre) @ u
    across = np.linalg.norm(points - centre - np.outer(along, u), axis=1)
    radius = float(across.max())
    caps = np.sqrt(np.maximum(radius**2 - across**2, 0.0))
    low, high = float((along + caps).min()), float((along - caps).max())
    if low > high:  # a ball: its centre where both ends are held
        low = high = 0.5 * (low + high)
    return centre + low * u, centre + high * u, radius


def _volume(capsule: tuple[Vec, Vec, float]) -> float:
    a, b, r = capsule
    return math.pi * r * r * (float(np.linalg.norm(b - a)) + 4.0 / 3.0 * r)


def _hull(points: Mat) -> Mat:
    from scipy.spatial import ConvexHull, QhullError

    try:
        return np.asarray(points[ConvexHull(points).vertices])
    except QhullError:  # flat or few
        return np.unique(points, axis=0)


def _hull_volume(points: Mat) -> float:
    from scipy.spatial import ConvexHull, QhullError

    try:
        return float(ConvexHull(points).volume)
    except QhullError:
        return 0.0


def _sphere(count: int = 100) -> Mat:
    """Unit vectors ``(count, 3)`` spread over the sphere."""
    k = np.arange(count) + 0.5
    polar, turn = np.arccos(1.0 - 2.0 * k / count), math.pi * (1.0 + math.sqrt(5.0)) * k
    return np.column_stack((np.sin(polar) * np.cos(turn), np.sin(polar) * np.sin(turn), np.cos(polar)))


def link_name(robot: Any, joint: int) -> str:
    import pinocchio as pin

    bodies = (f.name for f in robot.model.frames if f.parentJoint == joint and f.type == pin.FrameType.BODY)
    return next(bodies, str(robot.model.names[joint]))


def text(robot: Any, capsules: Sequence[LinkCapsule]) -> str:
    """The capsules as TOML, ends in the axes of their links."""
    lines = [
        f"# Capsules around the shapes of {robot.name}, fitted by `hqp capsules`; ends in the link's axes [m].",
        "format = 1",
    ]
    for c in capsules:
        link = link_name(robot, c.body)
        inverse = robot.model.frames[robot.frame(link)].placement.inverse()
        a, b = (inverse * np.array(end) for end in (c.a, c.b))
        lines += ["", "[[capsule]]", f'name = "{c.name}"', f'link = "{link}"']
        lines += [f"a = {_row(a)}", f"b = {_row(b)}", f"radius = {c.radius + 5e-7:.6f}"]
    return "\n".join(lines) + "\n"


def _row(values: Iterable[float]) -> str:
    return "[" + ", ".join(f"{float(x) + 0.0:.6f}" for x in values) + "]"
