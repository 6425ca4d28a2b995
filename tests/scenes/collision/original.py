"""Distances of the file's own collision shapes by coal: a judge of the capsules."""

from __future__ import annotations

import math
from collections.abc import Iterable
from typing import Any

import numpy as np

from hqp.arrays import Mat
from hqp.collision_library import coal
from hqp.shapes import Shape
from hqp.tasks import CollisionAvoidance
from hqp.tasks.collision_rows import Near
from hqp.tasks.collision_scene import scene
from hqp.tasks.meshes import read


class Original:
    """Shapes of a robot's bodies and of an element's world in coal."""

    def __init__(self, avoid: CollisionAvoidance, robot: Any) -> None:
        self._scene, self._robot, self._avoid = scene(avoid, robot), robot, avoid
        self._items: dict[int, list[tuple[Any, Any]]] = {}
        for item in robot.geometry.geometryObjects:
            self._items.setdefault(int(item.parentJoint), []).append((item.geometry, item.placement))
        self._world = [_coal(shape) for shape in avoid.world]

    def margin(self, near: Iterable[Near | None]) -> float:
        """Least distance minus clearance of the near pairs at the robot's current state [m]."""
        least: dict[tuple[int, int, int], float] = {}
        for found in near:
            if found is None:
                continue
            one, two = self._scene.pair(found.pair)
            world = two - self._scene.links
            key = self._scene.body(one), self._scene.body(two), max(world, -1)
            least[key] = max(least.get(key, 0.0), found.clearance)
        return min((self._distance(*key) - clearance for key, clearance in least.items()), default=math.inf)

    def _distance(self, one: int, two: int, world: int) -> float:
        bodies = self._robot.bodies
        first = [(shape, _placed(bodies[one][5], local)) for shape, local in self._items[one]]
        if world >= 0:
            pose = self._avoid.poses()[world, :4]
            second = [(self._world[world], coal.Transform3s(pose[:3, :3], pose[:3, 3]))]
        else:
            second = [(shape, _placed(bodies[two][5], local)) for shape, local in self._items[two]]
        request, result, least = coal.DistanceRequest(), coal.DistanceResult(), math.inf
        for a, at in first:
            for b, there in second:
                result.clear()
                coal.distance(a, at, b, there, request, result)
                least = min(least, float(result.min_distance))
        return least


def _placed(body: tuple[Any, Mat], local: Any) -> Any:
    position, rotation = body
    return coal.Transform3s(rotation @ local.rotation, np.asarray(position + rotation @ local.translation))


def _coal(shape: Shape) -> Any:
    if shape.kind == "sphere":
        return coal.Sphere(*shape.size)
    if shape.kind == "capsule":
        return coal.Capsule(*shape.size)
    if shape.kind == "box":
        return coal.Box(*shape.size)
    if shape.kind == "half_space":
        return coal.Halfspace(np.array([0.0, 0.0, 1.0]), 0.0)
    return read(shape)
