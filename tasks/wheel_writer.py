"""The rows of a wheel for the hot path, and the plane it is held on."""

from __future__ import annotations

import math

from hqp.element import Block, Plan
from hqp.reference import Reference
from hqp.robot import Robot, State

from .fields import target
from .live import Numbers, cross, live_frame, moment_row, turned
from .relative import Triple

UP: Triple = (0.0, 0.0, 1.0)
_ALIGNED = 1e-9  # below this sine an axle is along the normal


def directions(axle: Numbers, normal: Numbers) -> tuple[Triple, Triple, Triple]:
    """Rolling, lateral and normal direction of a wheel; the first two zero where the axle is along the normal."""
    x, y, z = normal
    a, b, c = cross(normal, axle)
    length = math.sqrt(a * a + b * b + c * c)
    scale = 1.0 / length if length > _ALIGNED else 0.0
    rolling = (a * scale, b * scale, c * scale)
    return rolling, cross(rolling, normal), (x, y, z)


class WheelWriter:
    """Fills a wheel's rows; remembers the plane it is on, so that a change of normal does not move the wheel's anchor.

    The plane goes through the reference value.  After rolling away from there, another normal through the same point
    would put the wheel far off its plane: where the normal changes, the anchor moves to the wheel, the error is kept.
    """

    def __init__(
        self, robot: Robot, frame: str, radius: float, axle: Triple, picked: tuple[int, ...], out: Block
    ) -> None:
        index = robot.frame(frame)
        geometry = {"radius": radius, "axle": axle, "picked": list(picked), "aligned": _ALIGNED}
        out.plan = Plan("wheel", {"frame": live_frame(robot, frame), **geometry}, (3,), ground=True)
        self._frame, self._radius, self._axle = frame, radius, axle
        self._position, self._rotation = robot.placement(index)
        self._flat = out.use_twist(robot.support(index)).reshape(-1)
        self._rows = list(enumerate(picked))
        self._error, self._drift, self._second = out.error, out.drift, out.order == 2
        self._error[:] = 0.0
        self._last = len(picked) - 1
        self._value: list[float] | None = None
        self._anchor: Numbers = UP
        self._plane: Numbers = UP

    def __call__(self, state: State, reference: Reference) -> None:
        """Write twist rows [u, (p + delta) x u], the height error and the drift."""
        state.kinematics()
        x, y, z = p = self._position.tolist()
        normal: Numbers = UP if reference.normal is None else reference.normal.tolist()
        a, b, c = normal
        self._settle(target(reference).tolist(), normal, p)
        d, e, f = self._anchor
        self._error[self._last] = a * (x - d) + b * (y - e) + c * (z - f)
        axle = turned(self._rotation.tolist(), self._axle)
        r = self._radius
        point = (x - r * a, y - r * b, z - r * c)
        along = directions(axle, normal)
        for i, k in self._rows:
            moment_row(self._flat, 6 * i, along[k], point)
        if self._second:
            self._write_drift(state, axle, normal, along)

    def _settle(self, value: list[float], normal: Numbers, p: Numbers) -> None:
        finite = math.isfinite(sum(normal))  # if not, this tick's error is NaN, but the plane stays as it was
        if value != self._value:
            self._value = self._anchor = value
        elif finite and tuple(normal) != tuple(self._plane):
            height = sum(n * (x - y) for n, x, y in zip(self._plane, p, self._anchor, strict=True))
            self._anchor = [x - height * n for x, n in zip(p, normal, strict=True)]
        if finite:
            self._plane = normal

    def _write_drift(self, state: State, axle: Triple, normal: Numbers, along: tuple[Triple, Triple, Triple]) -> None:
        vx, vy, vz, *omega = state.velocity(self._frame).tolist()
        ax, ay, az, *alpha = state.drift(self._frame).tolist()
        r = self._radius
        delta = (-r * normal[0], -r * normal[1], -r * normal[2])
        x, y, z = cross(omega, delta)
        slip = (vx + x, vy + y, vz + z)
        x, y, z = cross(alpha, delta)
        acceleration = (ax + x, ay + y, az + z)
        u = along[0]
        w = cross(normal, axle)
        turning = cross(normal, cross(omega, axle))
        scale = _dot(u, w)  # |n x a|, or zero where there is no direction
        scale = 1.0 / scale if scale > 0.0 else 0.0
        own = _dot(u, turning)
        rolling = tuple(scale * (t - own * q) for t, q in zip(turning, u, strict=True))
        rates = (rolling, cross(rolling, normal), (0.0, 0.0, 0.0))
        for i, k in self._rows:
            self._drift[i] = _dot(along[k], acceleration) + _dot(rates[k], slip)


def _dot(a: Numbers, b: Numbers) -> float:
    return a[0] * b[0] + a[1] * b[1] + a[2] * b[2]
