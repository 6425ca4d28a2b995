"""A robot on a page: its shapes on a grid, moved from state to state, and the points that a camera is to show."""

from __future__ import annotations

from typing import Any

import numpy as np

from hqp.arrays import Mat

from .description import RobotDescription
from .meshes import color_of, links, load, quaternion


class DrawnRobot:
    """The shapes of a robot, or rods between its joints where it has none; ``update`` moves them to where it is.

    vertices: vertices of a body's shapes, in its axes.
    """

    def __init__(self, scene: Any, about: RobotDescription, robot: Any) -> None:
        self._scene, self._robot = scene, robot
        self._frames: dict[int, Any] = {}
        self.vertices: dict[int, list[Mat]] = {}
        scene.set_up_direction("+z")
        scene.add_grid("/ground", width=20.0, height=20.0, cell_size=0.25, section_size=1.0, cell_color=(225, 229, 234),
                       section_color=(196, 203, 212), shadow_opacity=0.25)  # fmt: skip
        drawn = False
        for i, shape in enumerate(about.shapes):
            mesh = load(shape)
            if mesh is None:
                continue
            drawn = True
            self.vertices.setdefault(shape.body, []).append(np.asarray(mesh.vertices))
            self._add(f"{i}", shape.body, mesh, color_of(shape, mesh))
        if not drawn:
            for i, (body, mesh) in enumerate(links(robot)):
                self._add(f"link{i}", body, mesh, (120, 132, 150))
        self._boxes = {body: _corners(np.vstack(clouds)) for body, clouds in self.vertices.items()}

    def _add(self, name: str, body: int, mesh: Any, color: tuple[int, int, int] | None) -> None:
        if body not in self._frames:
            self._frames[body] = self._scene.add_frame(f"/robot/{body}", show_axes=False)
        path = f"/robot/{body}/{name}"
        if color is None:
            self._scene.add_mesh_trimesh(path, mesh)
        else:
            vertices, faces = np.asarray(mesh.vertices), np.asarray(mesh.faces)
            self._scene.add_mesh_simple(path, vertices, faces, color=color, side="double")

    def update(self) -> None:
        """Move all shapes to where the robot's bodies are."""
        for body, frame in self._frames.items():
            *_, (p, R) = self._robot.bodies[body]
            frame.position, frame.wxyz = np.array(p), quaternion(R)

    def outline(self) -> Mat:
        """Points around the robot ``(k, 3)`` [m]: corners of boxes around its bodies, origins without shapes."""
        placed = [(body, p, R) for body, (*_, (p, R)) in enumerate(self._robot.bodies)]
        boxes = [self._boxes[body] @ R.T + p for body, p, R in placed if body in self._boxes]
        return np.vstack(boxes or [np.array([p for _, p, _ in placed[1:]])])


def _corners(points: Mat) -> Mat:
    """Corners of the box around points ``(8, 3)``."""
    ends = np.array([points.min(axis=0), points.max(axis=0)])
    return np.array([[ends[i, 0], ends[j, 1], ends[k, 2]] for i in (0, 1) for j in (0, 1) for k in (0, 1)])
