"""Known loads in the equation of motion: wrenches from outside and payloads, filled in each tick."""

from __future__ import annotations

import math
from collections.abc import Mapping, Sequence
from typing import TYPE_CHECKING, Any

import numpy as np

from hqp.arrays import Mat, Vec
from hqp.element import Element, plan_of
from hqp.errors import DeclarationError
from hqp.plans import ExternalWrench, Payload
from hqp.reference import Reference
from hqp.robot import Load, Robot, State
from hqp.stack import Stack

if TYPE_CHECKING:
    from hqp._assembly import Assembly as NativeAssembly


def loads_of(stack: Stack) -> tuple[Element, ...]:
    """The loads of a stack; raises DeclarationError for one in a level, which has nothing to order there."""
    for level in stack.levels:
        for element in level:
            if element.quantity == "load":
                raise DeclarationError(element.name, "a load has no rows", value=level.name, allowed="subject_to")
    return tuple(e for e in stack.subject_to if e.quantity == "load")


class Loads:
    """A, b + g and g of a state with the loads of its tick; ``values`` are the latest, by name.

    rows: the native operations that write the terms, for loads that all have a plan; the loads' own functions else.
    """

    def __init__(self, elements: Sequence[Element], robot: Robot, rows: NativeAssembly | None) -> None:
        self.elements: tuple[Any, ...] = tuple(elements)
        for element in elements:
            element.rows(robot)
        self.values: dict[str, Vec] = {}
        self._A: Mat = np.zeros((robot.nv, robot.nv), order="F")
        self._bias, self._gravity = np.zeros(robot.nv), robot.gravity
        self._taken: dict[str, Reference] = {}
        self._carried: tuple[Load, ...] = ()
        found = [plan_of(element, robot) for element in elements]
        self._native = rows if None not in found else None
        self._live: dict[str, Vec] = {}
        for element, plan in zip(elements, found, strict=True):
            if rows is not None and isinstance(plan, (Payload, ExternalWrench)):
                self._live[element.name] = np.zeros(plan.shape)
                rows.load(plan, self._live[element.name])

    def __bool__(self) -> bool:
        return bool(self.elements)

    def begin(self, state: State) -> None:
        """Give the state the payloads of the latest tick, or as declared before the first."""
        if len(self.values) < len(self.elements):
            for element in self.elements:
                self._set(element, element.hold(state).value)
        state.loads = self._carried

    def take(self, state: State, references: Mapping[str, Reference]) -> tuple[str, ...]:
        """Take the loads of this tick; names of those whose numbers are not finite, whose old ones are kept."""
        broken = []
        for element in self.elements:
            reference = references[element.name]
            if reference is self._taken.get(element.name):
                continue
            value = reference.value
            if value is None or not float(value.dot(value)) < math.inf:
                broken.append(element.name)
            else:
                self._set(element, value)
                self._taken[element.name] = reference
        state.loads = self._carried
        return tuple(broken)

    def _set(self, element: Any, value: Vec) -> None:
        name = element.name
        self.values[name] = value
        if name in self._live:
            self._live[name][:] = value
        found = ((e, self.values.get(e.name)) for e in self.elements)
        loads = (None if at is None else e.carried(at) for e, at in found)
        self._carried = tuple(load for load in loads if load is not None and load[1])

    def dynamics(self, state: State, written: bool = True) -> tuple[Mat, Vec]:
        """A (its upper triangle) and b + g.  written: whether the rows of this state were written last."""
        A, bias = state.inertia(), state.bias_force()
        if not self.elements:
            return A, bias
        np.copyto(self._A, A)
        np.copyto(self._bias, bias)
        if self._native is not None and written:
            self._native.loads(self._A, self._bias, self._gravity)
            return self._A, self._bias
        for more, change, _ in self._terms(state):
            self._bias += change
            if more is not None:
                self._A += more
        return self._A, self._bias

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
