"""Ground forces on feet and wheels, read from MuJoCo's contacts."""

from __future__ import annotations

import math
from collections.abc import Callable, Iterator, Sequence
from dataclasses import dataclass
from operator import add
from typing import Any

import numpy as np

from hqp.arrays import Mat, Vec
from hqp.errors import DeclarationError

from .frames import Frames
from .mujoco_extra import mujoco
from .touching import touching

Triple = tuple[float, float, float]
_NOWHERE = (0.0,) * 6  # normal and point without a contact
OWN = -2
"""Row of bodies of a watched robot that are not watched themselves."""

BURIED = 5e-3
"""Deeper points in the ground are lifted [m]."""


@dataclass(frozen=True)
class Contacts:
    """Ground contact of the watched feet or wheels, a row each, in the order of ``Plant.watched``.

    force: from the ground on the robot, ``(n, 3)``, world axes [N].  load: sum of the normal forces ``(n,)`` [N].
    normal: mean of the contact normals, weighted by normal force, unit vectors ``(n, 3)``, zero where unloaded.
    point: centre of pressure, the mean weighted alike ``(n, 3)`` [m], zero where unloaded.
    """

    force: Mat
    load: Vec
    normal: Mat
    point: Mat


def watch(
    model: Any, frames: Frames, frames_given: Sequence[str] | None, default: Sequence[str]
) -> tuple[ContactReader, tuple[str, ...]]:
    """A reader of the contacts of frames, and their names.

    A frame stands for all links that are fixed to each other and to it, and for all that hangs on them.  default:
    frames for None, those that touch nothing left out.
    Raises FrameNotFound, DeclarationError for a frame that can touch nothing, or two that would share their contacts.
    """
    shaped = np.zeros(model.nbody, dtype=bool)
    shaped[model.geom_bodyid[touching(model)]] = True
    for body in range(model.nbody - 1, 0, -1):  # children come after parents
        shaped[model.body_parentid[body]] |= shaped[body]
    bodies: dict[int, str] = {}
    for name in default if frames_given is None else frames_given:
        body = frames.body(name)
        body = int(model.body_weldid[body]) or body
        if not shaped[body] or not body:
            if frames_given is None:
                continue
            allowed = "a frame of a body with shapes that touch"
            raise DeclarationError("plant", "a watched frame has no shape that can touch", value=name, allowed=allowed)
        if body in bodies:
            both = (bodies[body], name)
            raise DeclarationError("plant", "watched frames on one body", value=both, allowed="one frame per body")
        bodies[body] = name
    return ContactReader(model, list(bodies)), tuple(bodies.values())


class ContactReader:
    """Sums the contacts of each watched body and of all that hangs on it.

    bodies: one per row; if one hangs on the other, the lower one has its own contacts.
    """

    def __init__(self, model: Any, bodies: Sequence[int]) -> None:
        row_of_body = np.full(model.nbody, -1, dtype=np.intp)
        for body in range(1, model.nbody):  # parents come before children
            row_of_body[body] = row_of_body[model.body_parentid[body]]
            if body in bodies:
                row_of_body[body] = bodies.index(body)
        roots = {int(model.body_rootid[body]) for body in bodies}
        row_of_body[(row_of_body < 0) & np.isin(model.body_rootid, list(roots))] = OWN
        self._row: list[int] = row_of_body[model.geom_bodyid].tolist()
        self._count = len(bodies)
        self._kept: tuple[list[Any], ...] = ([], [], [], [], [])
        self._efc: list[float] = []

    def keep(self, data: Any) -> None:
        """Keep the contacts of a step; to be called while the constraint forces are those of data.contact."""
        if self._count:
            # lists: contacts are few, and their numbers are added one by one in less time than arrays take
            c = data.contact
            self._kept = tuple(a.tolist() for a in (c.geom, c.efc_address, c.dim, c.frame, c.pos))
            self._efc = data.efc_force.tolist()

    def contacts(self, disturb: Callable[[Vec], Vec] | None = None) -> Contacts:
        """Sums over each watched body; ``disturb`` adds noise to the forces of their contacts ``(k, 3)`` [N]."""
        sums = [[0.0] * 10 for _ in range(self._count)]  # force, load, load * normal, load * point
        found = list(self._touching())
        if disturb is not None and found:
            noisy = disturb(np.array([force for _, force, *_ in found])).tolist()
            found = [(row, force, *rest) for (row, _, *rest), force in zip(found, noisy, strict=True)]
        for row, (fx, fy, fz), (nx, ny, nz), (x, y, z) in found:
            load = max(fx * nx + fy * ny + fz * nz, 0.0)
            terms = fx, fy, fz, load, load * nx, load * ny, load * nz, load * x, load * y, load * z
            sums[row] = list(map(add, sums[row], terms))
        for total in sums:
            load, nx, ny, nz, x, y, z = total[3:]
            length = math.hypot(nx, ny, nz) or 1.0
            loaded = load > 1e-9
            total[4:] = (nx / length, ny / length, nz / length, x / load, y / load, z / load) if loaded else _NOWHERE
        table = np.array(sums).reshape(-1, 10)
        return Contacts(table[:, :3], table[:, 3], table[:, 4:7], table[:, 7:])

    def _touching(self) -> Iterator[tuple[int, Triple, Triple, Triple]]:
        """Row, force, normal and point of every contact of a watched body, world axes."""
        for (one, other), address, dim, axes, point in zip(*self._kept, strict=True):
            first, second = self._row[one], self._row[other]
            # exactly one side watched: neither the robot's contacts with itself nor those of other parts
            if (first >= 0) == (second >= 0) or OWN in (first, second) or address < 0 or dim < 3:
                continue
            # the rows of a contact's frame: a normal, from its first body to its second, and two tangents
            nx, ny, nz, sx, sy, sz, tx, ty, tz = axes if second >= 0 else [-x for x in axes]
            n, s, t = self._efc[address : address + 3]  # elliptic cones: forces along the three
            force = (n * nx + s * sx + t * tx, n * ny + s * sy + t * ty, n * nz + s * sz + t * tz)
            yield max(first, second), force, (nx, ny, nz), point


def out_of_ground(model: Any, states: Any, q: Vec) -> Vec:
    """A configuration ``(nq,)`` in the robot's order, its free base lifted until nothing is buried in the ground."""
    free, data = model.jnt_qposadr[model.jnt_type == mujoco.mjtJoint.mjJNT_FREE], mujoco.MjData(model)
    for _ in range(3 if free.size else 0):
        data.qpos[:], data.qvel[:] = states.to_mujoco(q, np.zeros(states.nv))
        mujoco.mj_forward(model, data)
        ground = (model.geom_bodyid[data.contact.geom] == 0).any(axis=1)
        depth = -float(np.min(data.contact.dist[ground], initial=0.0))
        if depth < BURIED:
            break
        data.qpos[free[0] + 2] += depth
        q = states.to_pinocchio(data.qpos, data.qvel)[0]
    return q
