"""Position of a point of a frame."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import ArrayLike

from hqp.arrays import Mat, Vec
from hqp.element import Block, Plan, Task, Writer
from hqp.reference import Reference
from hqp.robot import Robot, State

from .fields import check_axes, check_frame, check_observer, indices, set_vector, target
from .live import Observer, Point, live_view, moment_row
from .relative import View, skew


@dataclass(frozen=True, kw_only=True)
class Position(Task):
    """Position of the point ``offset`` of a frame: e = p - p_ref, dp/dt = (J_v - [R offset]x J_omega) v.

    frame: whose point.  axes: the coordinates controlled, k letters of "xyz"; value and reference have as many
    numbers [m], in that order.  offset: the point in the frame's axes ``(3,)`` [m].  relative_to: frame in whose
    axes, and relative to whose origin, value, error and J are; heading: only its yaw turns the axes.
    Raises DeclarationError for fields, FrameNotFound for names on binding (Mistry 2008, eq. 13; Sentis 2012, eq. 54).
    """

    frame: str
    axes: str = "xyz"
    offset: tuple[float, float, float] = (0.0, 0.0, 0.0)
    relative_to: str | None = None
    heading: bool = False

    def __post_init__(self) -> None:
        super().__post_init__()
        check_frame(self, "frame", self.frame)
        check_axes(self, self.axes)
        check_observer(self, self.relative_to, self.heading)
        set_vector(self, "offset")

    def rows(self, robot: Robot) -> int:
        """As many as axes; raises FrameNotFound."""
        robot.frame(self.frame)
        if self.relative_to is not None:
            robot.frame(self.relative_to)
        return len(self.axes)

    def value(self, state: State) -> Vec:
        """Position ``(k,)`` [m], in world axes or as ``relative_to`` sees it."""
        point: Vec = state.position(self.frame) + self._arm(state)
        if self.relative_to is not None:
            point = View(state, self.relative_to, self.heading).point(point)
        return point[indices(self.axes)]

    def jacobian(self, state: State) -> Mat:
        """J ``(k, nv)`` of the value."""
        arm = self._arm(state)
        J_frame = state.jacobian(self.frame)
        J = J_frame[:3] - skew(arm) @ J_frame[3:]
        if self.relative_to is not None:
            J = View(state, self.relative_to, self.heading).point_jacobian(state.position(self.frame) + arm, J)
        return J[indices(self.axes)]

    def drift(self, state: State) -> Vec:
        """dJ/dt v ``(k,)`` [m/s^2]."""
        drift = state.drift(self.frame)
        acceleration: Vec = drift[:3]
        if self.relative_to is not None or any(self.offset):
            arm, velocity = self._arm(state), state.velocity(self.frame)
            turning = skew(velocity[3:]) @ arm
            acceleration = acceleration + skew(drift[3:]) @ arm + skew(velocity[3:]) @ turning
            if self.relative_to is not None:
                view = View(state, self.relative_to, self.heading)
                point = state.position(self.frame) + arm
                acceleration = view.point_drift(point, velocity[:3] + turning, acceleration)
        return acceleration[indices(self.axes)]

    def _arm(self, state: State) -> Vec:
        arm: Vec = state.rotation(self.frame) @ np.array(self.offset)
        return arm

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
        """Fill twist rows [u, p x u] along the controlled axes u, or J itself for a heading."""
        point = Point(robot, self.frame, self.offset)
        view = live_view(robot, self.frame, self.relative_to, self.heading)
        out.plan = Plan("point", {**view, "axes": indices(self.axes), "offset": self.offset}, (len(self.axes),))
        if self.relative_to is None:
            return self._bind_world(point, out)
        observer = Observer(robot, self.relative_to, self.heading)
        return self._bind_heading(robot, point, observer, out) if self.heading else self._bind(point, observer, out)

    def _bind_world(self, point: Point, out: Block) -> Writer:
        twist = out.use_twist(point.support)
        flat, error, drift, second = twist.reshape(-1), out.error, out.drift, out.order == 2
        axes = indices(self.axes)
        cells = []
        for i, axis in enumerate(axes):
            twist[i, axis] = 1.0
            after, before = (axis + 1) % 3, (axis + 2) % 3  # moment of e_axis: p x e_axis
            cells += [(6 * i + 3 + after, before, 1.0), (6 * i + 3 + before, after, -1.0)]
        errors = list(enumerate(axes))

        def write(state: State, reference: Reference) -> None:
            state.kinematics()
            p = point.position()
            for cell, axis, sign in cells:
                flat[cell] = sign * p[axis]
            r = target(reference).tolist()
            for i, axis in errors:
                error[i] = p[axis] - r[i]
            if second:
                a = point.drift(state)
                for i, axis in errors:
                    drift[i] = a[axis]

        return write

    def _bind(self, point: Point, observer: Observer, out: Block) -> Writer:
        flat = out.use_twist(point.support - observer.support).reshape(-1)
        error, drift, second, selected = out.error, out.drift, out.order == 2, indices(self.axes)

        def write(state: State, reference: Reference) -> None:
            state.kinematics()
            observer.look()
            p, axes = point.position(), observer.axes
            x, y, z = observer.position
            x, y, z = p[0] - x, p[1] - y, p[2] - z
            r = target(reference).tolist()
            for i, axis in enumerate(selected):
                u = axes[axis]
                moment_row(flat, 6 * i, u, p)
                error[i] = u[0] * x + u[1] * y + u[2] * z - r[i]
            if second:
                a = observer.point_drift(state, p, point.velocity(state), point.drift(state))
                for i, axis in enumerate(selected):
                    drift[i] = a[axis]

        return write

    def _bind_heading(self, robot: Robot, point: Point, observer: Observer, out: Block) -> Writer:
        selected, error, drift, second, J = indices(self.axes), out.error, out.drift, out.order == 2, out.J
        m = len(selected)
        twist, product = np.zeros((2 * m, 6)), np.zeros((2 * m, robot.nv))
        own, carried, flat, twists = product[:m], product[m:], twist.reshape(-1), robot.joint_twists
        support = np.repeat([point.support, observer.support], m, axis=0)

        def write(state: State, reference: Reference) -> None:
            state.kinematics()
            observer.look()
            p, axes = point.position(), observer.axes
            x, y, z = observer.position
            x, y, z = p[0] - x, p[1] - y, p[2] - z
            r = target(reference).tolist()
            for i, axis in enumerate(selected):
                u = axes[axis]
                moment_row(flat, 6 * i, u, p)
                observer.carried_row(flat, 6 * (m + i), u, p)
                error[i] = u[0] * x + u[1] * y + u[2] * z - r[i]
            np.matmul(twist, twists, out=product)
            np.multiply(product, support, out=product)
            np.subtract(own, carried, out=J)
            if second:
                a = observer.point_drift(state, p, point.velocity(state), point.drift(state))
                for i, axis in enumerate(selected):
                    drift[i] = a[axis]

        return write
