"""Part of a foot that touches level ground, from its collision shapes."""

from __future__ import annotations

from typing import Any

import numpy as np
import pinocchio as pin

from hqp.arrays import Mat, Vec
from hqp.errors import ModelError

from .knees import knee
from .surface import surface

SOLE = 4e-3
"""Points of the foot at most this far above its lowest one are its sole [m]."""

SIDE_BY_SIDE = 0.03
"""The lowest shapes of two feet differ by at most this at home [m]."""

UPRIGHT = np.deg2rad(1.0)
"""A frame turned by less against the sole (ahead, left, up) at home is that of a sole: SOLE over the length of one."""

TIPPED, FLAT = np.deg2rad(40.0), np.deg2rad(2.0)
"""A sole is turned by less from level at home; the normals of its triangles differ by less."""

TOES = 0.05
"""A sole whose middle is off its ankle by less, as a share of its length, does not show which way is ahead."""

BENDS = 0.1
"""Knees whose ranges bend the legs by less, at their middle, do not show which way is ahead [rad]."""

ROLLS = np.deg2rad(10.0)
"""Faces of a sole are turned by less from level: on a steeper one a foot would roll before it stands."""

Corners = tuple[tuple[float, float], ...]


def sole(robot: Any, frame: str, most: int = 6) -> Corners:
    """Corners (x, y) of the sole in the axes of a frame whose z is up, counter-clockwise [m], at most so many.

    They are corners of the level faces of the convex hull of the lowest points of the shapes on the frame's link; if
    there are more than ``most``, those that contribute least area are dropped, so that the polygon lies inside the
    sole. Raises FrameNotFound, ModelError for a link without shapes, or one whose lowest points are on a line.
    """
    cloud = _cloud(robot, frame)
    low = cloud[cloud[:, 2] < cloud[:, 2].min(initial=np.inf) + SOLE]
    hull = _hull_below(low)
    level = [] if hull is None else hull.simplices[hull.equations[:, 2] < -np.cos(ROLLS)]
    corners = _hull(low[np.unique(level)][:, :2]) if len(level) else []
    if len(corners) < 3:
        found = f"{len(low)} lowest points, needed three that are not on a line"
        raise ModelError(f"{robot.name}: no sole at {frame!r}: its link's shapes have {found}")
    while len(corners) > most:
        del corners[int(np.argmin([_area(corners, k) for k in range(len(corners))]))]
    return tuple((float(x), float(y)) for x, y in corners)


def sole_points(robot: Any, frame: str) -> tuple[tuple[float, float, float], ...]:
    """Return the corners with the height of the lowest point of the shapes (x, y, z) [m]; none for no sole."""
    cloud = _cloud(robot, frame)
    try:
        return tuple((x, y, float(cloud[:, 2].min())) for x, y in sole(robot, frame))
    except ModelError:
        return ()


def level_sole(robot: Any, frame: str) -> tuple[Mat, Mat]:
    """Rotation ``(3, 3)`` of a frame's link from home that makes its largest flat face below level, and the lowest
    points of its shapes then, in the world, the frame's origin where it is at home ``(n, 3)`` [m]; none for no shapes.
    """
    joint = robot.model.frames[robot.frame(frame)].parentJoint
    state = robot.state(robot.home)
    state.kinematics()
    if all(item.parentJoint != joint for item in robot.geometry.geometryObjects):
        return np.eye(3), np.zeros((0, 3))
    turn, origin = _levelled(robot, joint), state.position(frame)
    cloud = _turned(robot, joint, turn) + origin - turn @ origin
    return turn, np.asarray(cloud[cloud[:, 2] < cloud[:, 2].min() + SOLE])


def swept(robot: Any, frame: str) -> list[tuple[Mat, float]]:
    """Corners ``(m, 3)`` of the convex hull of each shape on a frame's link, in the axes of its joint, with the radius
    that sweeps them [m]; none for a robot without shapes.
    """
    joint = robot.model.frames[robot.frame(frame)].parentJoint
    try:
        shapes = robot.geometry.geometryObjects
    except ModelError:
        return []
    found = (surface(item) for item in shapes if item.parentJoint == joint)
    return [(np.array(_hull(one.points()) or one.points()), float(one.radii.max())) for one in found]


def _cloud(robot: Any, frame: str) -> Mat:
    """Lowest points of all shapes on a frame's link, in the frame ``(n, 3)`` [m]."""
    own = robot.model.frames[robot.frame(frame)]
    items = [item for item in robot.geometry.geometryObjects if item.parentJoint == own.parentJoint]
    return np.vstack([np.zeros((0, 3)), *(_placed(item, own.placement) for item in items)])


def _placed(item: Any, placement: Any) -> Mat:
    """Points of a shape, its lowest for a rounded one, in a frame of the same joint."""
    return surface(item).placed(pin.SE3(placement).inverse()).lowest()


def _hull(cloud: Mat) -> list[Any]:
    from scipy.spatial import ConvexHull, QhullError

    try:
        return [cloud[k] for k in ConvexHull(cloud).vertices]
    except QhullError:
        return []


def _hull_below(cloud: Mat) -> Any:
    """Convex hull of points and one high above, so that points in one plane have one; None for points on a line."""
    from scipy.spatial import ConvexHull, QhullError

    if len(cloud) < 3:
        return None
    try:
        return ConvexHull(np.vstack([cloud, cloud.mean(axis=0) + [0.0, 0.0, 1.0]]))
    except QhullError:
        return None


def _area(corners: list[Any], k: int) -> float:
    """Area of the triangle of a corner and its neighbours [m^2]."""
    o, a, b = corners[k - 1], corners[k], corners[(k + 1) % len(corners)]
    return 0.5 * abs(float((a[0] - o[0]) * (b[1] - o[1]) - (a[1] - o[1]) * (b[0] - o[0])))


def feet(robot: Any) -> tuple[Any, tuple[str, str]]:
    """Find the two feet of a floating robot at home: the lowest collision shapes of two links, the left one first.

    Returns the robot and the frames of both soles.  A frame of the link with the axes of its sole is taken: ahead, left
    (``standing_axes``), and up from its largest flat face, which need not be level at home.  Without one the returned
    robot gets the frame ``LINK_sole``.
    Raises ModelError for a robot whose lowest shapes are not those of two links side by side.
    """
    left, right = foot_joints(robot)
    axes = standing_axes(robot, left, right)
    robot, left_sole = _level_frame(robot, left, axes)
    robot, right_sole = _level_frame(robot, right, axes)
    return robot, (left_sole, right_sole)


def standing_axes(robot: Any, left: int, right: int) -> Mat:
    """Columns ahead, left and up ``(3, 3)`` in the world at home, by the joints of the left and the right foot.

    Left is level along the line from the right hip to the left one, from foot to foot if the hips are in line: neither
    the axes of the base nor those of the soles matter.  Raises ModelError for feet that are not side by side, or of one
    leg.
    """
    robot.state(robot.home).kinematics()
    ways = robot.model.supports[left].tolist(), robot.model.supports[right].tolist()
    legs = [[j for j in own if j not in other] for own, other in (ways, ways[::-1])]
    if not all(legs):
        names = robot.model.names
        raise ModelError(
            f"{robot.name}: {names[left]} and {names[right]} are joints of one leg; needed one on each side"
        )
    hips = [leg[0] for leg in legs]
    for one, other in (hips, (left, right)):
        x, y = (robot.data.oMi[one].translation - robot.data.oMi[other].translation)[:2].tolist()
        if np.hypot(x, y) > SOLE:
            aside = np.array([x, y, 0.0]) / np.hypot(x, y)
            up = np.array([0.0, 0.0, 1.0])
            return np.column_stack([np.cross(aside, up), aside, up])
    raise ModelError(f"{robot.name}: both feet and both hips are in line at home; needed one on each side")


def foot_joints(robot: Any) -> tuple[int, int]:
    """The joints whose links have the lowest collision shapes at home, the left one first; raises ModelError.

    Knees bend ahead, if their limits show to which side; else soles reach further ahead than behind, if their ankles
    are above them; else ahead is the x axis of the base (REP 103).
    """
    robot.state(robot.home).kinematics()
    lowest: dict[int, float] = {}
    for item in robot.geometry.geometryObjects:
        joint = int(item.parentJoint)
        if joint > 0:
            low = float(_placed_in_world(robot, item)[:, 2].min())
            lowest[joint] = min(low, lowest.get(joint, np.inf))
    base = lowest.pop(1, np.inf)
    first = min(lowest, key=lowest.__getitem__, default=0)
    rest = [j for j in lowest if j not in robot.model.supports[first] and first not in robot.model.supports[j]]
    second = min(rest, key=lowest.__getitem__, default=0)
    level = [j for j in rest if lowest[j] <= lowest[first] + SIDE_BY_SIDE]
    more = [j for j in level if j not in robot.model.supports[second] and second not in robot.model.supports[j]]
    if not lowest:
        idle = robot.description is not None and robot.description.simulated is not None
        remedy = ", or the scene file whose contact pairs name them" if idle else ""
        raise ModelError(f"{robot.name}: no moving link has collision shapes; needed the shapes of two soles{remedy}")
    if base < lowest[first]:
        raise ModelError(f"{robot.name}: its base is below the lowest other link: it stands on no feet")
    if len(level) < 1 or more:
        names = ", ".join(robot.model.names[j] for j in (first, *level)) or "none"
        raise ModelError(
            f"{robot.name}: joints with the lowest collision shapes at home: {names}; "
            "needed one joint on each side: name the soles"
        )
    _not_arms(robot, first, second)
    return (first, second) if faces(robot, first, second) else (second, first)


def _not_arms(robot: Any, first: int, second: int) -> None:
    """Raise ModelError if the limbs of two joints part above the base, behind joints that turn them against it: legs
    part below those of a waist."""
    shared = [j for j in robot.model.supports[first].tolist() if j in robot.model.supports[second].tolist()]
    base, part = (robot.data.oMi[j].act(robot.model.inertias[j].lever)[2] for j in (1, shared[-1]))
    if shared[-1] > 1 and base < part:
        names = robot.model.names
        ends, at = f"{names[first]} and {names[second]}", names[shared[-1]]
        arms = f"those of {ends}, are on arms: they part at {at}, above its base"
        raise ModelError(f"{robot.name}: its lowest collision shapes, {arms}; needed the shapes of two soles on legs")


def faces(robot: Any, left: int, right: int) -> bool:
    """Return true if a robot faces ahead and these are the joints of its left and right foot, see ``foot_joints``."""
    ahead = standing_axes(robot, left, right)[:, 0]
    faced = sum(_bends(robot, *pair, ahead) for pair in ((left, right), (right, left)))
    if abs(faced) <= 2.0 * BENDS:
        faced = sum(_toes(robot, joint, ahead) for joint in (left, right))
        if abs(faced) <= 2.0 * TOES:
            faced = float(robot.state(robot.home).rotation(_body(robot, 1))[:, 0] @ ahead)
    return faced > 0.0


def _bends(robot: Any, joint: int, other: int, ahead: Vec) -> float:
    """Angle by which the middle of a knee's range bends its leg, with the sign of ahead [rad]; 0 without limits."""
    model, beside = robot.model, robot.model.supports[other].tolist()
    own = [j for j in robot.model.supports[joint].tolist() if j not in beside and model.joints[j].nv == 1]
    if len(own) < 3:
        return 0.0
    name, bend = knee(robot, [model.names[j] for j in own], robot.home)
    column = int(robot.joints([name])[0])
    low, high = robot.lower[column], robot.upper[column]
    if not np.isfinite([low, high]).all():
        return 0.0
    state = robot.state(robot.home)
    way = state.jacobian(model.names[own[-1]])[:3, column] @ ahead
    return float(-np.sign(way) * (0.5 * (low + high) - state.angles[column] + bend))


def _toes(robot: Any, joint: int, ahead: Vec) -> float:
    """Distance of the middle of a sole ahead of its joint, as a share of its length; 0 if the joint is not above it."""
    turn = _levelled(robot, joint)
    cloud = _turned(robot, joint, turn) - turn @ robot.data.oMi[joint].translation
    along = cloud[cloud[:, 2] < cloud[:, 2].min() + SOLE] @ ahead
    if not along.min() <= 0.0 <= along.max():
        return 0.0
    return float(0.5 * (along.max() + along.min()) / max(float(np.ptp(along)), SOLE))


def _placed_in_world(robot: Any, item: Any) -> Mat:
    return surface(item).placed(robot.data.oMi[item.parentJoint]).lowest()


def _turned(robot: Any, joint: int, turn: Mat) -> Mat:
    """Lowest points of the shapes of a joint's link at home, turned about the world's origin ``(n, 3)`` [m]."""
    placed = pin.SE3(turn, np.zeros(3)) * robot.data.oMi[joint]
    items = [item for item in robot.geometry.geometryObjects if item.parentJoint == joint]
    return np.vstack([surface(item).placed(placed).lowest() for item in items])


def _levelled(robot: Any, joint: int) -> Mat:
    """Rotation ``(3, 3)`` that makes the largest flat face below a joint's link level, from its pose at home; the
    identity if no face is turned by less than TIPPED.
    """
    turn = np.eye(3)
    for _ in range(3):  # the lowest points of rounded shapes depend on it
        normal = _largest_face(_turned(robot, joint, turn))
        if normal is None:
            break
        turn = pin.Quaternion.FromTwoVectors(normal, np.array([0.0, 0.0, -1.0])).matrix() @ turn
    return turn


def _largest_face(cloud: Mat) -> Vec | None:
    """Outward normal ``(3,)`` of the largest face of the convex hull among those turned by less than TIPPED from below;
    triangles whose normals differ by less than FLAT are one face.
    """
    hull = _hull_below(cloud)
    if hull is None:
        return None
    below = hull.equations[:, 2] < -np.cos(TIPPED)
    if not below.any():
        return None
    normals, corners = hull.equations[below, :3], hull.points[hull.simplices[below]]
    areas = 0.5 * np.linalg.norm(np.cross(corners[:, 1] - corners[:, 0], corners[:, 2] - corners[:, 0]), axis=1)
    alike = (normals @ normals.T > np.cos(FLAT)) * areas
    found: Vec = (alike @ normals)[int(np.argmax(alike.sum(axis=1)))]
    return found / np.linalg.norm(found)


def _body(robot: Any, joint: int) -> str:
    """The first body that a joint moves."""
    moved = (f for f in robot.model.frames if f.parentJoint == joint and f.type == pin.FrameType.BODY)
    return str(next(moved).name)


def _level_frame(robot: Any, joint: int, axes: Mat) -> tuple[Any, str]:
    """Frame of a joint with these axes on its level sole; a new one is added to a robot without it."""
    state = robot.state(robot.home)
    state.kinematics()
    axes = _levelled(robot, joint).T @ axes
    for frame in robot.model.frames:
        fixed = frame.parentJoint == joint and frame.type in (pin.FrameType.BODY, pin.FrameType.OP_FRAME)
        if fixed and np.trace(axes.T @ state.rotation(frame.name)) > 1.0 + 2.0 * np.cos(UPRIGHT):
            return robot, str(frame.name)
    body = _body(robot, joint)
    turn = pin.SE3(state.rotation(body).T @ axes, np.zeros(3))
    return robot.with_frame(f"{body}_sole", body, turn), f"{body}_sole"
