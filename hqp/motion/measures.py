"""Quality of a retargeted motion: errors, slide, penetration, self-collision, jerk, limits, frame by frame."""

from __future__ import annotations

from dataclasses import dataclass, replace

import numpy as np

from hqp.arrays import Mat, Vec
from hqp.declare.robot import Robot
from hqp.errors import ModelError
from hqp.tasks import CollisionAvoidance

from .contacts import Mask
from .holds import turn
from .joints import SIDES
from .stacks import Stacks, may_collide
from .targets import Targets

LEVEL = 2e-3
"""Height difference of toe and heel below which a sole is flat [m]."""


@dataclass(frozen=True)
class Measures:
    """Figures of n frames.

    errors: by part, from target to robot ``(n,)`` [m, rad for torso, hips and soles].  slide: by side, speed along the
    ground of the supporting part of the foot ``(n - 1,)`` [m/s], NaN while it does not stand.  penetration: depth of
    the deepest point below the floor ``(n,)`` [m].  clearance: least distance of two links ``(n,)`` [m], of capsules
    that overlap at home beyond that overlap; inf for a robot without shapes.  acceleration ``(n - 2,)``, jerk
    ``(n - 3,)``: figures of the fastest joint [rad/s^2, rad/s^3].  beyond: excess of joints over their limits ``(n,)``
    [rad].  speed: fastest joint by its limit ``(n - 1,)``.
    """

    errors: dict[str, Vec]
    slide: dict[str, Vec]
    penetration: Vec
    clearance: Vec
    acceleration: Vec
    jerk: Vec
    beyond: Vec
    speed: Vec

    def summary(self) -> dict[str, float]:
        """The figures of docs/retargeting.md."""
        moving = np.concatenate([s[np.isfinite(s)] for s in self.slide.values()])
        hands = np.concatenate([self.errors[f"{side}_hand"] for side in SIDES])
        feet = np.concatenate([self.errors[f"{side}_toe"] for side in SIDES])
        last = max(float(self.errors[f"{side}_hand"][-1]) for side in SIDES)
        return {
            "slide_share": float(np.mean(moving > 0.01)) if moving.size else 0.0,
            "slide_p99": _quantile(moving, 0.99),
            "penetration": float(self.penetration.max()),
            "clearance": float(self.clearance.min()),
            "hand_p50": _quantile(hands, 0.5),
            "hand_p99": _quantile(hands, 0.99),
            "hand_end": last,
            "foot_p50": _quantile(feet, 0.5),
            "foot_p99": _quantile(feet, 0.99),
            "trunk_p99": _quantile(self.errors["torso"], 0.99),
            "sole_p99": _quantile(np.concatenate([self.errors[f"{side}_sole"] for side in SIDES]), 0.99),
            "acceleration_p99": _quantile(self.acceleration, 0.99),
            "jerk_p99": _quantile(self.jerk, 0.99),
            "beyond": float(self.beyond.max()),
            "speed": float(self.speed.max(initial=0.0)),
        }


def measure(robot: Robot, stacks: Stacks, targets: Targets, q: Mat, resting: dict[str, Mask] | None = None) -> Measures:
    """Compute the figures of configurations ``(n, nq)``, one for each frame of the targets."""
    places, axes, angles, bodies = _walk(robot, stacks, q)
    errors = {name: _apart(places[name], targets.places[name]) for name in ("pelvis", *stacks.points)}
    for side, task in stacks.edges:
        offset = np.array(task.offset) - stacks.in_frame(side, np.zeros(3))
        there = targets.places[f"{side}_sole"] + targets.axes[f"{side}_sole"] @ offset
        errors[task.name] = _apart(places[task.name], there)
    for name in axes:
        pairs = zip(targets.axes[name], axes[name], strict=True)
        errors[name] = np.array([float(np.linalg.norm(turn(one, two))) for one, two in pairs])
    resting = targets.contacts.resting if resting is None else resting
    slide = {side: _slide(places, resting[f"{side}_foot"], side, targets.fps) for side in SIDES}
    heights = np.min([places[task.name][:, 2] for task in stacks.corners], axis=0)
    heights = np.minimum(heights, _feet(robot, stacks, bodies))
    clearance, lowest = _collisions(robot, stacks, bodies)
    rates = np.diff(angles, axis=0) * targets.fps
    acceleration = np.diff(rates, axis=0) * targets.fps
    columns = robot.actuated
    beyond = np.maximum(robot.lower[columns] - angles, angles - robot.upper[columns]).max(axis=1)
    return Measures(
        errors, slide, np.maximum(0.0, -np.minimum(heights, lowest)), clearance, np.abs(acceleration).max(axis=1),
        np.abs(np.diff(acceleration, axis=0) * targets.fps).max(axis=1), np.maximum(beyond, 0.0),
        (np.abs(rates) / robot.velocity_limit[columns]).max(axis=1),
    )  # fmt: skip


def _walk(robot: Robot, stacks: Stacks, q: Mat) -> tuple[dict[str, Mat], dict[str, Mat], Mat, tuple[Mat, Mat]]:
    """Points and axes by task, joint angles, and all bodies' positions and rotations, for every frame."""
    corners = [replace(task, axes="xyz") for task in stacks.corners]
    points = [task for _, task in stacks.edges] + [*corners, stacks.trunk[0], *stacks.points.values()]
    turns = [stacks.trunk[1], stacks.hips, *stacks.soles.values()]
    places = {task.name: np.empty((len(q), 3)) for task in points}
    axes = {task.name: np.empty((len(q), 3, 3)) for task in turns}
    angles, count = np.empty((len(q), len(robot.actuated))), len(robot.bodies)
    origins, rotations = np.empty((len(q), count, 3)), np.empty((len(q), count, 3, 3))
    for i, at in enumerate(q):
        state = robot.state(at)
        state.kinematics()
        for task in points:
            places[task.name][i] = task.value(state)
        for task in turns:
            axes[task.name][i] = state.rotation(task.frame)  # type: ignore[attr-defined]
        angles[i] = state.angles[robot.actuated]
        for k, (*_, (p, R)) in enumerate(robot.bodies):
            origins[i, k], rotations[i, k] = p, R
    return places, axes, np.unwrap(angles, axis=0), (origins, rotations)


def _apart(one: Mat, two: Mat) -> Vec:
    return np.asarray(np.linalg.norm(one - two, axis=1))


def _slide(places: dict[str, Mat], mask: Mask, side: str, fps: float) -> Vec:
    """Speed along the ground of the lower end of a sole, of the slower one where it is flat."""
    toe, heel = places[f"{side}_toe"], places[f"{side}_heel"]
    speeds = np.stack([np.linalg.norm(np.diff(end[:, :2], axis=0), axis=1) * fps for end in (toe, heel)])
    lower = (heel[:-1, 2] < toe[:-1, 2]).astype(int)
    own = np.take_along_axis(speeds, lower[None], axis=0)[0]
    flat = np.abs(heel[:-1, 2] - toe[:-1, 2]) < LEVEL
    found = np.where(flat, speeds.min(axis=0), own)
    return np.where(mask[1:] & mask[:-1], found, np.nan)


def _collisions(robot: Robot, stacks: Stacks, bodies: tuple[Mat, Mat]) -> tuple[Vec, Vec]:
    """Least distance of two links beyond the one that they have to keep, which is below 0 if their capsules overlap at
    home, and of a link other than a foot from the floor ``(n,)`` [m].
    """
    from hqp.tasks.collision_scene import scene

    n = len(bodies[0])
    least, lowest = np.full(n, np.inf), np.full(n, np.inf)
    try:
        own = robot.capsules
    except ModelError:
        return least, lowest
    above = set(stacks.links)
    for link in (capsule for capsule in own if capsule.name in above):
        p, R = bodies[0][:, link.body], bodies[1][:, link.body]
        for end in (link.a, link.b):
            lowest = np.minimum(lowest, (p + R @ np.array(end))[:, 2] - link.radius)
    if not may_collide(robot):
        return least, lowest
    found = scene(CollisionAvoidance(clearance=0.0), robot)
    capsules, pairs = found.capsules, found.pairs
    ends = []
    for capsule in capsules:
        p, R = bodies[0][:, capsule.body], bodies[1][:, capsule.body]
        ends.append((p + R @ np.array(capsule.a), p + R @ np.array(capsule.b)))
    for row, (i, j) in enumerate(pairs):
        if not found.is_hull(j):
            apart = segments(*ends[i], *ends[j]) - capsules[i].radius - capsules[j].radius
            least = np.minimum(least, apart - found.clearance[row])
    hulls = [row for row, (_, j) in enumerate(pairs) if found.is_hull(j)]
    placed = {j: (bodies[0][:, capsules[j].body], bodies[1][:, capsules[j].body]) for _, j in pairs}
    kept = found.clearance[hulls][:, None]
    bounds = [found.at_least(row, ends[i], placed[j]) for row in hulls for i, j in (pairs[row],)]
    low = np.reshape(bounds, (-1, n)) - kept
    for k, order in enumerate(np.argsort(low, axis=0).T):
        for one in order:  # the pair that may be nearest first
            if low[one, k] >= least[k]:
                break
            i, j = pairs[hulls[one]]
            there = [(first[k], second[k]) for first, second in (ends[i], placed[j])]
            least[k] = min(least[k], found.measure(hulls[one], np.zeros((0, 4, 4)), *there)[0] - kept[one, 0])
    return least, lowest


def _feet(robot: Robot, stacks: Stacks, bodies: tuple[Mat, Mat]) -> Vec:
    """Height of the lowest point of the shapes on both feet's links ``(n,)`` [m]; inf without shapes."""
    from hqp.robots.soles import swept

    lowest = np.full(len(bodies[0]), np.inf)
    for side in SIDES:
        frame = stacks.frames[f"{side}_sole"]
        body = robot.body(robot.frame(frame))
        for points, radius in swept(robot, frame):
            heights = bodies[1][:, body, 2] @ points.T
            lowest = np.minimum(lowest, bodies[0][:, body, 2] + heights.min(axis=1) - radius)
    return lowest


def segments(a: Mat, b: Mat, c: Mat, d: Mat) -> Vec:
    """Distance of the segments a b and c d, ``(n, 3)`` each, frame by frame ``(n,)``."""
    u, v, w = b - a, d - c, a - c
    uu, uv, vv = (np.einsum("ti,ti->t", *two) for two in ((u, u), (u, v), (v, v)))
    uw, vw = np.einsum("ti,ti->t", u, w), np.einsum("ti,ti->t", v, w)
    tiny = 1e-12
    s = np.clip((uv * vw - vv * uw) / np.maximum(uu * vv - uv * uv, tiny), 0.0, 1.0)
    t = np.clip((uv * s + vw) / np.maximum(vv, tiny), 0.0, 1.0)
    s = np.clip((uv * t - uw) / np.maximum(uu, tiny), 0.0, 1.0)
    return np.asarray(np.linalg.norm(w + s[:, None] * u - t[:, None] * v, axis=1))


def _quantile(values: Vec, share: float) -> float:
    return float(np.quantile(values, share)) if values.size else 0.0
