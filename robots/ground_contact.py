"""Ground forces on feet and wheels, read from MuJoCo's contacts."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np

from hqp.arrays import Index, Mat, Vec


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


class ContactReader:
    """Sums the contacts of each watched body and of all that hangs on it.

    bodies: one per row; of two that hang on each other the lower one has its own contacts.
    """

    def __init__(self, model: Any, bodies: Sequence[int]) -> None:
        row_of_body = np.full(model.nbody, -1, dtype=np.intp)
        for body in range(1, model.nbody):  # parents come before children
            row_of_body[body] = row_of_body[model.body_parentid[body]]
            if body in bodies:
                row_of_body[body] = bodies.index(body)
        self._row: Index = row_of_body[model.geom_bodyid]
        self._count = len(bodies)
        self._raw: tuple[Any, ...] | None = None

    def keep(self, data: Any) -> None:
        """Keep the contacts of a step; to be called while the constraint forces are those of data.contact."""
        if self._count:
            c = data.contact
            kept = (c.geom, c.efc_address, c.dim, c.frame, c.pos, data.efc_force)
            self._raw = tuple(np.array(array) for array in kept)

    def contacts(self, disturb: Callable[[Vec], Vec] | None = None) -> Contacts:
        """Sums over each watched body; ``disturb`` adds noise to the forces of its contacts, ``(k, 3)`` [N]."""
        n = self._count
        if self._raw is None:
            return Contacts(np.zeros((n, 3)), np.zeros(n), np.zeros((n, 3)), np.zeros((n, 3)))
        row, force, normals, points = self._forces(*self._raw)
        if disturb is not None:
            force = disturb(force)
        load = np.maximum((force * normals).sum(axis=1, keepdims=True), 0.0)
        member = (row == np.arange(n)[:, None]).astype(np.float64)
        sums = member @ np.hstack((force, load, load * normals, load * points))
        total, loads, normal, point = sums[:, :3], sums[:, 3], sums[:, 4:7], sums[:, 7:]
        loaded = loads > 1e-9
        length = np.sqrt((normal * normal).sum(axis=1))
        normal = np.divide(normal, length[:, None], where=loaded[:, None], out=np.zeros((n, 3)))
        point = np.divide(point, loads[:, None], where=loaded[:, None], out=np.zeros((n, 3)))
        return Contacts(total, loads, normal, point)

    def _forces(
        self, geom: Index, address: Index, dim: Index, frame: Mat, place: Mat, efc: Vec
    ) -> tuple[Index, Mat, Mat, Mat]:
        """Row, force, normal and point of every contact of a watched body, world axes."""
        rows = self._row[geom].reshape(-1, 2)
        # exactly one side watched: neither the robot's contacts with itself nor those of other parts
        found = np.flatnonzero(((rows >= 0).sum(axis=1) == 1) & (address >= 0) & (dim >= 3))
        second = rows[found, 1] >= 0
        # a contact's axes are the rows of its frame, the first one from its first body to its second
        axes = frame[found].reshape(-1, 3, 3)
        local = efc[address[found, None] + np.arange(3)]  # elliptic cones: normal and tangents
        sign = np.where(second, 1.0, -1.0)[:, None]
        row = np.where(second, rows[found, 1], rows[found, 0])
        return row, sign * (local[:, None] @ axes)[:, 0], sign * axes[:, 0], place[found]
