"""Bounds on the value of any task: a hand within a box, a momentum under a limit."""

from __future__ import annotations

import math
from dataclasses import dataclass, field, replace
from typing import Any, ClassVar
from weakref import WeakKeyDictionary

import numpy as np

from hqp.arrays import Index, Mat, Vec
from hqp.declare import plans
from hqp.declare.element import Task, has, plan_of, selection_of
from hqp.declare.reference import Reference
from hqp.declare.robot import Robot, State

from .barrier import _Barrier
from .motion import _RateTask
from .turns import rate_map, rate_map_change


@dataclass(frozen=True, kw_only=True)
class Within(_Barrier):
    """Bounds on the value of a task: lower <= value - reference <= upper, ``(m,)`` or a number for all rows.

    The reference is zero, so that bounds are on the value itself, in its units; ``at`` carries them along, with a
    velocity and an acceleration where they move.  J and drift are the task's; angles are wrapped as the task wraps
    them.  None is no bound.  With a task of momentum or velocity the bounds are on J v: lower <= J x <= upper, where x
    is an acceleration rate (lower - J v) <= J x + dJ/dt v <= rate (upper - J v).  A rotation (Pose, a full Orientation)
    is bounded by its rotation vector from the reference, which is its value at the first tick or in ``at``; J is then
    the rate of that vector, at every angle.  AlignAxis and LookAt are refused: ``Cone`` bounds directions.

    rate [1/s], recovery [m/s or rad/s], acceleration [m/s^2 or rad/s^2]: u <= rate h inside and a return at most as
    fast as recovery outside, which sets in at the acceleration, rate * recovery by default; for accelerations with
    poles at the rate and at four times the rate.  In ``subject_to`` it binds, as a member of a level it is met as well
    as its priority allows.  A half-space is ``Within(Position(..., axes="x"), upper=...)``.  Raises DeclarationError
    for fields, for bounds of another number than rows, and for a task it cannot bound.
    """

    steered: ClassVar[bool] = True

    task: Task = field(kw_only=False)
    lower: Any = None
    upper: Any = None

    def __post_init__(self) -> None:
        if not isinstance(self.task, Task) or self.task.grounded or has(self.task, "step_bounds"):
            raise self.invalid("task", self.task, "a task with a value, such as Position(frame=...)")
        super().__post_init__()
        for what in ("lower", "upper"):
            self._set_bound(what)
        if self.lower is None and self.upper is None:
            raise self.invalid("bounds", None, "lower, upper or both")
        if self.lower is not None and self.upper is not None:
            low, high = np.atleast_1d(self.lower), np.atleast_1d(self.upper)
            if (low.size == high.size or 1 in (low.size, high.size)) and np.any(low > high):
                raise self.invalid("lower", self.lower, f"at most upper, {self.upper}")

    def _set_bound(self, what: str) -> None:
        value = getattr(self, what)
        if value is None:
            return
        try:
            numbers = () if np.iscomplexobj(value) else tuple(float(x) for x in np.atleast_1d(value))
        except (TypeError, ValueError, OverflowError):
            numbers = (math.nan,)
        if not numbers or any(map(math.isnan, numbers)):
            raise self.invalid(what, value, "a number or a sequence of numbers")
        object.__setattr__(self, what, numbers[0] if len(numbers) == 1 else numbers)

    def default_name(self) -> str:
        """The task's name and ``_within``."""
        return f"{self.task.name}_within"

    def rows(self, robot: Robot) -> int:
        """Number of rows of the task; raises DeclarationError for a misfit of bounds or of the task."""
        m = self.task.rows(robot)
        if self.task.rotation_rows is None and not _has_vector(self.task, robot, m):
            allowed = "a task whose value is a vector or a rotation; Cone bounds directions"
            raise self.invalid("task", self.task.name, allowed)
        low, high = self.ends(m)
        if low.shape != (m,) or high.shape != (m,):
            raise self.invalid("bounds", (self.lower, self.upper), f"one number, or {m} numbers")
        if np.any(low > high):
            raise self.invalid("lower", self.lower, f"at most upper, {self.upper}")
        return m

    def selection(self, robot: Robot) -> Index | None:
        """The task's."""
        return selection_of(self.task, robot)

    def ends(self, m: int) -> tuple[Vec, Vec]:
        """(lower, upper) ``(m,)``, infinite if unbounded."""
        given = (-math.inf if self.lower is None else self.lower), (math.inf if self.upper is None else self.upper)
        low, high = (np.full(m, x) if np.size(x) == 1 else np.array(x, dtype=np.float64) for x in given)
        return low, high

    def hold(self, state: State) -> Reference:
        """Zero ``(m,)``: bounds are on the value itself; for a rotation, its value at ``state``."""
        if self.task.rotation_rows is not None:
            return replace(self.task.hold(state), name=self.name)
        return Reference(self.name, np.zeros(self.task.rows(state.robot)))

    def at(self, value: Any = None, *, velocity: Any = None, acceleration: Any = None) -> Reference:
        """Origin of the bounds, with velocity and acceleration, like ``at`` of the task; raises DeclarationError.

        Bounds that move at u towards the value without a velocity given are passed by at most u / rate.
        """
        return replace(self.task.at(value, velocity=velocity, acceleration=acceleration), name=self.name)

    def bounds(self, state: State, reference: Any = None) -> tuple[Vec, Vec]:
        """(lower - e, upper - e) ``(m,)``, e = value - reference; lower and upper where the task is a velocity."""
        low, high = self.ends(self.task.rows(state.robot))
        if isinstance(self.task, _RateTask):
            return low, high
        e = self.task.error(state, self.hold(state).value if reference is None else reference)
        return low - e, high - e

    def step_bounds(
        self, state: State, dt: float, order: int, *steer: Any, velocity: Any = None, acceleration: Any = None
    ) -> tuple[Vec, Vec]:
        """(lower, upper) ``(m,)`` of J x; velocity, acceleration: motion of the reference."""
        if not isinstance(self.task, _RateTask):
            return super().step_bounds(state, dt, order, *steer, velocity=velocity, acceleration=acceleration)
        u, a = self.carried(state, velocity, acceleration)
        low, high = (u + end for end in self.ends(self.task.rows(state.robot)))
        if order == 1:
            return low, high
        speed, a = self.jacobian(state) @ state.v, a - self.drift(state)
        return a + self.rate * (low - speed), a + self.rate * (high - speed)

    def carried(self, state: State, velocity: Any, acceleration: Any, *steer: Any) -> tuple[Any, Any]:
        """Velocity and acceleration ``(m,)`` of the bounds; for a rotation vector e with rate B(e) omega, they are
        B(-e) omega_ref and its derivative, with the part of a moving reference in dB/dt omega.
        """
        u, a = super().carried(state, velocity, acceleration)
        k = self.task.rotation_rows
        if k is None or (velocity is None and acceleration is None):
            return u, a
        m = self.task.rows(state.robot)
        u, a = np.full(m, u), np.full(m, a)
        turn, omega, part = self._turn(state, steer[0] if steer else None, k), self._omega(state, k), slice(k, k + 3)
        back, wanted = rate_map(-turn), u[part].copy()
        u[part] = back @ wanted
        rate = rate_map(turn) @ omega - u[part]
        a[part] = back @ a[part] - rate_map_change(-turn, rate) @ wanted + rate_map_change(turn, u[part]) @ omega
        return u, a

    def _omega(self, state: State, k: int) -> Vec:
        return np.asarray(self.task.jacobian(state)[k : k + 3] @ state.v)

    def jacobian(self, state: State, reference: Any = None) -> Mat:
        """The task's J ``(m, nv)``, of a rotation vector with its rate."""
        J, k = self.task.jacobian(state), self.task.rotation_rows
        if k is None:
            return J
        J, turn = np.array(J), self._turn(state, reference, k)
        J[k : k + 3] = rate_map(turn) @ J[k : k + 3]
        return J

    def drift(self, state: State, reference: Any = None) -> Vec:
        """dJ/dt v ``(m,)``."""
        drift, k = self.task.drift(state), self.task.rotation_rows
        if k is None:
            return drift
        drift, turn = np.array(drift), self._turn(state, reference, k)
        omega, B = self._omega(state, k), rate_map(turn)
        drift[k : k + 3] = B @ drift[k : k + 3] + rate_map_change(turn, B @ omega) @ omega
        return drift

    def _turn(self, state: State, reference: Any, k: int) -> Vec:
        """The rotation vector from the reference ``(3,)`` [rad]."""
        held = self.hold(state).value if reference is None else reference
        return self.task.error(state, held)[k : k + 3]

    def row_names(self, robot: Robot) -> tuple[str, ...]:
        """The task's."""
        return self.task.row_names(robot)

    def plan(self, robot: Robot) -> plans.Within | None:
        """The native operation, where the task has one."""
        task = plan_of(self.task, robot)
        if task is None:
            return None
        low, high = (tuple(x.tolist()) for x in self.ends(self.task.rows(robot)))
        turn, rates = self.task.rotation_rows, isinstance(self.task, _RateTask)
        turn = -1 if turn is None else turn
        return plans.Within(task, low, high, self.rate, self.recovery, self.outset, rates, turn)


_VECTORS: WeakKeyDictionary[Robot, dict[Task, bool]] = WeakKeyDictionary()


def _has_vector(task: Task, robot: Robot, m: int) -> bool:
    """Return true if the value of a task is a vector ``(m,)``, determined once per robot."""
    known = _VECTORS.setdefault(robot, {})
    if task not in known:
        known[task] = not task.steered and np.shape(task.value(robot.copy().state())) == (m,)
    return known[task]
