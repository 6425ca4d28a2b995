"""Pairs of shapes that may collide: links that may touch by accident, or pairs that the user names."""

from __future__ import annotations

import math
import xml.etree.ElementTree as ET
from itertools import combinations
from pathlib import Path

from hqp.declare.element import Element
from hqp.declare.robot import Robot
from hqp.errors import DeclarationError, closest
from hqp.shapes import LinkCapsule, Shape

from .touching import may_touch

SHORT = 0.01
"""Capsules whose axis is shorter than this [m] are as good as a ball."""

Pair = tuple[int, int]
World = tuple[Shape, ...]
Named = str | tuple[tuple[str, str], ...]


def candidates(
    element: Element, robot: Robot, world: World, named: Named, clearance: float
) -> tuple[tuple[LinkCapsule, ...], list[Pair]]:
    """The links' capsules and pairs of shapes, numbered in the order of capsules, then the world's shapes.

    element: for errors.  world, named, clearance: its ``world``, ``pairs`` and ``clearance`` [m].
    Next to a pair of a capsule with something flat stand those of its two ends, as capsules of no length.  The nearest
    point of a capsule that lies on a face jumps from one end to the other, and commands alternate where only that
    point has a row.  Raises DeclarationError for names and files of no use.
    """
    with robot.keep_shapes():
        capsules = tuple(robot.capsules)
        links = len(capsules)
        pairs = _pairs(element, robot, world, named, capsules, clearance)
    flat = {links + k for k, shape in enumerate(world) if shape.kind not in ("sphere", "capsule")}
    lying = [(i, j) for i, j in pairs if j in flat and math.dist(capsules[i].a, capsules[i].b) > SHORT]
    ends: dict[int, int] = {}
    points: list[LinkCapsule] = []
    for i, _ in lying:
        if i not in ends:
            own, ends[i] = capsules[i], links + len(points)
            points += [own._replace(b=own.a), own._replace(a=own.b)]
    more = len(points)
    whole = [(i, j + more if j >= links else j) for i, j in pairs]
    return (*capsules, *points), whole + [(ends[i] + k, j + more) for i, j in lying for k in (0, 1)]


def _pairs(
    element: Element, robot: Robot, world: World, pairs: Named, capsules: tuple[LinkCapsule, ...], clearance: float
) -> list[Pair]:
    links = len(capsules)
    every = range(links + len(world))
    if not isinstance(pairs, str):
        wanted = [(_named(element, robot, world, one), _named(element, robot, world, two)) for one, two in pairs]
        found = {(min(i, j), max(i, j)) for a, b in wanted for i in a for j in b if min(i, j) < links}
        body = [c.body for c in capsules] + [0] * len(world)
        return sorted((i, j) for i, j in found if body[i] != body[j])
    outside = [(i, j) for i in range(links) for j in every[links:] if capsules[i].body > 0]
    if pairs == "world":
        return outside
    off = robot.disabled_pairs if pairs == "auto" else _disabled(element, pairs)
    names = [_link(c.name) for c in capsules]
    within = [(i, j) for i, j in combinations(range(links), 2) if frozenset((names[i], names[j])) not in off]
    return may_touch(robot, capsules, within, clearance) + outside


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
    found = [k for k, c in enumerate(capsules) if name in (c.name, _link(c.name))]
    found += [len(capsules) + k for k, s in enumerate(world) if s.name == name]
    bodies = {robot.subtree(joint) for joint in robot.groups.get(name, ())}
    found += [k for k, c in enumerate(capsules) if c.body in bodies]
    if not found and name in robot.frame_names:
        found = [k for k, c in enumerate(capsules) if c.body == robot.body(robot.frame(name))]
    if not found:
        known = [*(_link(c.name) for c in capsules), *robot.groups, *(s.name for s in world)]
        near = ", ".join(closest(name, known) or known[:5])
        raise DeclarationError(element.name, f"no shape with that name; closest: {near}", value=name)
    return found


def _link(name: str) -> str:
    """The link of a capsule: a link with several numbers them after a slash."""
    link, _, number = name.rpartition("/")
    return link if link and number.isdigit() else name
