"""Formulations: meaning of the unknown x, accepted laws and quantities, and the command."""

from __future__ import annotations

from abc import ABC, abstractmethod
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field
from typing import Any, ClassVar, Literal

import numpy as np

from hqp.arrays import Index, Mat, Vec
from hqp.declare.element import Element
from hqp.declare.law import PD, Law, P, SelfMotion
from hqp.declare.price import Price, is_exact, level_prices
from hqp.declare.reference import Reference
from hqp.declare.robot import Robot, State
from hqp.declare.stack import Stack
from hqp.errors import DeclarationError
from hqp.problem import Hierarchy, Motion, Rows, Selection, Shape, Stacked
from hqp.programs.assembly import Assembly
from hqp.programs.layout import lay_out
from hqp.programs.loads import Loads, loads_of
from hqp.programs.rest import Holding


@dataclass(frozen=True)
class Place:
    """Place of an element's rows: ``part`` of level ``level`` of the hierarchy; its declared level by name."""

    element: Element
    level: int
    part: slice
    declared: str


class Program(ABC):
    """A stack compiled for one robot: a live hierarchy, refilled each tick, and the meaning of x."""

    kind: Literal["velocity", "acceleration", "torque"]
    problem: Hierarchy
    shape: Shape
    places: dict[str, Place]
    assembly: Assembly
    out: frozenset[str] = frozenset()
    """Names of inactive elements, see ``go_without``."""

    def go_without(self, out: frozenset[str]) -> None:
        """Free the rows of these elements from the next fill on, and restore those of all others."""
        self.assembly.go_without(out)
        self.out = out

    def refuses(self, out: frozenset[str]) -> str:
        """Reason that these elements cannot be inactive together, "" if they can."""
        return ""

    @property
    def copies(self) -> list[tuple[Mat, Mat, Index, Vec]]:
        """Blocks of rows ``(m, n)`` that are rows of a live array times a factor each: (A, array, rows, factors)."""
        return []

    @property
    def symmetric(self) -> list[tuple[Mat, Index]]:
        """Live arrays ``(rows, >= k)`` and k of their rows, of which the first k columns are symmetric to the bit."""
        return []

    @abstractmethod
    def prepare(self, state: State) -> None:
        """Compute the quantities of the state that the rows need."""

    @abstractmethod
    def fill(
        self,
        state: State,
        references: Mapping[str, Reference],
        given: Sequence[Reference],
        left_out: Sequence[str] = (),
    ) -> None:
        """Refill the hierarchy for a state and one reference an element; ``given`` may hold feedforward.

        left_out: elements whose rows are free in this tick.  If ``unusable`` names elements afterwards, fill the
        hierarchy again without them.
        """

    def unusable(self) -> tuple[str, ...]:
        """Names of elements whose rows of the latest fill are not usable."""
        return self.assembly.unusable()

    def reason(self, name: str) -> str:
        """Reason that an element's rows are not usable."""
        return self.assembly.reason(name)

    def remarks(self, state: State) -> tuple[str, ...]:
        """Remarks on the latest tick for its account, beside its rows."""
        return ()

    @property
    def level_names(self) -> tuple[str, ...]:
        """The declared level of each level of the hierarchy, numbered from 1 if it has several."""
        declared = {place.level: place.declared for place in self.places.values()}
        names = [declared[k] for k in range(len(self.problem.levels))]
        return tuple(n if names.count(n) == 1 else f"{n} {names[: k + 1].count(n)}" for k, n in enumerate(names))

    @property
    def errors(self) -> Mapping[str, Exception]:
        """Exceptions of elements in the latest fill."""
        return self.assembly.errors

    @property
    def targets_in_file(self) -> dict[str, Vec]:
        """Buffers of further targets that native code reads in a file, by element name."""
        return {}

    @property
    def live_targets(self) -> dict[str, Mat]:
        """Buffers of targets that native code reads, by element name."""
        members = self.assembly.members.items()
        return {name: m.target for name, m in members if m.target is not None and m.target.shape}

    @property
    def force_targets(self) -> dict[str, int]:
        """Sizes of the targets of forces and efforts, by name; ``aim_forces`` sets these targets."""
        return {}

    def aim_forces(self, references: Mapping[str, Reference]) -> None:  # noqa: B027
        """Set all targets of forces and efforts for the next native tick."""

    def took(self, state: State | None, references: Sequence[Reference]) -> None:  # noqa: B027
        """A native tick has filled the rows, for a state and with these references."""

    def in_python(self) -> tuple[str, str] | None:
        """First element that needs Python, with the reason; None if all of a tick is native."""
        return next(((m.element.name, "its rows are written in Python") for m in self.assembly.written), None)

    def begin_direct(self, state: State, references: Mapping[str, Reference]) -> None:  # noqa: B027
        """Native ticks follow: fill the rows that they leave unchanged."""

    def parts(self) -> dict[str, Any]:
        """Data of a tick before the solver, for a file (docs/plan_file.md)."""
        return {"kind": self.kind, **self.assembly.parts}

    def holding(self, robot: Robot) -> Holding | None:
        """Holding torque and inverse inertia of each motor at torque level, None at other levels."""
        return None

    @abstractmethod
    def command(self, x: Vec) -> Vec:
        """The actuated joints' part of x, ``(n_actuated,)``."""

    @abstractmethod
    def advance(self, state: State, x: Vec) -> tuple[Vec, Vec]:
        """Configuration and velocity one period later if x is carried out exactly."""


@dataclass(frozen=True, kw_only=True)
class Formulation(ABC):
    """Meaning of x.  A frozen value; ``compile`` turns a stack into a program for one robot."""

    order: ClassVar[int]
    quantities: ClassVar[frozenset[str]] = frozenset({"motion"})

    law: Law
    contact_law: Law

    @abstractmethod
    def compile(self, stack: Stack, robot: Robot, dt: float, price: Price | None = None) -> Program:
        """Resolve names, allocate, bind; raises DeclarationError or ModelError for a misfit.

        price: price of levels that declare none, the default for None; one with tau = 0 makes every level exact.
        """

    def completed(self, stack: Stack) -> Stack:
        """The stack with data that its elements need of each other; by default as it is."""
        return stack

    def bounded(self, stack: Stack, robot: Robot) -> tuple[Stack, str]:
        """Return the stack with default bounds on x, and a note on omitted ones."""
        return stack, ""

    def laws(self, stack: Stack) -> dict[str, Law]:
        """The law of each element, defaults filled in; raises DeclarationError for a law of another order."""
        laws = {}
        for element in stack:
            law = element.law or (self.contact_law if element.is_contact else self.law)
            if law.order != self.order or isinstance(law, SelfMotion):
                raise DeclarationError(
                    element.name,
                    f"{type(self).__name__} needs a law of order {self.order}, given {type(law).__name__}",
                    value=law,
                    allowed="P(gain [1/s])" if self.order == 1 else "PD(kp [1/s^2], kd [1/s])",
                )
            laws[element.name] = law
        return laws

    def check(self, stack: Stack) -> None:
        """Raise DeclarationError for an element that binds a quantity this formulation cannot map."""
        for element in stack:
            if element.quantity not in self.quantities and not getattr(element, "is_mass", False):
                raise DeclarationError(
                    element.name,
                    f"{type(self).__name__} maps {', '.join(sorted(self.quantities))} only",
                    value=element.quantity,
                    allowed="Torque for contact forces, efforts and loads",
                )


@dataclass(frozen=True, kw_only=True)
class Velocity(Formulation):
    """x is the generalised velocity ``(nv,)`` [m/s, rad/s]; rows J x = v_ref - gain e (Mistry 2008, eqs. 7, 16).

    law: for elements without one.  contact_law: law of contacts, whose feedback keeps the feet from drifting by O(dt)
    (eq. 19 alone).
    """

    order: ClassVar[int] = 1
    law: Law = field(default=P(5.0))
    contact_law: Law = field(default=P(20.0))

    def compile(self, stack: Stack, robot: Robot, dt: float, price: Price | None = None) -> Program:
        """Resolve names, allocate, bind; raises DeclarationError or ModelError for a misfit."""
        return MotionProgram(self, stack, robot, dt, price)


@dataclass(frozen=True, kw_only=True)
class Acceleration(Formulation):
    """x is the generalised acceleration ``(nv,)``; rows J x = a_ref - kp e - kd (J v - v_ref) - dJ/dt v (eq. 18).

    law, contact_law: see Velocity, of second order.
    """

    order: ClassVar[int] = 2
    law: Law = field(default=PD(100.0, 20.0))
    contact_law: Law = field(default=PD(400.0, 40.0))

    def compile(self, stack: Stack, robot: Robot, dt: float, price: Price | None = None) -> Program:
        """Resolve names, allocate, bind; raises DeclarationError or ModelError for a misfit."""
        return MotionProgram(self, stack, robot, dt, price)


class MotionProgram(Program):
    """A stack whose x is the whole robot's velocity or acceleration."""

    def __init__(
        self, formulation: Formulation, stack: Stack, robot: Robot, dt: float, price: Price | None = None
    ) -> None:
        formulation.check(stack)
        laws = formulation.laws(stack)
        exact = is_exact(price)
        loads = loads_of(stack)
        groups = lay_out(stack, robot, held=loads, contacts_first=not exact)
        dense = [e for group in groups if not group.selection for e in group.elements]
        selections = [e for group in groups if group.selection for e in group.elements]
        self.assembly = rows = Assembly(dense, selections, robot, dt, laws)
        self._loads = Loads(loads, robot, rows.native_rows)
        rows.move(robot)
        self._lost: tuple[str, ...] = ()
        self.dt = dt
        self._order = formulation.order
        self.kind = "velocity" if self._order == 1 else "acceleration"
        self._robot, self._actuated = robot, robot.actuated
        levels, slices = [], []
        self.places = {}
        for k, group in enumerate(groups):
            parts = [rows.members[e.name].part for e in group.elements]
            part = slice(parts[0].start, parts[-1].stop)
            for element, own in zip(group.elements, parts, strict=True):
                place = slice(own.start - part.start, own.stop - part.start)
                self.places[element.name] = Place(element, k, place, group.name)
            A: Selection | np.ndarray[tuple[int, ...], np.dtype[np.float64]] = rows.J[part]
            if group.selection:
                A = Selection(rows.picks(part), rows.weight[part])
            levels.append(Rows(A, rows.lower[part], rows.upper[part]))
            slices.append(None if group.selection else part)
        m = rows.J.shape[0]
        stacked = Stacked(rows.J, rows.lower[:m], rows.upper[:m], tuple(slices)) if m else None
        constraints = sum(group.constraint for group in groups)
        paid = level_prices(groups, robot, laws, formulation.order, dt, price)
        motion = None
        self._slowed: Vec | None = None
        if paid is not None:
            self._slowing = -paid.rest * paid.scale
            self._slowed = np.zeros(robot.nv) if paid.rest > 0.0 else None
            motion = Motion(paid.scale, self._slowed)
        self.problem = Hierarchy(
            tuple(levels),
            constraints=constraints,
            n=robot.nv,
            stacked=stacked,
            prices=None if paid is None else paid.values,
            motion=motion,
            turning=None if paid is None else paid.turning,
        )
        inequalities = any(not element.equality for element in stack)
        self.shape = Shape(
            robot.nv,
            tuple(r.m for r in levels),
            tuple(group.selection for group in groups),
            inequalities,
            priced=self.problem.priced,
        )

    def prepare(self, state: State) -> None:
        """Compute the quantities of the state that the rows and the price of motion need."""
        state.kinematics()
        state.out = self.out
        if self._loads.elements:
            self._loads.begin(state)
        self._slow(state)

    def _slow(self, state: State) -> None:
        if self._slowed is not None:  # S qdd = -rest S v costs nothing
            np.multiply(state.v, self._slowing, out=self._slowed)

    def fill(
        self,
        state: State,
        references: Mapping[str, Reference],
        given: Sequence[Reference],
        left_out: Sequence[str] = (),
    ) -> None:
        """Refill the hierarchy for a state and one reference an element; ``given`` may hold feedforward."""
        if self._loads:
            self._lost = self._loads.take(state, references)
            given = [r for r in given if r.name in self.assembly.members]
            left_out = [name for name in left_out if name in self.assembly.members]
        self.assembly.fill(state, references, given, left_out)

    def unusable(self) -> tuple[str, ...]:
        """Names of elements whose rows, and of payloads whose numbers, are not usable."""
        return self.assembly.unusable() + self._lost

    def reason(self, name: str) -> str:
        """Reason that an element's rows or a payload's numbers are not usable."""
        return self.assembly.reason(name) or "its numbers are not finite"

    def in_python(self) -> tuple[str, str] | None:
        """First element that needs Python, with the reason; None if all of a tick is native."""
        if self._loads.readable:
            return self._loads.readable[0], "it has no native code"
        return super().in_python()

    @property
    def live_targets(self) -> dict[str, Mat]:
        """Buffers of targets that native code reads, by element name."""
        return {**super().live_targets, **self._loads.live}

    def took(self, state: State | None, references: Sequence[Reference]) -> None:
        """A native tick has filled the rows, for a state and with these references."""
        if self._loads.elements:
            self._loads.took(state, references)

    def parts(self) -> dict[str, Any]:
        """Data of a tick before the solver, for a file (docs/plan_file.md)."""
        slowing = None if self._slowed is None else {"scale": self._slowing, "f": self._slowed}
        return {**super().parts(), "slowing": slowing, "loads": self._loads.parts}

    def command(self, x: Vec) -> Vec:
        """The actuated joints' part of x, ``(n_actuated,)`` (eq. 16, the first factor)."""
        return x[self._actuated]

    def advance(self, state: State, x: Vec) -> tuple[Vec, Vec]:
        """Semi-implicit: v+ = x or v + dt x, then q+ = q + dt v+ (eqs. 19 to 22, the index of eq. 22 set right)."""
        v = x.copy() if self._order == 1 else state.v + self.dt * x
        return state.robot.integrate(state.q, v, self.dt), v
