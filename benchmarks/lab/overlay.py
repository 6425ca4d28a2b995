"""Drawings in the scene: force arrow, human hand, plumb line of the CoM, trace of a hand, support polygon."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any

import mujoco
import numpy as np

from hqp.arrays import Mat, Vec

RED, GREEN, BLUE, YELLOW = (0.85, 0.1, 0.1, 1.0), (0.1, 0.6, 0.2, 1.0), (0.1, 0.3, 0.8, 1.0), (0.95, 0.7, 0.1, 1.0)

ORANGE, GLASS = (0.9, 0.45, 0.1, 1.0), (0.75, 0.77, 0.8, 0.35)

PER_NEWTON = 1.0 / 40.0
"""Length of a force arrow [m/N]."""


@dataclass(frozen=True)
class Support:
    """Seen from above, x ahead: polygons that bear load ``(n, 2)``, CoM and its goal ``(2,)`` [m]."""

    polygons: tuple[Mat, ...]
    com: Vec
    goal: Vec


def _connect(scene: Any, kind: Any, width: float, start: Vec, end: Vec, colour: tuple[float, ...]) -> None:
    if scene.ngeom >= scene.maxgeom:
        return
    geom = scene.geoms[scene.ngeom]
    zero = np.zeros(3)
    mujoco.mjv_initGeom(geom, kind, zero, zero, np.eye(3).ravel(), np.array(colour, dtype=np.float32))
    mujoco.mjv_connector(geom, kind, width, np.asarray(start), np.asarray(end))
    scene.ngeom += 1


def line(scene: Any, start: Vec, end: Vec, colour: tuple[float, ...], width: float = 0.006) -> None:
    """A thin rod."""
    _connect(scene, mujoco.mjtGeom.mjGEOM_CAPSULE, width, start, end, colour)


def arrow(scene: Any, start: Vec, vector: Vec, colour: tuple[float, ...], width: float = 0.018) -> None:
    """An arrow [m]."""
    _connect(scene, mujoco.mjtGeom.mjGEOM_ARROW, width, start, np.asarray(start) + vector, colour)


def ball(scene: Any, centre: Vec, radius: float, colour: tuple[float, ...]) -> None:
    """A sphere."""
    if scene.ngeom >= scene.maxgeom:
        return
    geom = scene.geoms[scene.ngeom]
    kind = mujoco.mjtGeom.mjGEOM_SPHERE
    mujoco.mjv_initGeom(geom, kind, np.full(3, radius), np.asarray(centre), np.eye(3).ravel(), np.array(colour, "f4"))
    scene.ngeom += 1


def recolour(scene: Any, run: Any, body: str, colour: tuple[float, ...]) -> None:
    """Draw a body in one colour without a change of the model."""
    model = run.plant.model
    number, kind = model.body(body).id, int(mujoco.mjtObj.mjOBJ_GEOM)
    for geom in scene.geoms[: scene.ngeom]:
        if geom.objtype == kind and model.geom_bodyid[geom.objid] == number:
            geom.rgba[:] = colour
            geom.transparent = int(colour[3] < 1.0)


def ground_height(run: Any, x: float) -> float:
    """Height of the terrain at x [m]."""
    terrain = run.plant.terrain
    return 0.0 if terrain is None else float(terrain.height(x))


def plumb_line(scene: Any, run: Any) -> None:
    """The whole robot's CoM, a line down from it in front of the robot, and the soles' outline."""
    com = run.plant.com()
    foot = np.array([com[0], com[1], ground_height(run, com[0]) + 0.004])
    line(scene, com, foot, YELLOW)
    ball(scene, com, 0.03, YELLOW)
    ball(scene, foot, 0.014, RED)
    for points in _soles(run):
        for a, b in zip(points, [*points[1:], points[0]], strict=True):
            line(scene, a, b, GREEN, 0.004)


def _soles(run: Any) -> list[list[Vec]]:
    """Corners of both soles in the world, left first."""
    soles = []
    for name, (inner, outer) in (("l_sole", (-0.04, 0.06)), ("r_sole", (-0.06, 0.04))):
        place, rotation = run.plant.place(name)
        corners = [(-0.065, outer), (-0.065, inner), (0.18, inner), (0.18, outer)]
        soles.append([place + rotation @ np.array([x, y, 0.005]) for x, y in corners])
    return soles


def human_and_plumb_line(scene: Any, run: Any) -> None:
    """The pull as an arrow at the hand, the upper body's CoM over the triangle of the wheels, seen through the base."""
    plant = run.plant
    recolour(scene, run, "hand", ORANGE)
    recolour(scene, run, "base", GLASS)
    hand = plant.place("hand_point")[0]
    if np.linalg.norm(run.pull) > 5.0:  # a shorter arrow is all head
        arrow(scene, hand + [0.0, 0.0, 0.08], PER_NEWTON * run.pull, RED, 0.026)
    com = upper_com(run)
    base, rotation = plant.place("base")
    normal = rotation[:, 2]
    below = com - [0.0, 0.0, float(normal @ (com - base) / normal[2])]
    line(scene, com, below, YELLOW)
    ball(scene, com, 0.03, YELLOW)
    ball(scene, below, 0.016, RED)
    points = [plant.place(f"wheel_contact_{k}")[0] + 0.004 * normal for k in range(3)]
    for a, b in zip(points, [*points[1:], points[0]], strict=True):
        line(scene, a, b, GREEN, 0.005)


def upper_com(run: Any) -> Vec:
    """Centre of mass of Dreamer's upper body in the world ``(3,)``."""
    plant = run.plant
    return np.array(plant.data.subtree_com[int(plant.model.joint("torso_yaw").bodyid[0])])


def place_hand(run: Any) -> None:
    """Draw the human hand with its fingers at the robot's hand, while it holds it."""
    held = run.t >= run.scene.walk.start
    fingers = run.plant.place("hand_point")[0] + [0.05, 0.0, 0.0]
    run.plant.move_hand(fingers if held else np.array([0.0, 0.0, -10.0]))
    mujoco.mj_kinematics(run.plant.model, run.plant.data)


def wheels(run: Any) -> Support:
    """Dreamer: wheel triangle, the upper body's CoM and its goal in the heading of the base."""
    plant = run.plant
    base, rotation = plant.place("base")
    x = rotation[:2, 0] / np.linalg.norm(rotation[:2, 0])
    heading = np.array([x, [-x[1], x[0]]])
    points = [heading @ (plant.place(f"wheel_contact_{k}")[0] - base)[:2] for k in range(3)]
    return Support((np.array(points),), heading @ (upper_com(run) - base)[:2], np.array(run.choice.com_goal))


def feet(run: Any) -> Support:
    """CBi: the soles that bear load, the CoM and its goal."""
    loaded = run.plant.contacts().load > 1.0
    soles = [np.array(points)[:, :2] for points, on in zip(_soles(run), loaded, strict=True) if on]
    goal = run.log["com_goal"][-1] if "com_goal" in run.log else run.goal
    return Support(tuple(soles), run.plant.com()[:2], goal)


class Trace:
    """The way of the right hand, drawn as it grows, and the plumb line."""

    def __init__(self) -> None:
        self._points: list[Vec] = []
        self._run: Any = None

    def follow(self, run: Any) -> None:
        """Store the place of the hand every 40 ms."""
        if run is not self._run:
            self._run, self._points = run, []
        if not self._points or len(self._points) * 0.04 <= run.t:
            self._points.append(run.plant.place("r_palm")[0])

    def __call__(self, scene: Any, run: Any) -> None:
        """Draw it."""
        for a, b in zip(self._points, self._points[1:], strict=False):
            line(scene, a, b, RED, 0.005)
        plumb_line(scene, run)
