"""Pairs of links that may touch by accident: apart at home, and drawn configurations bring their shapes together."""

from __future__ import annotations

import hashlib
from typing import Any

import numpy as np

from hqp.arrays import Index, Mat
from hqp.declare.robot import Robot
from hqp.shapes import LinkCapsule

from . import distances

DRAWS = 2000
"""Configurations drawn within the joint ranges."""
EVIDENCE = 100
"""Configurations with near capsules after which a pair counts as harmless if its shapes touch in none."""
MOST = 1.0 / 3.0
"""A pair is needless if its clearance excludes more than this share of the configurations with shapes apart, and the
shapes touch in less than this share of those that it excludes."""
KEPT = 0.8
"""Share of their distance at home that two links keep at most."""
SLACK = 1e-3
"""Depth by which capsules that overlap at home may overlap more [m]: noise at home moves nothing."""
REMEMBERED = 64
"""Robots whose pairs are remembered: copies of a robot share them."""

Pair = tuple[int, int]
Key = tuple[Any, ...]

_FOUND: dict[Key, list[Pair]] = {}


def may_touch(robot: Robot, capsules: tuple[LinkCapsule, ...], pairs: list[Pair], clearance: float) -> list[Pair]:
    """Return the pairs of capsules of links that may touch by accident.  A pair does not count if

    - its links are one body, or one carries the other: the range of their joint is the limit,
    - the shapes of its links touch at home,
    - the shapes touch in none of 100 configurations with capsules nearer than the clearance,
    - the clearance excludes more than a third of the configurations with shapes apart, and the shapes touch in less
      than a third of those that it excludes, or
    - its capsules overlap at home, and the shapes touch in less than half of the configurations that its clearance
      (``kept``) excludes.

    Configurations are drawn within the joint ranges; pairs that come near in fewer than 100 of 2000 count, unless their
    capsules overlap at home.  Shapes are those that capsules are fitted to; other capsules are the shapes themselves.
    clearance [m]: see ``kept`` (allowed collisions by drawn configurations: Coleman et al. 2014, MoveIt).
    """
    parents = [body[0] for body in robot.bodies]
    body = [c.body for c in capsules]
    apart = [(i, j) for i, j in pairs if body[i] not in (body[j], parents[body[j]]) and body[j] != parents[body[i]]]
    if not apart:
        return []
    places = _drawn(robot.copy(), sorted(set(body)))
    digest = hashlib.sha256()
    for position, rotation in places.values():
        digest.update(position.tobytes() + rotation.tobytes())
    key = digest.digest(), capsules, tuple(apart), clearance
    if key not in _FOUND:
        while len(_FOUND) >= REMEMBERED:
            del _FOUND[next(iter(_FOUND))]
        _FOUND[key] = _judged(robot, capsules, apart, clearance, places)
    return _FOUND[key]


def kept(clearance: float, home: float) -> float:
    """Clearance of two links that are ``home`` apart at home, below 0 for capsules that overlap there [m]."""
    return min(clearance, KEPT * home if home > 0.0 else home - SLACK)


def _drawn(robot: Robot, bodies: list[int]) -> dict[int, tuple[Mat, Mat]]:
    """Positions ``(n, 3)`` and rotations ``(n, 3, 3)`` of bodies, at home first."""
    rng = np.random.default_rng(0)
    low = np.where(np.isfinite(robot.lower), robot.lower, -np.pi)
    high = np.where(np.isfinite(robot.upper), robot.upper, np.pi)
    drawn = (robot.configuration(rng.uniform(low, high)) for _ in range(DRAWS))
    found: dict[int, tuple[Mat, Mat]] = {b: (np.empty((DRAWS + 1, 3)), np.empty((DRAWS + 1, 3, 3))) for b in bodies}
    for n, q in enumerate((robot.home, *drawn)):
        robot.state(q).kinematics()
        for b, (positions, rotations) in found.items():
            positions[n], rotations[n] = robot.bodies[b][5]
    return found


def _judged(
    robot: Robot, capsules: tuple[LinkCapsule, ...], pairs: list[Pair], clearance: float, places: Any
) -> list[Pair]:
    shapes = robot.contacts() if any(c.fitted for c in capsules) else None
    ends = []
    for c in capsules:
        position, rotation = places[c.body]
        ends.append((position + rotation @ np.array(c.a), position + rotation @ np.array(c.b)))
    middle = np.array([0.5 * (a + b) for a, b in ends])
    size = [0.5 * float(np.linalg.norm(np.subtract(c.b, c.a))) + c.radius for c in capsules]

    def gap(i: int, j: int, draws: Index) -> Any:
        between = distances.of_axes(*(end[draws] for end in (*ends[i], *ends[j])))
        return between - capsules[i].radius - capsules[j].radius

    def touch(i: int, j: int, draw: int) -> bool:
        one, two = capsules[i].body, capsules[j].body
        first, second = ((places[b][0][draw], places[b][1][draw]) for b in (one, two))
        assert shapes is not None
        return bool(shapes.touch(one, two, first, second))

    found = []
    for i, j in pairs:
        shaped = capsules[i].fitted and capsules[j].fitted
        home = float(gap(i, j, np.zeros(1, dtype=np.intp))[0])
        if touch(i, j, 0) if shaped else home <= 0.0:
            continue
        least = kept(clearance, home)
        off = np.linalg.norm(middle[i] - middle[j], axis=1) - size[i] - size[j]
        draws = np.flatnonzero(off < least)
        distance = gap(i, j, draws)
        draws, distance = draws[distance < least], distance[distance < least]
        tried = draws[:EVIDENCE].tolist()
        if len(tried) < EVIDENCE and home > 0.0:
            found.append((i, j))
            continue
        touching = (
            float(np.mean([touch(i, j, n) for n in tried] if shaped else distance[:EVIDENCE] <= 0.0)) if tried else 0.0
        )
        near = len(draws) / (DRAWS + 1)
        needless = near * (1.0 - touching) > MOST * (1.0 - near * touching)
        if touching > 0.5 or (home > 0.0 and touching > 0.0 and (touching >= MOST or not needless)):
            found.append((i, j))
    return found
