"""What of a foot touches level ground, from its collision shapes."""

from __future__ import annotations

from typing import Any

import numpy as np
import pinocchio as pin

from hqp.arrays import Mat
from hqp.errors import ModelError

from .geometry import points

SOLE = 4e-3
"""Points of the foot at most this far above its lowest one are its sole [m]."""

Corners = tuple[tuple[float, float], ...]


def sole(robot: Any, frame: str, most: int = 6) -> Corners:
    """Corners (x, y) of the sole in the axes of a frame whose z is up, counter-clockwise [m], at most so many.

    They are corners of the convex hull of the lowest points of the shapes on the frame's link; of more than ``most``
    those are left out that the area needs least, so that the polygon lies inside the sole.
    Raises FrameNotFound, ModelError for a link without shapes, or one whose lowest points are on a line.
    """
    cloud = _cloud(robot, frame)
    low = cloud[cloud[:, 2] < cloud[:, 2].min(initial=np.inf) + SOLE, :2]
    corners = _hull(low) if len(low) > 2 else []
    if len(corners) < 3:
        found = f"{len(low)} lowest points, needed three that are not on a line"
        raise ModelError(f"{robot.name}: no sole at {frame!r}: its link's shapes have {found}")
    while len(corners) > most:
        del corners[int(np.argmin([_area(corners, k) for k in range(len(corners))]))]
    return tuple((float(x), float(y)) for x, y in corners)


def sole_points(robot: Any, frame: str) -> tuple[tuple[float, float, float], ...]:
    """The same corners with the height of the lowest point of the shapes (x, y, z) [m]; none for no sole."""
    cloud = _cloud(robot, frame)
    try:
        return tuple((x, y, float(cloud[:, 2].min())) for x, y in sole(robot, frame))
    except ModelError:
        return ()


def _cloud(robot: Any, frame: str) -> Mat:
    """Lowest points of all shapes on a frame's link, in the frame ``(n, 3)`` [m]."""
    own = robot.model.frames[robot.frame(frame)]
    items = [item for item in robot.geometry.geometryObjects if item.parentJoint == own.parentJoint]
    return np.vstack([np.zeros((0, 3)), *(_placed(item, own.placement) for item in items)])


def _placed(item: Any, placement: Any) -> Mat:
    """Points of a shape, its lowest for a rounded one, in a frame of the same joint."""
    cloud, radius = points(item.geometry)
    local = placement.actInv(item.placement) if isinstance(placement, pin.SE3) else item.placement
    placed: Mat = np.asarray(cloud) @ local.rotation.T + local.translation
    return placed - [0.0, 0.0, radius]


def _hull(cloud: Mat) -> list[Any]:
    from scipy.spatial import ConvexHull, QhullError

    try:
        return [cloud[k] for k in ConvexHull(cloud).vertices]
    except QhullError:
        return []


def _area(corners: list[Any], k: int) -> float:
    """Of the triangle of a corner and its neighbours [m^2]."""
    o, a, b = corners[k - 1], corners[k], corners[(k + 1) % len(corners)]
    return 0.5 * abs(float((a[0] - o[0]) * (b[1] - o[1]) - (a[1] - o[1]) * (b[0] - o[0])))
