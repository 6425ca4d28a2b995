"""Tasks and constraints: frozen declarations that, bound to a robot, write their rows into a block each tick."""

from __future__ import annotations

import dataclasses
import math
import re
from abc import ABC, abstractmethod
from collections.abc import Callable, Mapping
from dataclasses import dataclass, field
from typing import Any, ClassVar, Literal, TypeAlias

import numpy as np

from hqp.arrays import Index, Mat, Vec
from hqp.errors import DeclarationError
from hqp.law import Law
from hqp.reference import Reference, numbers
from hqp.robot import Robot, State

Writer: TypeAlias = Callable[[State, Reference], None]
"""Fills the views of one Block for a state and a reference; keeps ids, masks and scratch of its own."""

Quantity: TypeAlias = Literal["motion", "force", "effort"]

REGISTRY: dict[str, type[Element]] = {}
"""Concrete element classes by name, for stacks read from files."""


@dataclass(frozen=True, eq=False)
class Plan:
    """A writer as plain data, so that one native call may stand in for the writers of all elements that have one.

    kind: an operation of the native assembly.  data: its arguments.  shape: of the reference's value, () for none.
    ground: whether the operation also takes the reference's normal, vertical by default.
    """

    kind: str
    data: Mapping[str, Any]
    shape: tuple[int, ...] = ()
    ground: bool = False


@dataclass(eq=False)
class Block:
    """One element's rows: views into the arrays of the stack, to be filled by its writer.

    J ``(m, nv)``; error ``(m,)``: value minus reference; rate ``(m,)``: reference velocity; feedforward ``(m,)``:
    reference acceleration; drift ``(m,)``: dJ/dt v; lower, upper ``(m,)``: for elements that are no equalities.
    order: 1 where x is a velocity, 2 where it is an acceleration.  dt: control period [s].
    twist: after ``use_twist``, ``(m, 6)`` to fill in place of J.  plan: what the writer does, if it is a common thing.
    """

    J: Mat
    error: Vec
    rate: Vec
    feedforward: Vec
    drift: Vec
    lower: Vec
    upper: Vec
    order: int
    dt: float
    twist: Mat | None = None
    support: Mat | None = field(default=None, repr=False)
    plan: Plan | None = field(default=None, repr=False)
    pool: Callable[[int], Mat] | None = field(default=None, repr=False)

    def use_twist(self, support: Vec) -> Mat:
        """Declare that J = (twist @ joint_twists) * support; returns twist ``(m, 6)``, filled by the writer each tick.

        support: ``(nv,)``, 1 where a coordinate moves the frame; a difference of two for a relative motion.
        All such rows of a stack become one matrix product.
        """
        m = self.J.shape[0]
        self.twist = np.zeros((m, 6)) if self.pool is None else self.pool(m)
        self.support = np.tile(support, (m, 1))
        return self.twist


@dataclass(frozen=True, kw_only=True)
class Element(ABC):
    """A member of a stack: rows on one quantity of the robot.

    name: unique in a stack, the frame or the class by default.  weight: multiplies the rows inside their level
    (squared norm: weight^2), orders nothing.  law: how the error becomes a demand, the formulation's default for
    None.  Raises DeclarationError for a weight that is not positive and finite.
    """

    name: str = ""
    law: Law | None = None
    weight: float = 1.0

    quantity: ClassVar[Quantity] = "motion"
    equality: ClassVar[bool] = True
    is_contact: ClassVar[bool] = False

    def __init_subclass__(cls, **kwargs: Any) -> None:
        super().__init_subclass__(**kwargs)
        if not cls.__name__.startswith("_"):
            REGISTRY[cls.__name__] = cls

    def __post_init__(self) -> None:
        for item in dataclasses.fields(self):
            value = getattr(self, item.name)
            if isinstance(value, list):
                object.__setattr__(self, item.name, tuple(value))
        if not self.name:
            object.__setattr__(self, "name", self.default_name())
        if not isinstance(self.name, str):
            raise DeclarationError(type(self).__name__, "name must be a string", value=self.name)
        if not isinstance(self.weight, (int, float)) or not 0.0 < self.weight < math.inf:
            raise self.bad("weight", self.weight, "a positive finite number")
        if self.law is not None and not isinstance(self.law, Law):
            raise self.bad("law", self.law, "P(...) or PD(...)")

    def default_name(self) -> str:
        """The frame where there is one, the class name in snake case otherwise."""
        frame = getattr(self, "frame", None)
        return frame if isinstance(frame, str) else re.sub(r"(?<=[a-z])(?=[A-Z])", "_", type(self).__name__).lower()

    def bad(self, what: str, value: object, allowed: str) -> DeclarationError:
        """The error for a field with a value that is not allowed."""
        return DeclarationError(f"{type(self).__name__} {self.name or '?'}", what, value=value, allowed=allowed)

    @abstractmethod
    def rows(self, robot: Robot) -> int:
        """Number of rows on that robot; raises ModelError for names it does not have."""

    def selection(self, robot: Robot) -> Index | None:
        """Tangent coordinates ``(m,)`` if the rows each pick one, None otherwise."""
        return None

    def hold(self, state: State) -> Reference:
        """The reference that keeps the element where it is at ``state``."""
        return Reference(self.name)

    @abstractmethod
    def bind(self, robot: Robot, out: Block) -> Writer:
        """Resolve names once and return the writer that fills ``out`` each tick."""


@dataclass(frozen=True, kw_only=True)
class Task(Element):
    """Something to bring to zero: error e = value - reference, with rows J x = law(e, ...).

    A subclass gives ``rows``, ``value``, ``jacobian``, for accelerations and torques ``drift``, and ``error`` where
    the value is no vector; J v must be the rate of the value.  A faster ``bind`` is optional.
    """

    @abstractmethod
    def value(self, state: State) -> Any:
        """What the task controls, ``(m,)`` unless the task says otherwise."""

    @abstractmethod
    def jacobian(self, state: State) -> Mat:
        """J ``(m, nv)`` with d value / dt = J v."""

    def error(self, state: State, reference: Any) -> Vec:
        """e ``(m,)``: value minus reference."""
        return np.asarray(self.value(state) - reference, dtype=np.float64)

    def drift(self, state: State) -> Vec:
        """dJ/dt v ``(m,)``; a task without it is refused where accelerations are asked for."""
        raise NotImplementedError

    def hold(self, state: State) -> Reference:
        """The reference that keeps the task's value as it is at ``state``."""
        return Reference(self.name, self.value(state))

    def at(self, value: Any = None, *, velocity: Any = None, acceleration: Any = None) -> Reference:
        """The target for one tick, with velocity and acceleration feedforward; None keeps the hold value."""
        return Reference(
            self.name,
            None if value is None else np.asarray(value, dtype=np.float64),
            None if velocity is None else np.atleast_1d(np.asarray(velocity, dtype=np.float64)),
            None if acceleration is None else np.atleast_1d(np.asarray(acceleration, dtype=np.float64)),
        )

    def _at(self, shape: tuple[int, ...], value: Any, velocity: Any, acceleration: Any) -> Reference:
        """``at`` with the shapes checked: value ``shape``, feedforwards as many numbers as its rows."""
        return Reference(
            self.name,
            None if value is None else numbers(self.name, "value", value, shape),
            None if velocity is None else numbers(self.name, "velocity", velocity, shape[:1]),
            None if acceleration is None else numbers(self.name, "acceleration", acceleration, shape[:1]),
        )

    def bind(self, robot: Robot, out: Block) -> Writer:
        """A writer made of value, error, jacobian and drift: right for every task, not the fastest."""
        if out.order == 2 and type(self).drift is Task.drift:
            raise self.bad("has no drift(state), which accelerations and torques need", type(self).__name__, "drift")

        def write(state: State, reference: Reference) -> None:
            out.J[:] = self.jacobian(state)
            out.error[:] = self.error(state, reference.value)
            if out.order == 2:
                out.drift[:] = self.drift(state)

        return write


@dataclass(frozen=True, kw_only=True)
class Constraint(Element):
    """Rows that bind; in a level they are met as well as its priority allows.

    Contacts and couplings are tasks too (error, Jacobian, law); limits and friction set ``equality = False`` and
    write lower and upper themselves.
    """
