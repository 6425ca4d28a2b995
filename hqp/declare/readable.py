"""Rows written by an element's readable functions: right for every element, native or not."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any

import numpy as np

from hqp.arrays import Mat, Vec
from hqp.declare.element import Element, Inequality, Task, has, redefined
from hqp.declare.reference import Reference
from hqp.declare.robot import State
from hqp.errors import DeclarationError

UP: Vec = np.array((0.0, 0.0, 1.0))
"""The ground's normal where a reference gives none."""


def ground_of(element: Element) -> Vec:
    """Normal of the ground ``(3,)`` where a reference gives none: the element's own, or the vertical."""
    return np.array(getattr(element, "normal", None) or UP)


@dataclass(eq=False)
class Views:
    """An element's part of the arrays of a stack: J ``(m, nv)``, None for a selection; the others ``(m,)``."""

    J: Mat | None
    error: Vec
    drift: Vec
    lower: Vec
    upper: Vec


class Readable:
    """Calls value, error, jacobian and drift, or jacobian, bounds and drift, and writes the results.

    order: 1 where x is a velocity, 2 where it is an acceleration.  dt: control period [s].
    Raises DeclarationError for a drift that is missing.
    """

    def __init__(self, element: Element, out: Views, order: int, dt: float) -> None:
        self._element: Any = element
        self._out, self._order, self._dt = out, order, dt
        self._final = has(element, "step_bounds")
        self._drifts = order == 2 and not self._final
        inner = getattr(element, "task", None) if self._final else None  # a Within needs the drift of its task
        if not isinstance(element, (Task, Inequality)):
            raise element.invalid(
                "has no rows on the robot's motion", type(element).__name__, "a Task or an Inequality"
            )
        needs = inner if order == 2 and isinstance(inner, Task) else element if self._drifts else None
        if needs is not None and not has(needs, "drift"):
            raise element.invalid(
                "has no drift(state), which accelerations and torques need", type(element).__name__, "drift"
            )
        self._write = self._write_task if isinstance(element, Task) and not self._final else self._write_bounds
        self._plane = Plane() if element.grounded else None
        self._follows = hasattr(element, "follow") and "error" not in redefined(type(element), "follow")
        self._last: Vec | None = None
        views = {"jacobian": out.J, "error": out.error, "drift": out.drift}
        self._shapes = {what: (v.shape, v.shape[v.shape[0] == 1 :]) for what, v in views.items() if v is not None}

    def __call__(self, state: State, reference: Reference) -> None:
        """Write the rows for a state and a reference; raises DeclarationError for shapes that do not fit."""
        normal: tuple[Vec, ...] = ()
        if self._plane is not None:
            normal = (UP if reference.normal is None else reference.normal,)
        self._write(state, reference, *normal)

    def _write_task(self, state: State, reference: Reference, *normal: Vec) -> None:
        element, out, value = self._element, self._out, reference.value
        if value is None:
            raise DeclarationError(reference.name, "a reference without a value", allowed="at(value) or the hold value")
        if self._plane is not None:
            value = self._plane.settle(value, normal[0], element.value(state))
        if self._follows:
            error, self._last = element.follow(state, value, self._last)
        else:
            error = element.error(state, value, *normal)
        self._put("error", out.error, error)
        if element.steered:
            normal = (value,)
        if out.J is not None:
            self._put("jacobian", out.J, element.jacobian(state, *normal))
        if self._drifts:
            self._put("drift", out.drift, element.drift(state, *normal))

    def _write_bounds(self, state: State, reference: Reference, *normal: Vec) -> None:
        element, out = self._element, self._out
        if element.steered and reference.value is not None:
            normal = (reference.value,)
        if self._final:
            moving = _moving(reference) if element.steered else {}
            lower, upper = element.step_bounds(state, self._dt, self._order, *normal, **moving)
        else:
            lower, upper = element.bounds(state, *normal)
        _fill(out.lower, lower)
        _fill(out.upper, upper)
        if out.J is not None:
            self._put("jacobian", out.J, element.jacobian(state, *normal))
        if self._drifts:
            self._put("drift", out.drift, element.drift(state, *normal))

    def _put(self, what: str, into: Mat, values: Any) -> None:
        """Write values of the right shape; values of a single row may lack its dimension."""
        given = values.shape if type(values) is np.ndarray else np.shape(values)  # np.shape alone costs 0.2 us
        if given not in self._shapes[what]:
            raise DeclarationError(self._element.name, f"{what} has shape {given}", allowed=f"shape {into.shape}")
        into[:] = values


def _fill(into: Vec, values: Any) -> None:
    """Write bounds; a number takes a quarter of the time that it does as an array."""
    if isinstance(values, float):
        into.fill(values)
    else:
        into[:] = values


def _moving(reference: Reference) -> dict[str, Vec]:
    """Velocity and acceleration of a reference, those it has."""
    given = {"velocity": reference.velocity, "acceleration": reference.acceleration}
    return {what: x for what, x in given.items() if x is not None}


class Plane:
    """The plane through a grounded element's reference; a change of the normal alone tilts it about the element.

    After rolling away from the reference another normal through it would put a wheel far off its plane, so the
    distance to the plane is kept.  A normal that is not finite leaves the plane as it was.
    """

    def __init__(self) -> None:
        self._value: Vec | None = None
        self._anchor: Vec = UP
        self._normal: Vec = UP

    def settle(self, value: Vec, normal: Vec, position: Vec) -> Vec:
        """A point ``(3,)`` of the plane to measure from, for the element at ``position``."""
        finite = bool(np.isfinite(normal).all())
        if self._value is None or not np.array_equal(value, self._value):
            self._value, self._anchor = value.copy(), value.copy()
        elif finite and not np.array_equal(normal, self._normal):
            self._anchor = position - (self._normal @ (position - self._anchor)) * normal
        if finite:
            self._normal = normal.copy()
        return self._anchor
