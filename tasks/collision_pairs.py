"""Pairs of shapes that may collide: links that may touch by accident, or pairs that the user names."""

from __future__ import annotations

import math
import xml.etree.ElementTree as ET
from collections.abc import Sequence
from itertools import combinations
from pathlib import Path
from typing import NamedTuple

from hqp.declare.element import Element
from hqp.declare.robot import Robot
from hqp.errors import DeclarationError, closest
from hqp.shapes import LinkCapsule, LinkHull, Shape

from .touching import Judged, closer, may_touch

SHORT = 0.01
"""Capsules whose axis is shorter than this [m] are as good as a ball."""

Pair = tuple[int, int]
World = tuple[Shape, ...]
Named = str | tuple[tuple[str, str], ...]
Moving = str | Sequence[str] | None


class Candidates(NamedTuple):
    """Shapes of links, capsules before hulls and points, and pairs of their numbers and, after them, the world's.

    unseparated: links that may touch, without fitted shapes that are apart at home.  lowered: see ``Judged``.
    """

    links: tuple[LinkCapsule | LinkHull, ...]
    pairs: list[Pair]
    unseparated: tuple[str, ...]
    lowered: dict[Pair, float]


def candidates(
    element: Element, robot: Robot, world: World, named: Named, clearance: float, joints: Moving = None
) -> Candidates:
    """The shapes of the links and pairs of shapes.

    element: for errors.  world, named, clearance, joints: its ``world``, ``pairs``, ``clearance`` [m] and ``joints``.
    Next to a pair of a capsule with something flat stand those of its two ends, as capsules of no length.  The nearest
    point of a capsule that lies on a face jumps from one end to the other, and commands alternate where only that
    point has a row.  Raises DeclarationError for names and files of no use.
    """
    with robot.keep_shapes():
        capsules = tuple(robot.capsules)
        judged, outside = _pairs(element, robot, world, named, capsules, clearance)
        own = (*capsules, *judged.edges)
        links: tuple[LinkCapsule | LinkHull, ...] = (*own, *judged.hulls)
    first = len(own)
    pairs, apart = judged.pairs + [(i, first + k) for i, k in judged.closer], judged.unseparated
    if joints is not None:
        moved = {robot.subtree(robot.joint_name(int(c))) for c in robot.joints(joints)}
        pairs, apart = ([(i, j) for i, j in of if {links[i].body, links[j].body} & moved] for of in (pairs, apart))
        outside = [(i, k) for i, k in outside if links[i].body in moved]
    lying = [(i, j) for i, j in pairs if j >= first]
    lying += [(i, len(links) + k) for i, k in outside if world[k].kind not in ("sphere", "capsule")]
    lying = [(i, j) for i, j in lying if math.dist(own[i].a, own[i].b) > SHORT]
    ends: dict[int, int] = {}
    points: list[LinkCapsule] = []
    for i, _ in lying:
        if i not in ends:
            ends[i] = len(links) + len(points)
            points += [own[i]._replace(b=own[i].a), own[i]._replace(a=own[i].b)]
    more = len(points)
    every = pairs + [(i, len(links) + more + k) for i, k in outside]
    every += [(ends[i] + k, j + more if j >= len(links) else j) for i, j in lying for k in (0, 1)]
    names = tuple(f"{capsules[i].link} - {capsules[j].link}" for i, j in apart)
    return Candidates((*links, *points), every, names, judged.lowered)


def _pairs(
    element: Element, robot: Robot, world: World, pairs: Named, capsules: tuple[LinkCapsule, ...], clearance: float
) -> tuple[Judged, list[Pair]]:
    """Pairs of links, and of capsules with shapes of the world, by the number there."""
    links, none = range(len(capsules)), Judged([], (), [], [])
    if not isinstance(pairs, str):
        wanted = [(_named(element, robot, world, one), _named(element, robot, world, two)) for one, two in pairs]
        found = {(min(i, j), max(i, j)) for a, b in wanted for i in a for j in b if min(i, j) < len(links)}
        body = [c.body for c in capsules] + [0] * len(world)
        apart = sorted((i, j) for i, j in found if body[i] != body[j])
        judged = closer(robot, capsules, [(i, j) for i, j in apart if j < len(links)])
        parents = [b[0] for b in robot.bodies]
        close = {frozenset((body[i], body[j])) for i, j in judged.unseparated}
        for (one, two), (a, b) in zip(pairs, wanted, strict=True):
            both = {frozenset((body[i], body[j])) for i in a for j in b if body[i] != body[j]}
            if both and both <= close:
                allowed = "links apart at home, or capsules of your own (with_capsules): shapes fitted to these overlap"
                raise element.invalid("pairs", (one, two), f"{allowed} there, so no row keeps them apart")
        left = [(i, j) for i, j in judged.unseparated if body[i] != parents[body[j]] and body[j] != parents[body[i]]]
        return judged._replace(unseparated=left), [(i, j - len(links)) for i, j in apart if j >= len(links)]
    outside = [(i, k) for i in links for k in range(len(world)) if capsules[i].body > 0]
    if pairs == "world":
        return none, outside
    off = robot.disabled_pairs if pairs == "auto" else _disabled(element, pairs)
    names = [c.link for c in capsules]
    within = [(i, j) for i, j in combinations(links, 2) if frozenset((names[i], names[j])) not in off]
    return may_touch(robot, capsules, within, clearance), outside


def _disabled(element: Element, path: str) -> set[frozenset[str]]:
    """Pairs of links that an SRDF disables; raises DeclarationError where it cannot be read."""
    try:
        root = ET.parse(Path(path)).getroot()
    except (OSError, ValueError, ET.ParseError) as error:
        raise element.invalid(
            "pairs", path, f'"auto", "world", the path of a readable SRDF, or pairs of names ({error})'
        ) from error
    return {frozenset((str(e.get("link1")), str(e.get("link2")))) for e in root.iter("disable_collisions")}


def _named(element: Element, robot: Robot, world: World, name: str) -> list[int]:
    """Shapes of a link, a joint group, or the world; raises DeclarationError with the closest names."""
    capsules = tuple(robot.capsules)
    found = [k for k, c in enumerate(capsules) if name in (c.name, c.link)]
    found += [len(capsules) + k for k, s in enumerate(world) if s.name == name]
    bodies = {robot.subtree(joint) for joint in robot.groups.get(name, ())}
    found += [k for k, c in enumerate(capsules) if c.body in bodies]
    if not found and name in robot.frame_names:
        found = [k for k, c in enumerate(capsules) if c.body == robot.body(robot.frame(name))]
    if not found:
        known = [*(c.link for c in capsules), *robot.groups, *(s.name for s in world)]
        near = ", ".join(closest(name, known) or known[:5])
        raise DeclarationError(element.name, f"no shape with that name; closest: {near}", value=name)
    return found
