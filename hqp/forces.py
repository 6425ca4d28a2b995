"""Rows on torques and on contact forces, the two quantities beside motion that a torque hierarchy binds."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from typing import Any

import numpy as np

from hqp.arrays import Mat, Vec
from hqp.assembly import Assembly
from hqp.dynamics import ConstrainedDynamics
from hqp.element import Block, Element, Writer
from hqp.errors import DeclarationError
from hqp.problem import Rows, Selection
from hqp.reference import Reference
from hqp.robot import Robot, State


class Efforts:
    """Elements on tau itself: their own rows J ``(k, n_actuated)``, bounds refilled each tick."""

    def __init__(self, elements: Sequence[Element], robot: Robot, dt: float) -> None:
        self._blocks: dict[str, Block] = {}
        self._elements = {e.name: e for e in elements}
        self._plan: list[tuple[Writer, str, Block, Vec, Vec, bool, float]] = []
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
        self._plan.append((writer, element.name, block, lower, upper, element.equality, element.weight))

    def fill(self, state: State, references: Mapping[str, Reference]) -> None:
        """Refill the bounds: an equality asks for tau = reference (its block's error is -reference)."""
        for write, name, block, lower, upper, equality, weight in self._plan:
            write(state, references[name])
            if equality:
                np.multiply(block.error, -weight, out=lower)
                np.copyto(upper, lower)
            else:
                np.multiply(block.lower, weight, out=lower)
                np.multiply(block.upper, weight, out=upper)


class Forces:
    """Elements on the force of a reaction constraint: lower <= C f <= upper with f = -lambda(tau) in contact axes.

    Contact axes are those of the contact's frame where its rows are in world axes, and its rows' own axes otherwise.
    """

    def __init__(self, elements: Sequence[Element], held: Sequence[Element], rows: Assembly, robot: Robot) -> None:
        self._rows = rows
        self._elements = {e.name: e for e in elements}
        self._C: dict[str, Mat] = {}
        self._bounds: dict[str, tuple[Vec, Vec]] = {}
        self._axes: dict[str, tuple[slice, Mat | None, list[slice]]] = {}
        self._plan: list[tuple[str, slice, Mat, Vec, Vec]] = []
        by_name = {e.name: e for e in held}
        for element in elements:
            contact = by_name.get(getattr(element, "contact", ""))
            if contact is None:
                raise element.bad("contact", getattr(element, "contact", None), _known(by_name))
            part = rows.members[contact.name].part
            size = part.stop - part.start
            C, lower, upper = _force_rows(element, contact, size)
            self._C[element.name], self._bounds[element.name] = C, (lower, upper)
            self._axes[element.name] = (part, *_axes(contact, size, robot))

    def __bool__(self) -> bool:
        return bool(self._elements)

    def rows(self, name: str) -> int:
        """Number of rows of an element."""
        return int(self._C[name].shape[0])

    def place(self, name: str, here: slice, A: Mat, lower: Vec, upper: Vec) -> None:
        """Write an element's rows and bounds at ``here`` of a block each tick."""
        self._plan.append((name, here, A[here], lower[here], upper[here]))

    def fill(self, state: State, references: Mapping[str, Reference], dynamics: ConstrainedDynamics) -> None:
        """Refill rows C R^T (-F) and bounds less C R^T (-f), lambda = F tau + f (eq. 3)."""
        F, f = dynamics.force_map()
        for name, _, A, lower, upper in self._plan:
            element = self._elements[name]
            part, rotation, blocks = self._axes[name]
            C = self._C[name]
            weight = self._rows.weight[part.start] * element.weight
            low, high = self._bounds[name]
            if rotation is not None:
                turned = np.empty_like(C)
                for block in blocks:
                    np.matmul(C[:, block], rotation.T, out=turned[:, block])
                C = turned
            C = C * -weight
            np.matmul(C, F[part], out=A)
            offset = C @ f[part]
            target = references[name].value
            if element.equality and target is not None:
                low = high = np.asarray(target, dtype=np.float64)
            np.subtract(low * element.weight, offset, out=lower)
            np.subtract(high * element.weight, offset, out=upper)


def _known(by_name: Mapping[str, Element]) -> str:
    return "a contact in subject_to: " + (", ".join(by_name) or "there is none")


def _force_rows(element: Element, contact: Element, size: int) -> tuple[Mat, Vec, Vec]:
    maker: Any = getattr(element, "force_rows", None)
    if maker is None:
        raise DeclarationError(element.name, "binds a contact force but has no force_rows(dimension)")
    C, lower, upper = (np.asarray(part, dtype=np.float64) for part in maker(size))
    if C.ndim != 2 or C.shape[1] != size:
        raise DeclarationError(
            element.name, f"its rows take {C.shape[-1]} numbers, the force of {contact.name} has {size}"
        )
    return C, lower, upper


def _axes(contact: Element, size: int, robot: Robot) -> tuple[Mat | None, list[slice]]:
    """Live rotation of the contact's frame and the three-row blocks of its rows that are in world axes."""
    frame = getattr(contact, "frame", None)
    if frame is None or size < 3:
        return None, []
    _, rotation = robot.placement(robot.frame(frame))
    return rotation, [slice(at, at + 3) for at in range(0, size - 2, 3)]
