"""Pairs that are near, and which of them have the rows now: one scene for an element on a robot."""

from __future__ import annotations

import math
from collections import defaultdict
from collections.abc import Iterable
from typing import TYPE_CHECKING, Any, TypeAlias
from weakref import WeakKeyDictionary, proxy

import numpy as np
from numpy.typing import NDArray

from hqp.arrays import Mat, Vec
from hqp.declare.robot import Robot, State
from hqp.shapes import LinkHull, Shape

from . import distances
from .collision_motion import FORESIGHT, Motions
from .collision_pairs import SHORT, candidates
from .collision_rows import Near, assign
from .polytopes import at_least, nearest_feature, polytope, to_polytope
from .touching import KEPT, kept

if TYPE_CHECKING:
    from .collision import CollisionAvoidance

MOST = 64
"""Slots by default beside those of rows that are near at home, if there are more pairs."""
Tables: TypeAlias = tuple[
    tuple[tuple[int, tuple[float, ...], float], ...],
    tuple[tuple[int, float, tuple[float, ...], tuple[int, ...]], ...],
    tuple[tuple[int, tuple[float, ...]], ...],
    tuple[str, ...],
    tuple[tuple[int, ...], ...],
    tuple[tuple[int, int], ...],
    tuple[float, ...],
]


_SCENES: WeakKeyDictionary[Robot, dict[Any, Scene]] = WeakKeyDictionary()


def scene(element: CollisionAvoidance, robot: Robot) -> Scene:
    """The scene of an element on a robot, found once; raises DeclarationError, ModelError."""
    scenes = _SCENES.setdefault(robot, {})
    if element not in scenes:
        scenes[element] = Scene(element, robot)
    return scenes[element]


class Scene:
    """Shapes (capsules and hulls of links, then the world's), pairs of them ``(n, 2)`` with clearances, and slots.

    slots ``(m,)`` holds the number of the pair or end in each row, -1 for none; the native operation writes it too.
    The number is n for a pair, or, with N pairs, n + k N for an end of its capsules, k = 1 and 2 of the first, 3 and 4
    of the second.  The nearest point of capsules side by side jumps from one end to the other, and commands alternate
    where only that point has a row.
    """

    def __init__(self, element: CollisionAvoidance, robot: Robot) -> None:
        self._robot: Robot = proxy(robot)  # the robot holds the scene, not the other way round
        self._element = element
        self.capsules, self.pairs, self.unseparated, lowered = candidates(
            element, robot, element.world, element.pairs, element.clearance, element.joints
        )
        self._hulls = {k: polytope(c) for k, c in enumerate(self.capsules) if isinstance(c, LinkHull)}
        self.world: tuple[Shape, ...] = element.world
        self.links = len(self.capsules)
        if any(shape.is_mesh for shape in self.world):
            from . import meshes  # coal comes with Pinocchio, but takes its time to import

            self._meshes = meshes
            for shape in self.world:
                if shape.is_mesh:
                    meshes.read(shape)
        self._twin = robot.copy()
        self._twin.state(self._twin.home).kinematics()
        home, declared = self._twin.bodies, element.poses()
        found: list[tuple[int, int]] = []
        clearances: list[float] = []
        overlapping: list[tuple[float, str]] = []
        closer: dict[tuple[int, int], str] = {}
        self._local = [(np.array(c.a), np.array(c.b)) for c in self.capsules]
        for k, (one, two) in enumerate(self.pairs):
            clearance = element.clearance
            if two < self.links:
                bodies = self.body(one), self.body(two)
                pair = min(bodies), max(bodies)
                clearance = lowered.get(pair, clearance)
                if clearance < KEPT * element.clearance:
                    closer.setdefault(pair, f"{self.name(one)} - {self.name(two)} ({1e3 * clearance:.2g} mm)")
                d = self.measure(k, declared, self._ends(one, home), self.placed(two, home))[0]
                clearance = kept(clearance, d)
                if d <= 0.0:
                    overlapping.append((d, f"{self.name(one)} - {self.name(two)} ({-1e3 * d:.1f} mm)"))
                    if clearance <= -self.capsules[one].radius - self.capsules[two].radius:
                        continue  # axes that cross at home come no nearer
            found.append((one, two))
            clearances.append(clearance)
        if not found:
            allowed = "names of links or shapes that may collide; all pairs of these overlap at home"
            raise element.invalid("pairs", element.pairs, allowed)
        self.overlapping = [text for _, text in sorted(overlapping)]
        """Pairs whose capsules overlap at home and by how far, the deepest first."""
        self.lowered = list(closer.values())
        """Links that pass each other closely, and their clearance."""
        self.pairs, self.clearance = found, np.array(clearances)
        most = len(found) + 4 * sum(self._sided(*pair) for pair in found)
        self._columns = {body: self._support(body) for body in {c.body for c in self.capsules}}
        self._sizes = np.array([0.5 * math.dist(c.a, c.b) + c.radius for c in self.capsules])
        self._pairs = np.array(found)
        at_home = self._near(home, declared, None)
        self.slots: NDArray[np.int32] = np.full(min(element.slots or MOST + len(at_home), most), -1, dtype=np.int32)

    def body(self, k: int) -> int:
        """Body of a shape, 0 for the world."""
        return self.capsules[k].body if k < self.links else 0

    def name(self, k: int) -> str:
        """Name of a shape."""
        return self.capsules[k].name if k < self.links else self.world[k - self.links].name

    def pair(self, row: int) -> tuple[int, int]:
        """The shapes of a pair, or of the one that an end belongs to."""
        return self.pairs[row % len(self.pairs)]

    def row_names(self) -> tuple[str, ...]:
        """Names of the pairs in the slots."""
        return tuple("free" if p < 0 else " - ".join(map(self.name, self.pair(p))) for p in self.slots)

    def difference(self, pair: int) -> Vec:
        """1 for each tangent coordinate that moves only the second shape, -1 only the first, ``(nv,)``."""
        one, two = (self.body(k) for k in self.pair(pair))
        none = np.zeros(self._robot.nv)
        return self._columns.get(two, none) - self._columns.get(one, none)

    def _ends(self, k: int, bodies: Any) -> tuple[Vec, Vec]:
        position, rotation = bodies[self.capsules[k].body][5]
        a, b = self._local[k]
        return position + rotation @ a, position + rotation @ b

    def is_hull(self, k: int) -> bool:
        """Return true for the hull of a link."""
        return k in self._hulls

    def placed(self, k: int, bodies: Any = None) -> tuple[Vec, Mat]:
        """Ends of a link's capsule in the world [m], or position and rotation of a hull, as of the current state."""
        bodies = self._robot.bodies if bodies is None else bodies
        if not self.is_hull(k):
            return self._ends(k, bodies)
        position, rotation = bodies[self.capsules[k].body][5]
        return position, rotation

    def feature(self, pair: int) -> int:
        """The nearest feature of the hull of a pair in the current state, -1 for other pairs."""
        i, j = self.pair(pair)
        return nearest_feature(*self.placed(i), self._hulls[j], *self.placed(j)) if self.is_hull(j) else -1

    def measure(self, pair: int, poses: Mat, one: Any, two: Any, *, feature: int = -1) -> distances.Found:
        """Distance, normal and nearest point of a pair or an end, whose links are ``placed`` there.

        feature: number of a hull's feature, -1 for the nearest.
        """
        i, j = self.pair(pair)
        end, (a, b), radius = pair // len(self.pairs), one, self.capsules[i].radius
        a, b = (a, a) if end == 1 else (b, b) if end == 2 else (a, b)
        if self.is_hull(j):
            return to_polytope(a, b, radius, self._hulls[j], *two, feature=feature)
        if self._is_capsule(j):
            c, d = self._axis(j, poses) if two is None else two
            c, d = (c, c) if end == 3 else (d, d) if end == 4 else (c, d)
            other = self.capsules[j].radius if j < self.links else self.world[j - self.links].size[0]
            return distances.to_capsule(a, b, radius, c, d, other)
        shape, pose = self.world[j - self.links], poses[j - self.links][:4]
        if shape.kind == "half_space":
            return distances.to_half_space(a, b, radius, pose)
        if shape.is_mesh:
            return self._meshes.to_mesh(a, b, radius, self._meshes.read(shape), pose)
        return distances.to_box(a, b, radius, 0.5 * np.array(shape.size), pose)

    def at_least(self, pair: int, one: tuple[Mat, Mat], two: tuple[Mat, Mat]) -> Vec:
        """Lower bounds of the distance of a hull's pair, whose links are ``placed`` there, one a frame ``(n,)`` [m]."""
        i, j = self.pairs[pair]
        return at_least(*one, self.capsules[i].radius, self._hulls[j], *two)

    def _is_capsule(self, k: int) -> bool:
        return not self.is_hull(k) if k < self.links else self.world[k - self.links].kind in ("sphere", "capsule")

    def _axis(self, k: int, poses: Mat) -> tuple[Vec, Vec]:
        """Ends of a sphere or capsule of the world."""
        shape, pose = self.world[k - self.links], poses[k - self.links]
        half = (0.5 * shape.size[1] if shape.kind == "capsule" else 0.0) * pose[:3, 2]
        return pose[:3, 3] - half, pose[:3, 3] + half

    def _length(self, k: int) -> float:
        """Length of the axis of a capsule [m]."""
        if k < self.links:
            return math.dist(self.capsules[k].a, self.capsules[k].b)
        shape = self.world[k - self.links]
        return shape.size[1] if shape.kind == "capsule" else 0.0

    def _sided(self, i: int, j: int) -> bool:
        """Return true if a pair may lie side by side."""
        return self._is_capsule(j) and min(self._length(i), self._length(j)) > SHORT

    def nearest_end(self, pair: int, poses: Mat) -> tuple[int, float]:
        """The row of the end that is nearest to the nearest points of two capsules in the current state, and their way
        from there over the length of its axis."""
        i, j = self.pairs[pair]
        s, t = distances.nearest(*self.placed(i), *(self.placed(j) if j < self.links else self._axis(j, poses)))
        ways = (s, 1.0 - s, t, 1.0 - t)
        way = min(ways)
        return pair + (1 + ways.index(way)) * len(self.pairs), way

    def fade(self, pair: int, poses: Mat, one: Any, two: Any) -> float:
        """The share of the rows of a pair's ends: 1 where its axes are parallel, 0 for none."""
        i, j = self.pairs[pair]
        if not self._sided(i, j):
            return 0.0
        (a, b), (c, d) = one, self._axis(j, poses) if two is None else two
        return distances.aligned(b - a, d - c)

    def update(self, state: State, poses: Mat) -> list[Near | None]:
        """Measure pairs that may be near, assign slots, and return the content of each slot."""
        state.kinematics()
        motions = Motions(state, self, poses)
        near = self._near(self._robot.bodies, poses, motions)
        assign(self.slots, {row: self._left(n, motions) for row, n in near.items()})
        deepest = self._deepest(near.values())
        rows = [near[p] if p >= 0 else None for p in self.slots.tolist()]
        return [n and n._replace(deepest=min(deepest[self._owner(k)] for k in self.pair(n.pair))) for n in rows]

    def _near(self, bodies: Any, poses: Mat, motions: Motions | None) -> dict[int, Near]:
        """Rows within the influence or closing fast: pairs and ends of capsules side by side; motions: None at rest."""
        near: dict[int, Near] = {}
        ends = [self._ends(k, bodies) for k in range(self.links)]
        for pair in self._candidates_near(ends, poses, motions):
            i, j = self.pairs[pair]
            both = ends[i], None if j >= self.links else self.placed(j, bodies) if self.is_hull(j) else ends[j]
            clearance = float(self.clearance[pair])
            if self.is_hull(j):
                least = float(self.at_least(pair, ends[i], self.placed(j, bodies)))
                if least >= self._element.influence and self._slow((i, j), ends, least - clearance, motions):
                    continue
            found = self.measure(pair, poses, *both)
            if not self._counts(pair, found, clearance, motions):
                continue
            fade = self.fade(pair, poses, *both)
            near[pair] = Near(pair, found[0], clearance, *found[1:], beside=fade)
            for row in range(pair + len(self.pairs), 5 * len(self.pairs) if fade else 0, len(self.pairs)):
                found = self.measure(row, poses, *both)
                if self._counts(row, found, clearance, motions):
                    near[row] = Near(row, found[0], clearance, *found[1:], fade)
        return near

    def _slow(self, pair: tuple[int, int], ends: list[tuple[Vec, Vec]], h: float, motions: Motions | None) -> bool:
        """Return true if no point of two links moves so fast that a pair farther than this has a row."""
        if motions is None:
            return True
        most = sum(motions.fastest(k, 0.5 * (ends[k][0] + ends[k][1]), float(self._sizes[k])) for k in pair)
        return FORESIGHT * most <= self._element.closing(h)[0]

    def _counts(self, row: int, found: distances.Found, clearance: float, motions: Motions | None) -> bool:
        return self._element.counts(found[0], clearance, motions.speed(row, *found[1:]) if motions else 0.0)

    def _left(self, near: Near, motions: Motions) -> float:
        """Distance less clearance and braking distance [m]."""
        closing = max(-motions.speed(near.pair, near.normal, near.point), 0.0)
        return near.distance - near.clearance - 0.5 * closing * closing / self._element.braking

    def _owner(self, k: int) -> int:
        """Carrier of a shape: its body, itself in the world."""
        return self.body(k) or -1 - k

    def _deepest(self, near: Iterable[Near]) -> defaultdict[int, float]:
        """For each carrier, the least distance less clearance of its pairs, 0 where none is inside."""
        found: defaultdict[int, float] = defaultdict(float)
        for n in near:
            for k in self.pair(n.pair):
                found[self._owner(k)] = min(found[self._owner(k)], n.distance - n.clearance)
        return found

    def _candidates_near(self, ends: list[tuple[Vec, Vec]], poses: Mat, motions: Motions | None) -> list[int]:
        """Pairs whose bounding spheres are nearer than the influence or move fast; all those with the world."""
        centres = np.array([0.5 * (a + b) for a, b in ends]).reshape(-1, 3)
        links = np.flatnonzero(self._pairs[:, 1] < self.links)
        i, j = self._pairs[links].T
        near = (
            np.linalg.norm(centres[i] - centres[j], axis=1) - self._sizes[i] - self._sizes[j] < self._element.influence
        )
        if motions is not None:
            fastest = np.array([motions.fastest(k, *of) for k, of in enumerate(zip(centres, self._sizes, strict=True))])
            near |= FORESIGHT * (fastest[i] + fastest[j]) > self._element.closing(self._element.curve()[0])[0]
        world = np.flatnonzero(self._pairs[:, 1] >= self.links)
        return sorted([*links[near].tolist(), *world.tolist()])

    def tables(self) -> Tables:
        """Capsules, hulls, shapes of the world, pairs and clearances, as the native operation takes them."""
        links = tuple((c.body, (*c.a, *c.b), c.radius) for c in self.capsules)
        hulls = tuple(
            (k, h.rounding, tuple(h.corners.ravel().tolist()), tuple(h.triangles.ravel().tolist()))
            for k, h in self._hulls.items()
        )
        kinds = {"sphere": 0, "capsule": 0, "box": 1, "half_space": 2}
        world = tuple((kinds[s.kind], (*s.size, 0.0, 0.0, 0.0)[:3]) for s in self.world)
        columns = {b: tuple(np.flatnonzero(mask).tolist()) for b, mask in self._columns.items()}
        chains = tuple(columns.get(b, ()) for b in range(len(self._robot.bodies)))
        names = tuple(self.name(k) for k in range(self.links + len(self.world)))
        return links, hulls, world, names, chains, tuple(self.pairs), tuple(self.clearance.tolist())

    def _support(self, body: int) -> Vec:
        mask, bodies = np.zeros(self._robot.nv), self._robot.bodies
        while body > 0:
            parent, first, count = bodies[body][:3]
            mask[first : first + count] = 1.0
            body = parent
        return mask
