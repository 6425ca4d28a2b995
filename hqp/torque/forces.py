"""Rows on torques and on contact forces, the two quantities beside motion that a torque hierarchy binds."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from typing import Any

import numpy as np

from hqp.arrays import Mat, Vec
from hqp.assembly import Assembly
from hqp.element import Block, Element, Writer
from hqp.errors import DeclarationError
from hqp.problem import Rows, Selection
from hqp.reference import Reference
from hqp.robot import Robot, State
from hqp.torque.dynamics import ConstrainedDynamics


class Efforts:
    """Elements on tau itself: their own rows J ``(k, n_actuated)``, bounds refilled each tick."""

    def __init__(self, elements: Sequence[Element], robot: Robot, dt: float) -> None:
        self._blocks: dict[str, Block] = {}
        self._elements = {e.name: e for e in elements}
        self._plan: list[tuple[Writer, str, Block, Vec, Vec, float]] = []
        self._robot = robot
        n = robot.actuated.size
        for element in elements:
            k = element.rows(robot)
            J, error, rate, feedforward, drift = np.zeros((k, n)), *(np.zeros(k) for _ in range(4))
            self._blocks[element.name] = Block(
                J, error, rate, feedforward, drift, np.full(k, -np.inf), np.full(k, np.inf), order=2, dt=dt
            )
        self._writers = {e.name: e.bind(robot, self._blocks[e.name]) for e in elements}

    def __bool__(self) -> bool:
        return bool(self._elements)

    def rows(self, name: str) -> int:
        """Number of rows of an element."""
        return int(self._blocks[name].lower.size)

    def place(self, name: str, here: slice, A: Mat, lower: Vec, upper: Vec) -> None:
        """Write an element's rows at ``here`` of a block, its bounds there each tick."""
        element, block = self._elements[name], self._blocks[name]
        np.multiply(block.J, element.weight, out=A[here])
        self._add(element, block, lower[here], upper[here])

    def bounds(self, names: Sequence[str]) -> Rows:
        """Elements that each pick torques, as one level of simple bounds."""
        picks = [self._elements[name].selection(self._robot) for name in names]
        scale = np.concatenate([np.full(self.rows(name), self._elements[name].weight) for name in names])
        lower, upper = np.full(scale.size, -np.inf), np.full(scale.size, np.inf)
        at = 0
        for name in names:
            here = slice(at, at + self.rows(name))
            self._add(self._elements[name], self._blocks[name], lower[here], upper[here])
            at = here.stop
        index = np.concatenate([p for p in picks if p is not None])
        return Rows(Selection(index, scale), lower, upper)

    def _add(self, element: Element, block: Block, lower: Vec, upper: Vec) -> None:
        writer = self._writers[element.name]
        self._plan.append((writer, element.name, block, lower, upper, element.weight))

    def fill(self, state: State, references: Mapping[str, Reference]) -> None:
        """Refill the bounds; a writer writes lower and upper, equal ones for a target."""
        for write, name, block, lower, upper, weight in self._plan:
            write(state, references[name])
            np.multiply(block.lower, weight, out=lower)
            np.multiply(block.upper, weight, out=upper)


class Forces:
    """Elements on the force of a reaction constraint: lower <= C f <= upper, f in contact axes, -lambda seen in them.

    Rows of a contact that are in world axes are turned into its frame; a contact whose rows are not simply a force
    ``(3,)`` or a wrench ``(6,)`` tells by ``force_basis()`` ``(3 or 6, m)`` what they are.  An equality is a target
    for C f, zero or the reference's value.
    """

    def __init__(self, elements: Sequence[Element], held: Sequence[Element], rows: Assembly, robot: Robot) -> None:
        self._elements = {e.name: e for e in elements}
        self._places: dict[str, slice] = {}
        m = sum(rows.members[e.name].part.stop - rows.members[e.name].part.start for e in held)
        by_name = {e.name: e for e in held}
        parts, turned = [np.zeros((0, m))], []
        lower: list[Vec] = [np.zeros(0)]
        upper: list[Vec] = [np.zeros(0)]
        at = 0
        for element in elements:
            contact = by_name.get(getattr(element, "contact", ""))
            if contact is None:
                known = ", ".join(by_name) or "there is none"
                raise element.bad("contact", getattr(element, "contact", None), f"a contact in subject_to: {known}")
            part = rows.members[contact.name].part
            C, low, high = _force_rows(element, contact, part.stop - part.start)
            whole = np.zeros((C.shape[0], m))
            whole[:, part] = C * (-contact.weight * element.weight)
            parts.append(whole)
            lower.append(low * element.weight)
            upper.append(high * element.weight)
            turned.append(contact)
            self._places[element.name] = slice(at, at + C.shape[0])
            at += C.shape[0]
        self._C, self._lower, self._upper = np.vstack(parts), np.concatenate(lower), np.concatenate(upper)
        self._turn: Mat = np.eye(m)  # from the rows' axes to the contacts'
        self._frames: list[tuple[Mat, Mat]] = []
        for contact in dict.fromkeys(turned):
            part = rows.members[contact.name].part
            rotation, blocks = _axes(contact, part.stop - part.start, robot)
            for block in blocks:
                here = slice(part.start + block.start, part.start + block.stop)
                self._frames.append((self._turn[here, here], rotation.T))
        self._targets = [(e.name, self._places[e.name], e.weight) for e in elements if e.equality]
        self._plan: list[list[Any]] = []

    def __bool__(self) -> bool:
        return bool(self._elements)

    def rows(self, name: str) -> int:
        """Number of rows of an element."""
        place: slice = self._places[name]
        return int(place.stop - place.start)

    def place(self, name: str, here: slice, A: Mat, lower: Vec, upper: Vec) -> None:
        """Write an element's rows and bounds at ``here`` of a block each tick, with those before it if they touch."""
        own, last = self._places[name], self._plan[-1] if self._plan else None
        if last and last[0].stop == own.start and last[1].stop == here.start:
            own, here = slice(last[0].start, own.stop), slice(last[1].start, here.stop)
            self._plan.pop()
        self._plan.append([own, here, A[here], lower[here], upper[here]])

    def fill(
        self, references: Mapping[str, Reference], dynamics: ConstrainedDynamics, shift: Vec | None = None
    ) -> None:
        """Refill rows C f with f = -(F tau + f_0) turned into contact axes, lambda = F tau + f_0 (eq. 3).

        shift: part of tau that the model of the forces does not know, ``(n,)``.
        """
        for name, place, weight in self._targets:
            value = references[name].value
            self._lower[place] = 0.0 if value is None else weight * value
            self._upper[place] = self._lower[place]
        for block, rotation in self._frames:
            block[:] = rotation
        C = self._C @ self._turn
        F, f = dynamics.force_map()
        offset = C @ (f if shift is None else f - F @ shift)
        for own, _, A, lower, upper in self._plan:
            np.matmul(C[own], F, out=A)
            np.subtract(self._lower[own], offset[own], out=lower)
            np.subtract(self._upper[own], offset[own], out=upper)


def _force_rows(element: Element, contact: Element, size: int) -> tuple[Mat, Vec, Vec]:
    """C ``(k, size)`` on the contact's rows, after their turn into its frame, and the bounds."""
    maker: Any = getattr(element, "force_rows", None)
    if maker is None:
        raise DeclarationError(element.name, "binds a contact force but has no force_rows(dimension)")
    known: Any = getattr(contact, "force_basis", None)
    basis = np.eye(size) if known is None else np.asarray(known(), dtype=np.float64)
    C, lower, upper = (np.asarray(part, dtype=np.float64) for part in maker(basis.shape[0]))
    return C @ basis, lower, upper


def _axes(contact: Element, size: int, robot: Robot) -> tuple[Mat, list[slice]]:
    """Live rotation of the contact's frame and the three-row blocks of its rows that are in world axes."""
    frame = getattr(contact, "frame", None)
    if frame is None or size < 3:
        return np.eye(3), []
    _, rotation = robot.placement(robot.frame(frame))
    return rotation, [slice(at, at + 3) for at in range(0, size - 2, 3)]
