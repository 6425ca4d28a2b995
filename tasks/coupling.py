"""Linear relations between joints, such as one motor that bends two of them."""

from __future__ import annotations

import math
from collections.abc import Mapping
from dataclasses import dataclass, field

import numpy as np

from hqp.angles import nearest_turns
from hqp.arrays import Index, Mat, Vec
from hqp.declare import plans
from hqp.declare.element import Constraint, Task
from hqp.declare.reference import Given, Reference
from hqp.declare.robot import Robot, State
from hqp.numbers import number

from .fields import set_number


@dataclass(frozen=True, kw_only=True)
class JointCoupling(Task, Constraint):
    """A linear relation sum c_j q_j = offset of joints: e = c q - offset, J = c, one row.

    coefficients: by joint name, given as a mapping and kept as pairs; {"hip": 1.0, "thorax": -1.0} bends two joints
    alike (Sentis 2012, eqs. 7, 8); {"spring": 1.0} holds a joint without a motor.  offset [rad or m]: independent of
    the first state; the error is fed back, so nothing drifts.

    The angle of a continuous joint is measured up to whole turns, and a turn of one joint may be half a turn of
    another.  In the first state the turns are those with the least error, the fewest of equal ones, up to ten of a
    joint; from there a session follows each joint through its turns.  Without a session ``value`` and ``error`` take
    the turns with the least error in each state.  Raises DeclarationError for fields, JointNotFound on binding.
    """

    coefficients: Mapping[str, float] | tuple[tuple[str, float], ...] = field(kw_only=False)
    offset: float = 0.0

    def __post_init__(self) -> None:
        given = self.coefficients
        try:
            pairs = tuple((joint, value) for joint, value in (given.items() if isinstance(given, Mapping) else given))
        except (TypeError, ValueError, OverflowError):
            pairs = ()
        joints = [joint for joint, _ in pairs]
        if not pairs or not all(isinstance(j, str) and j for j in joints) or len(set(joints)) < len(joints):
            raise self.invalid("coefficients", given, '{"joint": coefficient, ...}')
        plain = tuple((joint, number(self.owner, f"coefficient of {joint}", value)) for joint, value in pairs)
        for joint, value in plain:
            if value == 0.0:
                raise self.invalid(f"coefficient of {joint}", value, "a nonzero number")
        object.__setattr__(self, "coefficients", tuple((joint, float(value)) for joint, value in plain))
        super().__post_init__()
        set_number(self, "offset")

    def default_name(self) -> str:
        """The joints, joined by underscores."""
        return "_".join(joint for joint, _ in self._pairs)

    @property
    def _pairs(self) -> tuple[tuple[str, float], ...]:
        return tuple(dict(self.coefficients).items())

    def _columns(self, robot: Robot) -> tuple[Index, Vec]:
        columns = [robot.joints(joint) for joint, _ in self._pairs]
        for (joint, _), column in zip(self._pairs, columns, strict=True):
            if column.size != 1:
                raise self.invalid("coefficients", joint, "joint names, no group names")
        return np.concatenate(columns), np.array([value for _, value in self._pairs])

    def rows(self, robot: Robot) -> int:
        """1; raises JointNotFound."""
        self._columns(robot)
        return 1

    def value(self, state: State) -> Vec:
        """sum c_j q_j ``(1,)`` [rad or m], with the turns of continuous joints that take it nearest to the offset."""
        return self.offset + self.error(state, np.array([self.offset]))

    def error(self, state: State, reference: Vec) -> Vec:
        """sum c_j q_j minus its reference ``(1,)`` [rad or m], with the least error of all turns."""
        return self.follow(state, reference, None)[0]

    def follow(self, state: State, reference: Vec, last: Vec | None) -> tuple[Vec, Vec]:
        """The error ``(1,)`` and the positions of the joints ``(k,)`` [rad or m], turns included.

        last: the positions in the state before, None to take the turns with the least error.
        """
        columns, coefficients = self._columns(state.robot)
        at = state.angles[columns]
        turning = np.flatnonzero(np.isin(columns, state.robot.continuous))
        if last is None:
            off = float(coefficients @ at - reference[0])
            at[turning] += math.tau * nearest_turns(off, coefficients[turning])
        else:
            at[turning] += math.tau * np.round((last[turning] - at[turning]) / math.tau)
        return np.atleast_1d(coefficients @ at - reference), at

    def jacobian(self, state: State) -> Mat:
        """c ``(1, nv)``."""
        columns, coefficients = self._columns(state.robot)
        J = np.zeros((1, state.robot.nv))
        J[0, columns] = coefficients
        return J

    def drift(self, state: State) -> Vec:
        """Zero, ``(1,)``."""
        return np.zeros(1)

    def hold(self, state: State) -> Reference:
        """Return the offset instead of the present value."""
        return Reference(self.name, np.array([self.offset]))

    def at(self, value: Given = None, *, velocity: Given = None, acceleration: Given = None) -> Reference:
        """Another offset ``(1,)`` for this tick, with its rates; raises DeclarationError for shapes."""
        parts = (None if x is None else np.atleast_1d(x) for x in (value, velocity, acceleration))
        return self._at((1,), *parts)

    def plan(self, robot: Robot) -> plans.Coupling | None:
        """The native operation; none for joints of several axes."""
        columns, coefficients = self._columns(robot)
        joints = plans.Joints.of(robot, columns)
        return None if joints is None else plans.Coupling(joints, tuple(coefficients.tolist()))
