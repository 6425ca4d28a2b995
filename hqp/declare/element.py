"""Tasks and constraints: frozen declarations with readable functions of a state that return their rows."""

from __future__ import annotations

import dataclasses
import re
import sys
import weakref
from abc import ABC, abstractmethod
from collections.abc import Sequence, Set
from dataclasses import dataclass
from functools import cache
from typing import Any, ClassVar, Literal, TypeAlias

import numpy as np
from numpy.typing import ArrayLike

from hqp.arrays import Index, Mat, Vec
from hqp.declare.law import Law
from hqp.declare.plans import Plan
from hqp.declare.reference import Reference, numbers
from hqp.declare.robot import Robot, State
from hqp.errors import DeclarationError
from hqp.numbers import set_numbers

Quantity: TypeAlias = Literal["motion", "force", "effort", "load"]

Unit: TypeAlias = Literal["m", "rad"]

REGISTRY: weakref.WeakValueDictionary[str, type[Element]] = weakref.WeakValueDictionary()
"""Concrete element classes by name, for stacks read from files; a script's own classes end with the script."""

_APART = frozenset(
    {"among", "at", "hold", "declares_hold", "default_name", "row_names"}
)  # no effect on the numbers of the rows


@dataclass(frozen=True, kw_only=True)
class Element(ABC):
    """A member of a stack: rows on one quantity of the robot.

    name: unique in a stack, the frame or the class by default.  weight: multiplies the rows inside their level (squared
    norm: weight^2), orders nothing.  law: map from error to demand, the formulation's default for None.  when: phases
    in which it is in, all for none.  Raises DeclarationError for a weight that is not positive and finite.
    """

    name: str = ""
    law: Law | None = None
    weight: float = 1.0
    when: str | Sequence[str] = ()

    quantity: ClassVar[Quantity] = "motion"
    equality: ClassVar[bool] = True
    is_contact: ClassVar[bool] = False
    grounded: ClassVar[bool] = False
    """True if the readable functions also take the ground's normal ``(3,)``, which comes with the reference."""
    on_ground: ClassVar[bool] = False
    """True if ``at`` takes the ground's normal, and forces are seen in axes on the ground."""
    steered: ClassVar[bool] = False
    """True if J, drift and bounds also take the value of the reference."""
    units: ClassVar[tuple[Unit, ...]] = ()
    """Unit of each block of rows, ``()`` where it is neither; a Pose has two blocks."""

    def __init_subclass__(cls, **kwargs: Any) -> None:
        super().__init_subclass__(**kwargs)
        if not cls.__name__.startswith("_"):
            REGISTRY[cls.__name__] = cls

    def __post_init__(self) -> None:
        for item in dataclasses.fields(self):
            value = getattr(self, item.name)
            if isinstance(value, (list, np.generic, np.ndarray)):
                object.__setattr__(self, item.name, _plain(value))
        if self.name is not None and not isinstance(self.name, str):
            raise DeclarationError(type(self).__name__, "name must be a string", value=self.name)
        if not self.name:
            object.__setattr__(self, "name", self.default_name())
        for item in dataclasses.fields(self):
            value = getattr(self, item.name)
            if isinstance(value, int) and abs(value) > sys.float_info.max:
                raise self.invalid(item.name, "a whole number of more than 308 digits", "a finite number")
        set_numbers(self, self.owner, ("weight",), 0.0, strict=True)
        if self.law is not None and not isinstance(self.law, Law):
            raise self.invalid("law", self.law, "P(...) or PD(...)")
        object.__setattr__(self, "when", phase_names(self.name, self.when))

    def default_name(self) -> str:
        """The frame where there is one, the class name in snake case otherwise."""
        frame = getattr(self, "frame", None)
        return frame if isinstance(frame, str) else re.sub(r"(?<=[a-z])(?=[A-Z])", "_", type(self).__name__).lower()

    def invalid(self, what: str, value: object, allowed: str) -> DeclarationError:
        """The error for a field with a value that is not allowed."""
        return DeclarationError(self.owner, what, value=value, allowed=allowed)

    @property
    def owner(self) -> str:
        """Kind and name, as errors show them."""
        named = isinstance(self.name, str) and bool(self.name)
        return f"{type(self).__name__} {self.name if named else '?'}"

    @abstractmethod
    def rows(self, robot: Robot) -> int:
        """Number of rows on that robot; raises ModelError for names it does not have."""

    def remark(self, robot: Robot) -> str:
        """Text of a session's warning and first note about the element on this robot, or ""."""
        return ""

    def selection(self, robot: Robot) -> Index | None:
        """Tangent coordinates ``(m,)`` if the rows each pick one, None otherwise."""
        return None

    def hold(self, state: State) -> Reference:
        """The reference that keeps the element where it is at ``state``."""
        return Reference(self.name)

    @property
    def declares_hold(self) -> bool:
        """True if ``hold`` gives a declared value at any state."""
        return False

    def off(self) -> Reference:
        """The element is out of this tick: its rows are free, and a contact at torque level bears no force.

        Elements on the force of a contact are out with it.  An element that comes back takes a fresh hold value.
        """
        return Reference(self.name, on=False)

    def on(self) -> Reference:
        """Switch the element in for one tick, regardless of its phase."""
        return Reference(self.name, on=True)

    def goes_with(self, out: Set[str]) -> bool:
        """Return true if the element is out when these elements are out: an element on the force of one of them."""
        return getattr(self, "contact", None) in out

    def row_names(self, robot: Robot) -> tuple[str, ...]:
        """Names of single rows ``(m,)`` for notes and explanations, none by default: rows are then numbered."""
        return ()

    def among(self, elements: Sequence[Element]) -> Element:
        """The element as it is in a stack of these elements, itself unless it takes something from others of them."""
        return self

    def companions(self, robot: Robot) -> tuple[Element, ...]:
        """Elements that go with this one on that robot; a session adds those of classes that its stack lacks."""
        return ()

    def plan(self, robot: Robot) -> Plan | None:
        """The native operation that writes the same rows, names resolved; None if there is none.

        It counts only where no subclass of the class that gives it redefines a function of the element.
        """
        return None


@dataclass(frozen=True, kw_only=True)
class Task(Element):
    """Something to bring to zero: error e = value - reference, with rows J x = law(e, ...).

    A subclass gives ``rows``, ``value``, ``jacobian``, for accelerations and torques ``drift``, and ``error`` where the
    value is no vector; J v must be the rate of the value.  ``hqp.check`` compares them.
    """

    demands: ClassVar[bool] = False
    """True if ``error`` is minus the demand on J x, by a law of the task's own, and not value minus reference."""

    @property
    def rotation_rows(self) -> int | None:
        """First of the three rows whose error is a rotation vector, None without such rows."""
        return None

    @abstractmethod
    def value(self, state: State) -> Any:
        """Value under control, ``(m,)`` unless the task documents another shape."""

    @abstractmethod
    def jacobian(self, state: State) -> Mat:
        """J ``(m, nv)`` with d value / dt = J v."""

    def error(self, state: State, reference: Any) -> Vec:
        """e ``(m,)``: value minus reference."""
        return np.asarray(self.value(state) - reference, dtype=np.float64)

    def drift(self, state: State) -> Vec:
        """dJ/dt v ``(m,)``; accelerations need it."""
        raise NotImplementedError

    def hold(self, state: State) -> Reference:
        """The reference that keeps the task's value as it is at ``state``."""
        return Reference(self.name, self.value(state))

    def at(self, value: Any = None, *, velocity: Any = None, acceleration: Any = None) -> Reference:
        """The target for one tick, with velocity and acceleration feedforward; None keeps the hold value.

        Raises DeclarationError for values that are not numeric.
        """

        def array(what: str, x: Any) -> Any:
            try:
                return None if x is None else np.array(x, dtype=np.float64)
            except (TypeError, ValueError, OverflowError) as error:
                raise self.invalid(what, x, "numbers") from error

        rate, change = array("velocity", velocity), array("acceleration", acceleration)
        return Reference(
            self.name,
            array("value", value),
            None if rate is None else np.atleast_1d(rate),
            None if change is None else np.atleast_1d(change),
        )

    def _at(self, shape: tuple[int, ...], value: Any, velocity: Any, acceleration: Any) -> Reference:
        """``at`` with the shapes checked: value ``shape``, feedforwards as many numbers as its rows."""
        return Reference(
            self.name,
            None if value is None else numbers(self.name, "value", value, shape),
            None if velocity is None else numbers(self.name, "velocity", velocity, shape[:1]),
            None if acceleration is None else numbers(self.name, "acceleration", acceleration, shape[:1]),
        )


@dataclass(frozen=True, kw_only=True)
class Constraint(Element):
    """Rows that bind; in a level they are met as well as its priority allows.

    Contacts and couplings are tasks too (error, Jacobian, law); a constraint with bounds is an ``Inequality``.
    """


@dataclass(frozen=True, kw_only=True)
class Inequality(Constraint):
    """Something kept between bounds: J x is limited by a law of the distance to either bound.

    A subclass gives ``rows``, ``jacobian``, ``bounds``, and for accelerations and torques ``drift``.  With P, each row
    approaches its bound at gain times the way left, J x <= gain d, a velocity damper; with PD,
    J x <= kp d - kd J v - dJ/dt v.  max_velocity and max_acceleration hold for each row.
    """

    equality: ClassVar[bool] = False

    @abstractmethod
    def jacobian(self, state: State) -> Mat:
        """J ``(m, nv)``, or ``(nv,)`` for a single row."""

    @abstractmethod
    def bounds(self, state: State) -> tuple[ArrayLike, ArrayLike]:
        """(lower, upper), remaining distance to each bound: ``(m,)`` or a number for all rows, infinite for no bound.

        lower is negative and upper positive inside.  For an effort they bound J x itself [N m].
        """

    def step_bounds(self, state: State, dt: float, order: int) -> tuple[Vec, Vec]:
        """(lower, upper) ``(m,)`` of J x itself for one period dt [s], replacing the law of ``bounds``.

        order: 1 where x is a velocity, 2 where it is an acceleration.
        """
        raise NotImplementedError

    def bound_kinds(self, state: State, v: Vec, dt: float) -> Sequence[tuple[str, str]]:
        """Meaning of each row's (lower, upper) bound, for explanations; ``""`` if the row's name suffices.

        v: present velocity of the joints ``(nv,)``.
        """
        raise NotImplementedError

    def drift(self, state: State) -> Vec:
        """dJ/dt v ``(m,)``; accelerations need it."""
        raise NotImplementedError


def phase_names(owner: str, given: object) -> tuple[str, ...]:
    """The phases of ``when``; raises DeclarationError for an invalid name."""
    found = (given,) if isinstance(given, str) else given
    if not isinstance(found, (tuple, list)) or not all(isinstance(name, str) and name for name in found):
        raise DeclarationError(owner, "bad when", value=given, allowed="the name of a phase, or several")
    return tuple(found)


def _plain(value: Any) -> Any:
    """Numbers and nested tuples of a list or an array."""
    if isinstance(value, (np.generic, np.ndarray)):
        value = value.tolist()
    return tuple(map(_plain, value)) if isinstance(value, list) else value


def has(element: Element, function: str) -> bool:
    """Return true if a class of the element defines that function, except the base classes of this file."""
    found = getattr(type(element), function, None)
    return found is not None and getattr(found, "__module__", "") != __name__


def plan_of(element: Element, robot: Robot) -> Plan | None:
    """The plan of an element, unless a subclass of the one that gives it redefines a function of the rows."""
    return None if redefined(type(element), "plan") else element.plan(robot)


def selection_of(element: Element, robot: Robot) -> Index | None:
    """The selection of an element, unless a subclass of the one that gives it redefines ``jacobian``."""
    return None if "jacobian" in redefined(type(element), "selection") else element.selection(robot)


@cache
def redefined(cls: type[Element], name: str) -> frozenset[str]:
    """Functions of the class that defines ``name`` which a subclass of it, down to ``cls``, redefines."""
    order = cls.__mro__
    owner = next(i for i, c in enumerate(order) if name in vars(c))
    return frozenset(
        key
        for c in order[:owner]
        for key, value in vars(c).items()
        if not key.startswith("__") and key not in _APART and _is_function(value) and hasattr(order[owner], key)
    )


def _is_function(value: object) -> bool:
    return callable(value) or isinstance(value, (property, classmethod, staticmethod))
