"""Known loads in the equation of motion: external wrenches and payloads, filled in each tick."""

from __future__ import annotations

import math
from collections.abc import Mapping, Sequence
from typing import TYPE_CHECKING, Any

import numpy as np

from hqp.arrays import Mat, Vec
from hqp.declare.element import Element, plan_of
from hqp.declare.plans import ExternalWrench, JointLoad, NominalTorque, Payload
from hqp.declare.reference import Reference
from hqp.declare.robot import Load, Robot, State
from hqp.declare.stack import Stack
from hqp.errors import DeclarationError

if TYPE_CHECKING:
    from hqp._assembly import Assembly as NativeAssembly


def loads_of(stack: Stack) -> tuple[Element, ...]:
    """The loads of a stack; raises DeclarationError for one in a level: a load has no rows."""
    for level in stack.levels:
        for element in level:
            if element.quantity == "load":
                raise DeclarationError(element.name, "a load has no rows", value=level.name, allowed="subject_to")
    return tuple(e for e in stack.subject_to if e.quantity == "load")


class Loads:
    """A, b + g and g of a state with the loads of its tick; ``values`` are the latest, by name.

    rows: native operations that include loads with a plan, see ``add``.
    """

    def __init__(self, elements: Sequence[Element], robot: Robot, rows: NativeAssembly | None) -> None:
        self.elements: tuple[Any, ...] = tuple(elements)
        for element in elements:
            element.rows(robot)
        self.values: dict[str, Vec] = {}
        self._taken: dict[str, Reference] = {}
        self._carried: tuple[Load, ...] = ()
        self._live: dict[str, Vec] = {}
        self._readable: list[Any] = []
        self.parts: list[dict[str, Any]] = []
        for element in elements:
            plan = plan_of(element, robot)
            native = (NominalTorque,) if rows is None else (NominalTorque, Payload, ExternalWrench, JointLoad)
            if isinstance(plan, native):
                self._live[element.name] = np.zeros(plan.shape)
                if rows is not None:
                    self.parts.append({"name": element.name, "plan": plan, "value": self._live[element.name]})
                    rows.load(self.parts[-1])
            else:
                self._readable.append(element)

    @property
    def live(self) -> dict[str, Mat]:
        """Buffers of values of loads with a plan, which native code reads, by name."""
        return dict(self._live)

    def took(self, state: State | None, references: Sequence[Reference]) -> None:
        """Record the loads of a native tick."""
        if self._live:
            self.values.update((name, live.copy()) for name, live in self._live.items())
            self._carry()
        if state is not None:
            state.loads = self._carried

    @property
    def readable(self) -> list[str]:
        """Names of loads without a plan."""
        return [element.name for element in self._readable]

    def __bool__(self) -> bool:
        return bool(self.elements)

    def begin(self, state: State) -> None:
        """Set the state's payloads: those of the latest tick, the declared ones before the first."""
        if len(self.values) < len(self.elements):
            for element in self.elements:
                self._set(element, element.hold(state).value)
        state.loads = self._carried

    def take(self, state: State, references: Mapping[str, Reference]) -> tuple[str, ...]:
        """Set the loads of this tick; return names of loads that are not finite, which keep their old numbers."""
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
        self._carry()

    def _carry(self) -> None:
        """Point masses of the present values."""
        found = ((e, self.values.get(e.name)) for e in self.elements)
        loads = (None if at is None else e.carried(at) for e, at in found)
        self._carried = tuple(load for load in loads if load is not None and load[1])

    def dynamics(self, state: State) -> tuple[Mat, Vec]:
        """A (its upper triangle) and b + g."""
        A, bias = state.inertia().copy(), state.bias_force().copy()
        self._add(state, self.elements, A, bias)
        return A, bias

    def add(self, state: State, A: Mat, bias: Vec) -> None:
        """Add the loads without native operation to A and b + g."""
        self._add(state, self._readable, A, bias)

    def _add(self, state: State, elements: Sequence[Any], A: Mat, bias: Vec) -> None:
        for more, change, _ in self._terms(state, elements):
            bias += change
            if more is not None:
                A += more

    def gravity(self, state: State) -> Vec:
        """g: generalised gravity force of the loads, ``(nv,)``."""
        g = state.gravity_force()
        for _, _, change in self._terms(state, self.elements):
            g = g + change
        return g

    def change(self, state: State) -> dict[str, Vec]:
        """Contribution of each load to g, ``(nv,)`` by name."""
        return {e.name: terms[2] for e, terms in zip(self.elements, self._terms(state, self.elements), strict=True)}

    def _terms(self, state: State, elements: Sequence[Any]) -> list[tuple[Mat | None, Vec, Vec]]:
        return [e.terms(state, self._value(e, state)) for e in elements]

    def _value(self, element: Any, state: State) -> Vec:
        value = self.values.get(element.name)
        return element.hold(state).value if value is None else value
