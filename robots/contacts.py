"""Contact of the collision shapes of two bodies of a robot, by coal."""

from __future__ import annotations

from typing import Any

from hqp.arrays import Mat, Vec
from hqp.collision_library import Placement, coal

Pose = tuple[Vec, Mat]
"""Position ``(3,)`` [m] and rotation ``(3, 3)`` in the world."""

_REQUEST = coal.CollisionRequest()


class Contacts:
    """The shapes of a pinocchio.GeometryModel by the body that carries them, without those without an end."""

    def __init__(self, shapes: Any) -> None:
        self._of: dict[int, list[tuple[Any, Any]]] = {}
        for item in shapes.geometryObjects:
            if type(item.geometry).__name__ not in ("Halfspace", "Plane"):
                place = Placement(item.placement.rotation, item.placement.translation)
                self._of.setdefault(int(item.parentJoint), []).append((item.geometry, place))

    def touch(self, one: int, two: int, first: Pose, second: Pose) -> bool:
        """Return true if shapes of two bodies overlap at these poses."""
        here, there = (Placement(rotation, position) for position, rotation in (first, second))
        result = coal.CollisionResult()
        for a, at in self._of.get(one, ()):
            for b, to in self._of.get(two, ()):
                result.clear()
                if coal.collide(a, here * at, b, there * to, _REQUEST, result):
                    return True
        return False
