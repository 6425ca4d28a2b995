"""Pairs of links that may touch by accident: apart at home, and drawn configurations bring their shapes together."""

from __future__ import annotations

import contextlib
import hashlib
import math
import re
from collections import defaultdict
from collections.abc import Callable
from pathlib import Path
from typing import Any, NamedTuple

import numpy as np

from hqp import user_cache
from hqp.arrays import Index, Mask, Mat, Vec
from hqp.declare.robot import Robot
from hqp.shapes import LinkCapsule, LinkHull

from . import distances

DRAWS = 2000
"""Configurations drawn within the joint ranges."""
EVIDENCE = 100
"""Configurations with near capsules after which a pair counts as harmless if its shapes touch in none."""
MOST = 0.5
"""A row is worth its place if shapes touch in more than this share of the configurations that it excludes."""
SPARED = 1.0 / 3.0
"""Otherwise it is needless if it excludes more than this share of the configurations with shapes apart; so are all rows
of links whose shapes are apart in less than this share of the configurations."""
PASSED = 0.2
"""Share of the configurations with shapes apart in which two links may be nearer than their clearance."""
HALVINGS = 3
"""Times that this clearance of two links may be halved."""
KEPT = 0.8
"""Share of their distance at home that two links keep at most."""
SLACK = 1e-3
"""Depth by which capsules that overlap at home may overlap more [m]: noise at home moves nothing."""
REMEMBERED = 64
"""Robots whose pairs are remembered: copies of a robot share them."""

Pair = tuple[int, int]
_Row = tuple[Mask, LinkCapsule, LinkHull]
_NONE = np.zeros(0, dtype=np.intp)
Places = dict[int, tuple[Mat, Mat]]
Key = tuple[Any, ...]


class Judged(NamedTuple):
    """Pairs of capsules, hulls of links, edges of hulls, and pairs of a capsule or edge and a hull, by their numbers.

    Edges are counted after the capsules.  unseparated: pairs of capsules whose links may touch although all rows hold,
    since no hull keeps them apart either, or since they touch in most configurations.  lowered: clearances of pairs of
    bodies below the declared one [m].
    """

    pairs: list[Pair]
    hulls: tuple[LinkHull, ...]
    closer: list[Pair]
    unseparated: list[Pair]
    edges: tuple[LinkCapsule, ...] = ()
    lowered: dict[Pair, float] = {}  # noqa: RUF012  (read only)


_FOUND: dict[Key, Judged] = {}


def may_touch(robot: Robot, capsules: tuple[LinkCapsule, ...], pairs: list[Pair], clearance: float) -> Judged:
    """Return the pairs of capsules of links that may touch by accident.  A pair does not count if

    - its links are one body, or one carries the other: the range of their joint is the limit,
    - the shapes of its links touch at home,
    - they are apart in less than a third of all configurations: then the ranges of the joints are right and the shapes
      are not, and the links are among the unseparated,
    - the shapes touch in none of 100 configurations with capsules nearer than the clearance,
    - it is needless: the clearance excludes more than a third of the configurations with shapes apart, and the shapes
      touch in less than half of those that it excludes, or
    - its capsules overlap at home, and the shapes touch in less than half of the configurations that its clearance
      (``kept``) excludes.

    If the shapes of two links touch in a configuration that the rows of their capsules allow, those of one link as
    convex hulls take the place of its capsules, if they are apart from the capsules of the other link at home.  If
    they are not, or if the shapes touch in less than half of the configurations that they exclude, a few edges of
    either link's hulls, which the hulls of the other stay away from, take the place of all capsules, if the shapes
    touch in more than a third of those that edges exclude.  Links that pass each other closely by their design keep the
    distance below which they are in a fifth of the configurations with shapes apart.  If all rows are needless then,
    this clearance of the two links is halved, up to three times.

    Configurations are drawn within the joint ranges; pairs that come near in fewer than 100 of 2000 count, unless their
    capsules overlap at home.  Shapes are those that capsules are fitted to; other capsules are the shapes themselves.
    clearance [m]: see ``kept`` (allowed collisions by drawn configurations: Coleman et al. 2014, MoveIt).
    """
    parents = [body[0] for body in robot.bodies]
    body = [c.body for c in capsules]
    apart = [(i, j) for i, j in pairs if body[i] not in (body[j], parents[body[j]]) and body[j] != parents[body[i]]]
    if not apart:
        return Judged([], (), [], [])
    bodies = sorted(set(body))
    key = _digest(_drawn(robot.copy(), bodies, 1)), capsules, tuple(apart), clearance

    def judge() -> Judged:
        shapes = robot.contacts() if any(c.fitted for c in capsules) else None
        path = _path(robot, (*key, shapes.digest() if shapes else b"", user_cache.sources()))
        found = _read(path)
        if found is None:
            found = _judged(shapes, capsules, apart, clearance, _drawn(robot.copy(), bodies, DRAWS))
            _write(path, found)
        return found

    return _remembered(key, judge)


def _path(robot: Robot, key: Key) -> Path | None:
    """A file by the robot's name and by all inputs of its pairs; None if the user has no home."""
    name = re.sub(r"[^\w.-]", "_", robot.name)[:60]
    try:
        return user_cache.folder("pairs") / f"{name}-{hashlib.sha256(repr(key).encode()).hexdigest()[:24]}.json"
    except RuntimeError:
        return None


def _read(path: Path | None) -> Judged | None:
    """The pairs that an earlier process has judged."""
    found: Any = user_cache.read(path) if path else None
    try:
        pairs, hulls, closer, unseparated, edges, lowered = found
        return Judged(
            [(i, j) for i, j in pairs],
            tuple(LinkHull(n, b, _tuples(c), _tuples(t), r) for n, b, c, t, r in hulls),
            [(i, j) for i, j in closer],
            [(i, j) for i, j in unseparated],
            tuple(LinkCapsule(n, b, tuple(a), tuple(e), r, f) for n, b, a, e, r, f in edges),
            {(i, j): least for i, j, least in lowered},
        )
    except (TypeError, ValueError):
        return None


def _tuples(rows: list[list[Any]]) -> tuple[Any, ...]:
    return tuple(map(tuple, rows))


def _write(path: Path | None, found: Judged) -> None:
    """Keep the pairs for later processes, if the user's cache can be written."""
    lowered = [[*bodies, least] for bodies, least in found.lowered.items()]
    with contextlib.suppress(OSError):
        if path:
            user_cache.write(path, [*found[:5], lowered])


def _digest(places: Places) -> bytes:
    """Equal for equal places of bodies, which equal robots have."""
    digest = hashlib.sha256()
    for position, rotation in places.values():
        digest.update(position.tobytes() + rotation.tobytes())
    return digest.digest()


def _remembered(key: Key, judge: Callable[[], Judged]) -> Judged:
    """Judge a key once, as long as few other keys are judged."""
    if key not in _FOUND:
        while len(_FOUND) >= REMEMBERED:
            del _FOUND[next(iter(_FOUND))]
        _FOUND[key] = judge()
    return _FOUND[key]


def kept(clearance: float, home: float) -> float:
    """Clearance of two links that are ``home`` apart at home, below 0 for capsules that overlap there [m]."""
    return min(clearance, KEPT * home if home > 0.0 else home - SLACK)


def _drawn(robot: Robot, bodies: list[int], draws: int) -> Places:
    """Positions ``(n, 3)`` and rotations ``(n, 3, 3)`` of bodies, at home first."""
    rng = np.random.default_rng(0)
    low = np.where(np.isfinite(robot.lower), robot.lower, -np.pi)
    high = np.where(np.isfinite(robot.upper), robot.upper, np.pi)
    drawn = (robot.configuration(rng.uniform(low, high)) for _ in range(draws))
    found: Places = {b: (np.empty((draws + 1, 3)), np.empty((draws + 1, 3, 3))) for b in bodies}
    for n, q in enumerate((robot.home, *drawn)):
        robot.state(q).kinematics()
        for b, (positions, rotations) in found.items():
            positions[n], rotations[n] = robot.bodies[b][5]
    return found


def _judged(
    shapes: Any, capsules: tuple[LinkCapsule, ...], pairs: list[Pair], clearance: float, places: Places
) -> Judged:
    drawn = _Drawn(capsules, places, shapes)
    links: dict[Pair, list[Pair]] = defaultdict(list)
    for i, j in pairs:
        links[_bodies(capsules, i, j)].append((i, j))
    found, unseparated, closer = [], [], _Closer(drawn)
    lowered: dict[Pair, float] = {}
    for bodies, those in links.items():
        if drawn.denied(those):
            unseparated.append(those[0])
            continue
        for least in drawn.passing(those, clearance) * 0.5 ** np.arange(HALVINGS + 1 if clearance > 0.0 else 1):
            rows = [pair for pair in those if drawn.count(*pair, least)]
            if not drawn.escapes(those, rows, least):
                break
            if drawn.shaped(*those[0]) and closer.take(those, least):
                rows = []
                break
        else:
            least, rows = clearance, [pair for pair in those if drawn.count(*pair, clearance)]
            unseparated.append(those[0])
        found += rows
        if least < clearance:
            lowered[bodies] = float(least)
    return Judged(sorted(found), tuple(closer.hulls), closer.pairs, unseparated, tuple(closer.edges), lowered)


def closer(robot: Robot, capsules: tuple[LinkCapsule, ...], pairs: list[Pair]) -> Judged:
    """Pairs that the user names, with hulls in place of capsules fitted to shapes that overlap at home.

    unseparated: the links whose hulls overlap there, too.
    """
    places = _drawn(robot.copy(), sorted({c.body for c in capsules}), 0)
    return _remembered((_digest(places), capsules, tuple(pairs)), lambda: _named(robot, capsules, pairs, places))


def _named(robot: Robot, capsules: tuple[LinkCapsule, ...], pairs: list[Pair], places: Places) -> Judged:
    """Judge pairs of capsules at home, where bodies have the given places."""
    drawn = _Drawn(capsules, places, None)
    links: dict[Pair, list[Pair]] = defaultdict(list)
    for i, j in pairs:
        links[_bodies(capsules, i, j)].append((i, j))
    found, unseparated = list[Pair](), list[Pair]()
    hulls: list[LinkHull] = []
    more: list[Pair] = []
    for those in links.values():
        if not drawn.shaped(*those[0]) or all(drawn.home(*pair) > 0.0 for pair in those):
            found += those
            continue
        drawn.shapes = drawn.shapes or robot.contacts()
        best: tuple[float, list[int], tuple[LinkHull, ...]] = 0.0, [], ()
        for own, others in (sides := _sides(capsules, those), sides[::-1]):
            tried = drawn.hulls(others[0])
            home = min(float(drawn.gap_to(capsules[i], hull, math.inf)[0]) for i in own for hull in tried)
            best = max(best, (home, own, tried), key=lambda side: side[0])
        _, own, tried = best
        unseparated += [] if own else those[:1]
        more += [(i, len(hulls) + k) for i in own for k in range(len(tried))]
        hulls += tried
    return Judged(sorted(found), tuple(hulls), more, unseparated)


def _bodies(capsules: tuple[LinkCapsule, ...], i: int, j: int) -> Pair:
    one, two = capsules[i].body, capsules[j].body
    return min(one, two), max(one, two)


def _sides(capsules: tuple[LinkCapsule, ...], pairs: list[Pair]) -> tuple[list[int], list[int]]:
    """Capsules of either link of pairs of two links."""
    first = capsules[pairs[0][0]].body
    every = sorted({k for pair in pairs for k in pair})
    return [k for k in every if capsules[k].body == first], [k for k in every if capsules[k].body != first]


class _Drawn:
    """Distances of capsules in drawn configurations, and contact of the shapes of their links."""

    def __init__(self, capsules: tuple[LinkCapsule, ...], places: Places, shapes: Any) -> None:
        self.capsules, self.places, self.shapes = capsules, places, shapes
        self._touching: dict[tuple[int, int, int], bool] = {}
        self._near: dict[Pair, tuple[float, Index, Vec]] = {}
        self._home: dict[Pair, float] = {}
        self._gaps: dict[tuple[LinkCapsule | LinkHull, LinkHull], tuple[float, Vec]] = {}
        self.ends = []
        for c in capsules:
            position, rotation = places[c.body]
            self.ends.append((position + rotation @ np.array(c.a), position + rotation @ np.array(c.b)))
        self.middle = [0.5 * (a + b) for a, b in self.ends]
        self.size = [0.5 * float(np.linalg.norm(np.subtract(c.b, c.a))) + c.radius for c in capsules]

    def gap(self, i: int, j: int, draws: Index) -> Any:
        between = distances.of_axes(*(end[draws] for end in (*self.ends[i], *self.ends[j])))
        return between - self.capsules[i].radius - self.capsules[j].radius

    def home(self, i: int, j: int) -> float:
        if (i, j) not in self._home:
            self._home[i, j] = float(self.gap(i, j, np.zeros(1, dtype=np.intp))[0])
        return self._home[i, j]

    def near(self, i: int, j: int, least: float) -> Index:
        """Configurations in which capsules are nearer than a distance."""
        most, draws, distance = self._near.get((i, j), (-math.inf, _NONE, _NONE))
        if most < least:  # measured once, usually: the first distance of a pair is its largest
            off = np.linalg.norm(self.middle[i] - self.middle[j], axis=1) - self.size[i] - self.size[j]
            draws = np.flatnonzero(off < least)
            distance = self.gap(i, j, draws)
            self._near[i, j] = least, draws, distance
        return draws[distance < least]

    def touch(self, i: int, j: int, draw: int) -> bool:
        """Return true if the shapes of the links of two capsules, or capsules that are shapes, touch in a draw."""
        if not self.shaped(i, j):
            return bool(self.gap(i, j, np.array([draw]))[0] <= 0.0)
        return self.bodies_touch(self.capsules[i].body, self.capsules[j].body, draw)

    def bodies_touch(self, one: int, two: int, draw: int) -> bool:
        """Return true if the shapes of two bodies touch in a configuration."""
        key = min(one, two), max(one, two), draw
        if key not in self._touching:
            first, second = ((self.places[b][0][draw], self.places[b][1][draw]) for b in key[:2])
            self._touching[key] = bool(self.shapes.touch(*key[:2], first, second))
        return self._touching[key]

    def hulls(self, i: int) -> tuple[LinkHull, ...]:
        """Hulls of the shapes of a capsule's link."""
        return tuple(self.shapes.hulls(self.capsules[i].body, self.capsules[i].link))

    def meeting(self, one: LinkHull, two: LinkHull, draws: Index) -> list[tuple[LinkCapsule, LinkHull]]:
        """Edges of two hulls that are nearest to the other in some configurations, with it."""
        from . import hull_distances

        found = list[tuple[LinkCapsule, LinkHull]]()
        points = hull_distances.witnesses(one, self._poses(one, draws), two, self._poses(two, draws))
        for own, other, at in zip((one, two), (two, one), points, strict=True):
            edges = own.edges
            a, b = (np.array([getattr(edge, end) for edge in edges])[:, None] for end in "ab")
            nearest = np.linalg.norm(_off(at, a, b), axis=2).argmin(axis=0)
            found += [(edges[k], other) for k in np.unique(nearest).tolist()]
        return found

    def gap_to(self, own: LinkCapsule | LinkHull, hull: LinkHull, least: float, draws: Index | None = None) -> Vec:
        """Distances between a capsule or a hull and a hull, exact as far as ``kept`` of a clearance needs them [m]."""
        from . import hull_distances  # coal comes with Pinocchio, but takes its time to import

        far, gaps = self._gaps.setdefault(
            (own, hull), (least / KEPT, np.full(len(self._poses(hull, slice(None))[0]), np.nan))
        )
        if far < least / KEPT:  # measured once for the largest distance, usually the first
            gaps[gaps > far] = np.nan
            self._gaps[own, hull] = least / KEPT, gaps
        wanted = np.arange(len(gaps)) if draws is None else draws
        new = wanted[np.isnan(gaps[wanted])]
        gaps[new] = hull_distances.between(own, self._poses(own, new), hull, self._poses(hull, new), least / KEPT)
        return gaps[wanted]

    def _poses(self, shape: LinkCapsule | LinkHull, draws: Any) -> tuple[Mat, Mat]:
        position, rotation = self.places[shape.body]
        return position[draws], rotation[draws]

    def shaped(self, i: int, j: int) -> bool:
        return self.capsules[i].fitted and self.capsules[j].fitted

    def count(self, i: int, j: int, clearance: float) -> bool:
        """Return true if a pair of capsules may touch by accident."""
        if self.touch(i, j, 0):
            return False
        home = self.home(i, j)
        draws = self.near(i, j, kept(clearance, home))
        tried = draws[:EVIDENCE].tolist()
        if len(tried) < EVIDENCE and home > 0.0:
            return True
        touching = float(np.mean([self.touch(i, j, n) for n in tried])) if tried else 0.0
        return touching > MOST or (home > 0.0 and touching > 0.0 and not needless(len(draws), touching))

    def passing(self, pairs: list[Pair], clearance: float) -> float:
        """Clearance [m] that two links keep in all but ``PASSED`` of the configurations with their shapes apart.

        At most the given one; links that pass each other closely by design are mostly nearer.
        """
        every, near = len(self.middle[0]), np.unique(np.concatenate([self.near(*pair, clearance) for pair in pairs]))
        if near.size <= PASSED * every:
            return clearance
        if self.shaped(*pairs[0]):
            one, two = (self.hulls(own[0]) for own in _sides(self.capsules, pairs))
            gaps = [self.gap_to(a, b, clearance, near) for a in one for b in two]
        else:
            gaps = [self.gap(*pair, near) for pair in pairs]
        gap = np.min(gaps, axis=0)
        apart = np.sort(gap[gap > 0.0])
        least = int(PASSED * (every - near.size + apart.size))
        return min(clearance, float(apart[least])) if least < apart.size else clearance

    def denied(self, pairs: list[Pair]) -> bool:
        """Return true if shapes of two links are apart at home, but in less than ``SPARED`` of all configurations."""
        pairs, inside = [pair for pair in pairs if not self.touch(*pair, 0)], np.zeros(DRAWS + 1, dtype=bool)
        for pair in pairs:
            inside[self.near(*pair, 0.0)] = True
        if inside.mean() < 1.0 - SPARED:
            return False
        touching = [any(self.touch(*pair, n) for pair in pairs) for n in np.flatnonzero(inside)[:EVIDENCE].tolist()]
        return float(inside.mean() * np.mean(touching)) > 1.0 - SPARED

    def escapes(self, pairs: list[Pair], rows: list[Pair], clearance: float) -> bool:
        """Return true if shapes apart at home touch in a configuration that the rows of their links' capsules allow, or
        may do so, since these overlap at home."""
        pairs = [pair for pair in pairs if not self.touch(*pair, 0)]
        if pairs and any(self.home(*pair) <= 0.0 for pair in rows):
            return True
        held = np.zeros(DRAWS + 1, dtype=bool)
        for i, j in rows:
            least = kept(clearance, self.home(i, j))
            if least > -self.capsules[i].radius - self.capsules[j].radius:
                held[self.near(i, j, least)] = True
        inside = (self.near(*pair, 0.0) for pair in pairs)
        free = ((pair, draws[~held[draws]][:EVIDENCE].tolist()) for pair, draws in zip(pairs, inside, strict=True))
        return any(self.touch(*pair, n) for pair, tried in free for n in tried)


class _Side(NamedTuple):
    """Rows of a link's capsules or edges to hulls of another: number of configurations that they exclude, share of
    those in which the shapes touch, and the rows that are needed."""

    excluded: int
    touching: float
    rows: list[tuple[LinkCapsule, LinkHull]]


class _Closer:
    """Pairs of a capsule or an edge and a hull of the other link, for links that their capsules do not keep apart."""

    def __init__(self, drawn: _Drawn) -> None:
        self.hulls: list[LinkHull] = []
        self.edges: list[LinkCapsule] = []
        self.pairs: list[Pair] = []
        self._drawn = drawn

    def take(self, pairs: list[Pair], clearance: float) -> bool:
        """Take the hulls of the link that excludes fewer configurations; return false if neither is apart at home."""
        drawn, every = self._drawn, self._drawn.capsules
        both = _sides(every, pairs)
        found = [self._side(both[k], drawn.hulls(both[1 - k][0]), clearance) for k in (0, 1)]
        if not any(side.touching > MOST for side in found if side):
            found.append(self._edges(*both, clearance))
        best = min((side for side in found if side), key=lambda side: side.excluded, default=None)
        for own, hull in best.rows if best else ():
            if own not in every and own not in self.edges:
                self.edges.append(own)
            if hull not in self.hulls:
                self.hulls.append(hull)
            number = every.index(own) if own in every else len(every) + self.edges.index(own)
            self.pairs.append((number, self.hulls.index(hull)))
        return best is not None

    def _side(self, own: list[int], hulls: tuple[LinkHull, ...], clearance: float) -> _Side | None:
        """Rows of a link's capsules to the hulls of another; None if they overlap at home or are needless."""
        rows: list[_Row] = []
        for hull in hulls:
            for capsule in (self._drawn.capsules[k] for k in own):
                gap = self._drawn.gap_to(capsule, hull, clearance)
                if not gap[0] > 0.0:
                    return None
                rows.append((gap < kept(clearance, float(gap[0])), capsule, hull))
        return self._judged(rows)

    def _edges(self, own: list[int], others: list[int], clearance: float) -> _Side | None:
        """Rows of edges of the hulls of two links, each to a hull of the other link.

        None if they overlap at home, or exclude mostly configurations with shapes apart.
        """
        drawn, rows = self._drawn, list[_Row]()
        for one in drawn.hulls(own[0]):
            for two in drawn.hulls(others[0]):
                gap = drawn.gap_to(one, two, clearance)
                if not gap[0] > 0.0:
                    return None
                near = np.flatnonzero(gap < kept(clearance, float(gap[0])))
                for edge, hull in drawn.meeting(one, two, near):
                    draws, excludes = np.concatenate(([0], near)), np.zeros(DRAWS + 1, dtype=bool)
                    gap = drawn.gap_to(edge, hull, clearance, draws)
                    excludes[draws] = gap < kept(clearance, float(gap[0]))
                    rows.append((excludes, edge, hull))
        side = self._judged(rows) if rows else None
        return side if side and side.touching > SPARED else None

    def _judged(self, rows: list[_Row]) -> _Side | None:
        """The rows of a side that are needed; None if their shapes touch too rarely."""
        needed, near = _needed(rows)
        tried = np.flatnonzero(near)[:EVIDENCE].tolist()
        touching = float(np.mean([self._drawn.bodies_touch(*_ends(rows[0]), n) for n in tried])) if tried else 0.0
        if not touching or needless(int(near.sum()), touching):
            return None
        return _Side(int(near.sum()), touching, needed)


def _ends(row: _Row) -> Pair:
    """Bodies of a row."""
    return row[1].body, row[2].body


def _needed(rows: list[_Row]) -> tuple[list[tuple[LinkCapsule, LinkHull]], Mask]:
    """Few of some rows, which exclude the configurations that all exclude, and these."""
    near, used = np.zeros(DRAWS + 1, dtype=bool), []
    while rows:
        excluded, own, hull = max(rows, key=lambda row: int((row[0] & ~near).sum()))
        if not (excluded & ~near).any():
            break
        used.append((own, hull))
        near |= excluded
    return used, near


def _off(p: Mat, a: Mat, b: Mat) -> Mat:
    """From the nearest points of segments a b ``(k, 1, 3)`` to points ``(n, 3)``: ``(k, n, 3)``."""
    u = b - a
    share = np.clip(np.einsum("kni,kni->kn", p - a, u + 0.0 * p) / np.einsum("kni,kni->kn", u, u), 0.0, 1.0)
    return np.asarray(p - a - share[..., None] * u)


def needless(excluded: int, touching: float) -> bool:
    """Return true if a clearance excludes too many configurations, in which shapes touch with this share."""
    near = excluded / (DRAWS + 1)
    return touching <= MOST and near * (1.0 - touching) > SPARED * (1.0 - near * touching)
