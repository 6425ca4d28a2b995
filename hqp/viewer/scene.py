"""The scene: robot, contacts and their forces, centre of mass and support polygon, targets."""

from __future__ import annotations

import time
from collections.abc import Mapping, Sequence
from typing import Any

import numpy as np

from hqp.arrays import Mat, Vec

from .channel import Channel
from .description import RobotDescription, StackDescription
from .drawn_robot import DrawnRobot
from .meshes import footprint, hull, nearest, thinned
from .targets import SIZE, Handle

_GREEN, _RED, _BLUE, _ORANGE = (26, 143, 76), (207, 42, 42), (22, 104, 199), (217, 122, 0)
_NO_LINE = np.zeros((1, 2, 3))
_NEWTONS = 0.0012
"""Length of an arrow a newton [m/N]."""

HELD = 1.0
"""After its last motion a handle counts as held for so long [s]."""


class Scene:
    """Scene of viser; ``update`` moves it to a state."""

    def __init__(self, server: Any, about: RobotDescription, robot: Any, channel: Channel, drag: bool) -> None:
        self._server, self._robot, self._channel, self._drag = server, robot, channel, drag
        self._state = robot.state(about.home)
        self._state.kinematics()
        self._drawn = DrawnRobot(server.scene, about, robot)
        self.handles: list[Handle] = []
        self._contacts: list[tuple[str, str]] = []
        self._soles: dict[str, Mat] = {}
        self._arrows: Any = None
        self._polygon: Any = None
        self._rods: Any = None
        self._com: tuple[Any, Any, Any] | None = None

    def show_stack(self, stack: StackDescription, frames: Mapping[str, str]) -> None:
        """Targets and contacts of a stack; frames: frames of its contacts, by name."""
        for handle in self.handles:
            handle.remove()
        self.handles = [
            Handle(self._server, self._channel, i, target, self._robot, self._drag)
            for i, target in enumerate(stack.targets)
        ]
        self._contacts = list(frames.items())
        self._soles = {name: self._sole(frame) for name, frame in self._contacts}
        if self._contacts and self._robot.floating and self._com is None:
            scene = self._server.scene
            self._com = (
                scene.add_icosphere("/com/centre", radius=0.03, color=_BLUE),
                scene.add_cylinder("/com/ground", radius=0.028, height=0.004, color=_BLUE),
                scene.add_line_segments("/com/line", _NO_LINE, _BLUE, thickness=2.5, thickness_units="screen"),
            )

    def _sole(self, frame: str) -> Mat:
        """Corners of the ground contact area, in the frame's axes ``(k, 3)``."""
        robot = self._robot
        index = robot.frame(frame)
        body = robot.body(index)
        p, R = robot.placement(index)
        _, _, _, _, _, (origin, turn) = robot.bodies[body]
        clouds = [v @ turn.T + origin for v in self._drawn.vertices.get(body, ())]
        if not clouds:
            return np.array([[0.1, 0.05, 0.0], [0.1, -0.05, 0.0], [-0.08, -0.05, 0.0], [-0.08, 0.05, 0.0]])
        cloud = np.vstack(clouds)
        corners = footprint(cloud)
        world = np.column_stack((corners, np.full(len(corners), cloud[:, 2].min())))
        return np.asarray((world - p) @ R)

    def update(self, q: Vec, v: Vec, forces: Mapping[str, Vec]) -> dict[str, tuple[float, str]]:
        """Move everything to a state; the distance of each target, in numbers and words."""
        robot = self._robot
        self._state = state = robot.state(q, v)
        state.kinematics()
        self._drawn.update()
        found = {handle.target.name: handle.update(state) for handle in self.handles}
        errors = {name: error for name, error in found.items() if error is not None}
        if self._com is not None:
            self._update_balance(state)
        self._update_forces(state, forces)
        return errors

    def _update_balance(self, state: Any) -> None:
        corners = []
        for name, frame in self._contacts:
            p, R = state.position(frame), state.rotation(frame)
            corners.append(self._soles[name] @ R.T + p)
        points = np.vstack(corners)
        outline = hull(points[:, :2])
        height = float(points[:, 2].min()) + 0.004
        com = state.com()
        assert self._com is not None
        ball, disc, line = self._com
        ground = np.array([com[0], com[1], height + 0.002])
        ball.position, disc.position = com, ground
        line.points = np.array([[com, ground]])
        ring = np.column_stack((outline, np.full(len(outline), height)))
        inside = _inside(com[:2], outline)
        edges = np.stack((ring, np.roll(ring, -1, axis=0)), axis=1)
        self._polygon = self._server.scene.add_line_segments(
            "/com/support", edges, _GREEN if inside else _RED, thickness=6.0, thickness_units="screen"
        )

    def _update_forces(self, state: Any, forces: Mapping[str, Vec]) -> None:
        """Arrows of the forces that the ground puts on the robot."""
        arrows = []
        for name, frame in self._contacts:
            if name in forces and forces[name].size >= 3:
                p = state.position(frame)
                arrows.append([p, p + _NEWTONS * forces[name][:3]])
        if arrows:
            self._arrows = self._server.scene.add_arrows(
                "/forces", np.array(arrows), _RED, shaft_radius=0.012, head_radius=0.03, head_length=0.06
            )

    def show_apart(self, pairs: Sequence[str]) -> None:
        """A rod between the nearest drawn points of two links that are kept apart, ``"torso - left_elbow"``."""
        rods = [rod for pair in pairs if (rod := self._between(*pair.split(" - "))) is not None]
        if self._rods is not None:
            self._rods.remove()
            self._rods = None
        if rods:
            self._rods = self._server.scene.add_line_segments(
                "/apart", np.array(rods), _ORANGE, thickness=7.0, thickness_units="screen"
            )

    def _between(self, *links: str) -> Mat | None:
        """Nearest points of two links ``(2, 3)``, or None if one of them is no link of the robot with a shape."""
        clouds = []
        for link in links:
            name = link.partition("/")[0]  # of several capsules
            if name not in self._robot.frame_names:
                return None
            body = self._robot.body(self._robot.frame(name))
            if body not in self._drawn.vertices:
                return None
            _, _, _, _, _, (origin, turn) = self._robot.bodies[body]
            clouds.append(thinned(np.vstack(self._drawn.vertices[body])) @ turn.T + origin)
        return nearest(*clouds)

    def targets(self) -> Mat:
        """Places of targets, and the tips of their handles ``(k, 3)`` [m]."""
        places = np.array([h.there for h in self.handles if h.there is not None]).reshape(-1, 3)
        return np.vstack((places, places + [0.0, 0.0, SIZE]))

    @property
    def in_hand(self) -> bool:
        """True while a target is being dragged."""
        return any(time.monotonic() - handle.touched < HELD for handle in self.handles)

    def outline(self) -> Mat:
        """Points around the robot ``(k, 3)`` [m]."""
        return self._drawn.outline()


def _inside(point: Vec, outline: Mat) -> bool:
    """Return true if a point is inside a convex outline, counter-clockwise."""
    edge = np.roll(outline, -1, axis=0) - outline
    way = point - outline
    return bool(np.all(edge[:, 0] * way[:, 1] - edge[:, 1] * way[:, 0] >= 0.0))
