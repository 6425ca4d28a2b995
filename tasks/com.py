"""Centre of mass of the robot or of a part of it."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import ArrayLike

from hqp.arrays import Mat, Vec
from hqp.element import Block, Plan, Task, Writer
from hqp.reference import Reference
from hqp.robot import Robot, State

from .fields import check_axes, check_observer, indices, target
from .live import Observer, live_observer
from .relative import View


@dataclass(frozen=True, kw_only=True)
class Com(Task):
    """Centre of mass c: e = c - c_ref, J = sum m_i J_i / sum m_i over the bodies meant.

    axes: the coordinates controlled, k letters of "xyz"; value and reference have as many numbers [m].
    subtree: name of a joint; the bodies it carries, divided by their own mass (not the robot's), the whole robot by
    default.  relative_to: frame in whose axes, and relative to whose origin, value, error and J are; heading: only
    its yaw turns the axes.  Raises DeclarationError for fields, JointNotFound or FrameNotFound on binding
    (Mistry 2008, eqs. 5, 6, 12; Sentis 2012, eqs. 45, 46, whose mass is that of the sum's own bodies).
    """

    axes: str = "xyz"
    subtree: str | None = None
    relative_to: str | None = None
    heading: bool = False

    def __post_init__(self) -> None:
        super().__post_init__()
        check_axes(self, self.axes)
        check_observer(self, self.relative_to, self.heading)
        if self.subtree is not None and (not isinstance(self.subtree, str) or not self.subtree):
            raise self.bad("subtree", self.subtree, "the name of a joint, or None for the whole robot")

    def rows(self, robot: Robot) -> int:
        """As many as axes; raises JointNotFound, FrameNotFound."""
        self._part(robot)
        if self.relative_to is not None:
            robot.frame(self.relative_to)
        return len(self.axes)

    def _part(self, robot: Robot) -> int:
        return 0 if self.subtree is None else robot.subtree(self.subtree)

    def value(self, state: State) -> Vec:
        """Centre of mass ``(k,)`` [m], in world axes or as ``relative_to`` sees it."""
        centre = state.com(self._part(state.robot))
        if self.relative_to is not None:
            centre = View(state, self.relative_to, self.heading).point(centre)
        return centre[indices(self.axes)]

    def jacobian(self, state: State) -> Mat:
        """J ``(k, nv)`` of the value."""
        part = self._part(state.robot)
        J = state.com_jacobian(part)
        if self.relative_to is not None:
            J = J.copy()
            J = View(state, self.relative_to, self.heading).point_jacobian(state.com(part), J)
        return J[indices(self.axes)]

    def drift(self, state: State) -> Vec:
        """dJ/dt v ``(k,)`` [m/s^2]."""
        part = self._part(state.robot)
        if self.relative_to is None:
            return state.com_drift(part)[indices(self.axes)]
        view, velocity = View(state, self.relative_to, self.heading), state.com_velocity(part)
        return view.point_drift(state.com(part), velocity, state.com_drift(part))[indices(self.axes)]

    def at(
        self,
        value: ArrayLike | None = None,
        *,
        velocity: ArrayLike | None = None,
        acceleration: ArrayLike | None = None,
    ) -> Reference:
        """Target ``(k,)`` [m] with velocity [m/s] and acceleration [m/s^2]; raises DeclarationError for shapes."""
        return self._at((len(self.axes),), value, velocity, acceleration)

    def bind(self, robot: Robot, out: Block) -> Writer:
        """Fill J from the robot's own Jacobian of the centre of mass."""
        view = {"observer": live_observer(robot, self.relative_to, self.heading), "part": self._part(robot)}
        out.plan = Plan("com", {**view, "axes": indices(self.axes)}, (len(self.axes),))
        if self.relative_to is not None:
            return self._bind_relative(robot, Observer(robot, self.relative_to, self.heading), out)
        part, J, error, second = self._part(robot), out.J, out.error, out.order == 2
        axes = indices(self.axes)
        picked: slice | list[int] = axes
        if axes == list(range(axes[0], axes[-1] + 1)):
            picked = slice(axes[0], axes[-1] + 1)
        errors = list(enumerate(axes))

        def write(state: State, reference: Reference) -> None:
            J[:] = state.com_jacobian(part)[picked]
            c = state.com(part).tolist()
            r = target(reference).tolist()
            for i, axis in errors:
                error[i] = c[axis] - r[i]
            if second:
                out.drift[:] = state.com_drift(part)[picked]

        return write

    def _bind_relative(self, robot: Robot, observer: Observer, out: Block) -> Writer:
        part, J, error, second = self._part(robot), out.J, out.error, out.order == 2
        selected, twists, support = indices(self.axes), robot.joint_twists, observer.support
        m = len(selected)
        directions, twist, carried = np.zeros((m, 3)), np.zeros((m, 6)), np.zeros((m, robot.nv))
        flat = twist.reshape(-1)

        def write(state: State, reference: Reference) -> None:
            J_com = state.com_jacobian(part)
            observer.look()
            c, axes = state.com(part).tolist(), observer.axes
            x, y, z = observer.position
            x, y, z = c[0] - x, c[1] - y, c[2] - z
            r = target(reference).tolist()
            for i, axis in enumerate(selected):
                u = directions[i] = axes[axis]
                observer.carried_row(flat, 6 * i, u, c)
                error[i] = u[0] * x + u[1] * y + u[2] * z - r[i]
            np.matmul(directions, J_com, out=J)
            np.matmul(twist, twists, out=carried)
            np.multiply(carried, support, out=carried)
            np.subtract(J, carried, out=J)
            if second:
                velocity, drift = (J_com @ state.v).tolist(), state.com_drift(part).tolist()
                a = observer.point_drift(state, c, velocity, drift)
                for i, axis in enumerate(selected):
                    out.drift[i] = a[axis]

        return write
