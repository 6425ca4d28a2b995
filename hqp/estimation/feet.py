"""Estimation of a floating base from the sensors of a legged robot: an IMU at the base, joint encoders, and feet that
stand still."""

from __future__ import annotations

import math
from collections.abc import Sequence

import numpy as np

from hqp.angles import wrapped
from hqp.arrays import Mat, Vec
from hqp.declare.robot import Robot
from hqp.errors import DeclarationError
from hqp.estimation.rotations import about_vertical, exponential, quaternion_of, rotation_of, yaw_of


class FeetEstimator:
    """Orientation, position and velocity of the base, by complementary filters on IMU and legs.

    A foot that carries more than ``least_load`` [N] for LANDED stands where it was then, p_i in the world; all stand
    at the start.  With r_i and u_i its place and velocity relative to the base,

        dR/dt = R [gyro + (z_imu x z) / T_tilt]x,  and about the vertical the mean of the feet's yaw errors / T_yaw,
        dv/dt = R f + g + (sum w_i (-u_i) - v) / T_velocity,
        dp/dt = v + (sum w_i (p_i - r_i) - p) / T_position,

    with weights w_i of the feet's loads.  A foot whose velocity v + u_i over the ground, smoothed over SMOOTH, is more
    than SLIPS slips (``slipping``): it counts for nothing until it rests again, where it then stands, or for LOST at
    most.  The IMU's yaw is not used: it is not observable.  Without a foot on the ground the IMU alone goes on.

    robot: with a free base; the estimator has a copy of its own.  feet: frames of the soles.  period: between updates
    [s].  q: the configuration at the start ``(nq,)``, which defines the world.  Time constants [s].
    Raises DeclarationError for a robot with a fixed base or a constant that is not positive, FrameNotFound.
    """

    LANDED = 0.02
    """For how long a foot has to carry its load before it counts as standing, or to lack it before it does not [s]."""

    FAINT = 1e-3
    """Weight of a foot that still counts as standing and carries next to nothing [N]."""

    SLIPS, SMOOTH, LOST = 0.08, 0.02, 0.5
    """Velocity over the ground above which a foot that bears load slips [m/s], smoothed over [s], for at most [s]."""

    def __init__(
        self,
        robot: Robot,
        feet: Sequence[str],
        period: float,
        q: Vec,
        *,
        least_load: float = 30.0,
        tilt: float = 0.1,
        yaw: float = 0.5,
        velocity: float = 0.03,
        position: float = 0.03,
    ) -> None:
        if not robot.floating:
            raise DeclarationError("estimator", f"{robot.name} has a fixed base", allowed="a free base")
        constants = {"period": period, "tilt": tilt, "yaw": yaw, "velocity": velocity, "position": position}
        for name, value in constants.items():
            if not (math.isfinite(value) and value > 0.0):
                raise DeclarationError("estimator", f"bad {name}", value=value, unit="s", allowed="positive")
        self._robot, self._gravity = robot.copy(), robot.gravity
        self._feet, self._period, self._least_load = tuple(feet), period, least_load
        self._tilt, self._yaw, self._velocity, self._position = (period / c for c in (tilt, yaw, velocity, position))
        state = self._robot.state(q)
        self._base = rotation_of(q[3:7])
        self._p, self._v = np.array(q[:3], dtype=np.float64), np.zeros(3)
        self._anchor = np.array([state.position(frame) for frame in self._feet])
        self._anchor_yaw = [yaw_of(state.rotation(frame)) for frame in self._feet]
        self._stands, self._contrary = [True] * len(self._feet), [0.0] * len(self._feet)
        self._over_ground, self._slipped = [(0.0, 0.0)] * len(self._feet), [0.0] * len(self._feet)

    @property
    def slipping(self) -> tuple[bool, ...]:
        """Flags of the feet that bear load and slip."""
        return tuple(since > 0.0 for since in self._slipped)

    def update(self, q: Vec, v: Vec, specific_force: Vec, load: Vec) -> tuple[Vec, Vec]:
        """Return (q, v) with the estimated base, from measurements.

        q, v: joints from the encoders, the base's orientation and its angular velocity in its own axes from the IMU;
        their position and linear velocity of the base are not read.  specific_force: reading of the accelerometer, in
        the base's axes, at its origin ``(3,)`` [m/s^2].  load: normal force at each foot ``(feet,)`` [N].
        """
        dt, gyro = self._period, v[3:6]
        measured = rotation_of(q[3:7])
        (a, b, c), (x, y, z) = measured[2].tolist(), self._base[2].tolist()  # the vertical in the base's axes
        correction = np.array([b * z - c * y, c * x - a * z, a * y - b * x])
        R = self._base @ exponential(dt * gyro + self._tilt * correction)
        found_q, found_v = np.array(q, dtype=np.float64), np.array(v, dtype=np.float64)
        found_q[:3], found_v[:3] = 0.0, 0.0
        found_q[3:7] = quaternion_of(R)
        state = self._robot.state(found_q, found_v)
        places = np.array([state.position(frame) for frame in self._feet])
        rates = np.array([state.velocity(frame)[:3] for frame in self._feet])
        yaws = [yaw_of(state.rotation(frame)) for frame in self._feet]
        self._v = self._v + dt * (R @ specific_force + self._gravity)
        self._p = self._p + dt * self._v
        shares = self._hold(self._stand(load, places, yaws), rates, places, yaws)
        if any(shares):
            terms = zip(shares, self._anchor_yaw, yaws, strict=True)
            R = about_vertical(self._yaw * sum(w * wrapped(a - b) for w, a, b in terms)) @ R
            weight = np.array(shares)
            self._v += self._velocity * (-(weight @ rates) - self._v)
            self._p += self._position * (weight @ (self._anchor - places) - self._p)
        self._base = R
        found_q[:3], found_q[3:7] = self._p, quaternion_of(R)
        found_v[:3] = R.T @ self._v
        return found_q, found_v

    def _stand(self, load: Vec, places: Mat, yaws: Sequence[float]) -> list[float]:
        """Weights of the feet that stand; one that has just landed gets its place."""
        weight = [0.0] * len(self._feet)
        for i, carried in enumerate(load.tolist()):
            loaded = carried > self._least_load  # NaN is no load
            self._contrary[i] = 0.0 if loaded == self._stands[i] else self._contrary[i] + self._period
            if self._contrary[i] >= self.LANDED:
                self._stands[i], self._contrary[i] = loaded, 0.0
                self._anchor[i], self._anchor_yaw[i] = self._p + places[i], yaws[i]
            if self._stands[i]:
                weight[i] = max(carried - self._least_load, self.FAINT) if loaded else self.FAINT
        return _shares(weight)

    def _hold(self, weight: Sequence[float], rates: Mat, places: Mat, yaws: Sequence[float]) -> list[float]:
        """Weights without the feet that slip; the fastest is found first, one in an update: it pulls at the others."""
        follow, speed = min(self._period / self.SMOOTH, 1.0), [0.0] * len(weight)
        for i, (u, v, _) in enumerate((self._v + rates).tolist()):
            x, y = self._over_ground[i]
            x, y = (x + follow * (u - x), y + follow * (v - y)) if weight[i] > 0.0 else (0.0, 0.0)
            self._over_ground[i], speed[i], since = (x, y), math.hypot(x, y), self._slipped[i]
            if since > 0.0:
                rests = speed[i] < 0.5 * self.SLIPS or since >= self.LOST
                self._slipped[i] = since + self._period if weight[i] > 0.0 and not rests else 0.0
                if weight[i] > 0.0 and rests:
                    self._anchor[i], self._anchor_yaw[i] = self._p + places[i], yaws[i]
        fastest = max(range(len(speed)), key=lambda i: 0.0 if self._slipped[i] else speed[i])
        if speed[fastest] > self.SLIPS and not self._slipped[fastest]:
            self._slipped[fastest] = self._period
        return _shares([0.0 if slips else w for w, slips in zip(weight, self.slipping, strict=True)])


def _shares(weight: list[float]) -> list[float]:
    """Scale the weights to the sum 1, unless all are zero."""
    total = sum(weight)
    return [w / total for w in weight] if total > 0.0 else weight
