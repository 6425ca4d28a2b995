"""Objects of a file's scene as shapes for collision avoidance."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, field
from typing import Any

import numpy as np

from hqp.arrays import Mat
from hqp.errors import DeclarationError, closest
from hqp.shapes import Shape


@dataclass(frozen=True)
class Obstacles:
    """Bodies of an MJCF that move and are not the robot, as shapes of the world.

    shapes: for ``CollisionAvoidance(world=...)``, where the file has them.  bodies: pose ``(4, 4)`` of each body there.
    Balls, capsules and boxes are exact; a cylinder is the smaller of a capsule and a box around it, other shapes are
    boxes around them (``approximated``).
    """

    shapes: tuple[Shape, ...] = ()
    bodies: Mapping[str, Mat] = field(default_factory=dict)
    approximated: tuple[str, ...] = ()
    places: Mapping[str, tuple[str, Mat]] = field(default_factory=dict)

    def at(self, poses: Mapping[str, Any]) -> dict[str, Mat]:
        """Poses ``(4, 4)`` of the shapes of bodies at these poses ``(4, 4)`` or positions ``(3,)``, for ``avoid.at``.

        Raises DeclarationError for an unknown body or an invalid pose.
        """
        found: dict[str, Mat] = {}
        for body, pose in poses.items():
            if body not in self.bodies:
                near = (
                    ", ".join(closest(body, self.bodies)) or ", ".join(self.bodies) or "none, the file has no objects"
                )
                raise DeclarationError("obstacles", "unknown body", value=body, allowed=near)
            given = np.asarray(pose, dtype=np.float64)
            if given.shape == (3,):
                given = np.vstack((np.column_stack((self.bodies[body][:3, :3], given)), (0.0, 0.0, 0.0, 1.0)))
            if given.shape != (4, 4):
                allowed = "a matrix (4, 4) or a position (3,) [m]"
                raise DeclarationError("obstacles", f"pose of {body} has shape {given.shape}", allowed=allowed)
            found |= {name: given @ place for name, (carrier, place) in self.places.items() if carrier == body}
        return found
