"""Known loads in the equation of motion: wrenches from outside and payloads, filled in each tick."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from typing import Any

import numpy as np

from hqp.arrays import Mat, Vec
from hqp.element import Element
from hqp.errors import DeclarationError
from hqp.reference import Reference
from hqp.robot import Robot, State
from hqp.stack import Stack


def loads_of(stack: Stack) -> tuple[Element, ...]:
    """The loads of a stack; raises DeclarationError for one in a level, which has nothing to order there."""
    for level in stack.levels:
        for element in level:
            if element.quantity == "load":
                raise DeclarationError(element.name, "a load has no rows", value=level.name, allowed="subject_to")
    return tuple(e for e in stack.subject_to if e.quantity == "load")


class Loads:
    """A, b + g and g of a state with the loads of its tick; ``values`` are the latest, by name."""

    def __init__(self, elements: Sequence[Element], robot: Robot) -> None:
        self.elements: tuple[Any, ...] = tuple(elements)
        for element in elements:
            element.rows(robot)
        self.values: dict[str, Vec] = {}
        self._A: Mat = np.zeros((robot.nv, robot.nv), order="F")

    def __bool__(self) -> bool:
        return bool(self.elements)

    def take(self, references: Mapping[str, Reference]) -> tuple[str, ...]:
        """Take the loads of this tick; names of those whose numbers are not finite, whose old ones are kept."""
        broken = []
        for element in self.elements:
            value = references[element.name].value
            if value is None or not np.isfinite(value).all():
                broken.append(element.name)
            else:
                self.values[element.name] = np.asarray(value, dtype=np.float64)
        return tuple(broken)

    def dynamics(self, state: State) -> tuple[Mat, Vec]:
        """A (its upper triangle) and b + g."""
        A, bias = state.inertia(), state.bias_force()
        if not self.elements:
            return A, bias
        np.copyto(self._A, A)
        bias = np.array(bias)
        for more, change, _ in self._terms(state):
            bias += change
            if more is not None:
                self._A += more
        return self._A, bias

    def gravity(self, state: State) -> Vec:
        """g: what has to be held up at rest, ``(nv,)``."""
        g = state.gravity_force()
        for _, _, change in self._terms(state):
            g = g + change
        return g

    def change(self, state: State) -> dict[str, Vec]:
        """What each load adds to g, ``(nv,)`` by name."""
        return {e.name: terms[2] for e, terms in zip(self.elements, self._terms(state), strict=True)}

    def _terms(self, state: State) -> list[tuple[Mat | None, Vec, Vec]]:
        return [e.terms(state, self._value(e, state)) for e in self.elements]

    def _value(self, element: Any, state: State) -> Vec:
        value = self.values.get(element.name)
        return element.hold(state).value if value is None else value
