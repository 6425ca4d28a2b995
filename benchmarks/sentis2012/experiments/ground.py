"""Estimates of a wheeled robot: contact normals, push of the ground, odometry."""

from __future__ import annotations

import math
from collections.abc import Sequence
from typing import Any

import numpy as np

from hqp.arrays import Mat, Vec
from hqp.declare.reference import Reference
from hqp.robots.on_mujoco import Contacts
from hqp.tasks import ExternalWrench

UP = np.array([0.0, 0.0, 1.0])

GROUND_PUSH = "ground_push"
"""Name of the wrench at the base in a stack that resists it."""


class ContactNormals:
    """Ground normal under each wheel from its contact force, n ~ lowpass(load normal) + least_load up.

    The load is the weight of the average: a wheel that strikes the flat at the foot of a slope changes its normal at
    once, and the normal of an unloaded wheel turns upright.  With unweighted normals and 30 ms, wheels on the flat
    would hold the slope for a moment, which tips the robot back, and a wheel in the air would keep its normal.
    time_constant [s], least_load [N].  In simulation this is a privileged signal; hardware needs load cells at the
    wheels or a map of the terrain.

    A wheel cannot stand on ground whose normal is more than ``widest`` [rad] off the base's (an edge, a wall): the
    filter ignores such samples, and ``ignored`` counts them.
    """

    def __init__(
        self,
        wheels: int,
        period: float,
        time_constant: float = 0.01,
        least_load: float = 10.0,
        widest: float = math.radians(25.0),
    ) -> None:
        self._share = 1.0 - math.exp(-period / time_constant)
        self._upright = least_load * UP
        self._force = np.zeros((wheels, 3))
        self._least_cosine = math.cos(widest)
        self.ignored = 0

    def update(self, contacts: Contacts, base: Vec = UP) -> Mat:
        """Unit normals ``(wheels, 3)``, world axes, for a base whose own normal is ``base`` ``(3,)``."""
        change = self._share * (contacts.load[:, None] * contacts.normal - self._force)
        odd = (contacts.load > 0.0) & (contacts.normal @ base < self._least_cosine)
        if odd.any():
            change[odd] = 0.0
            self.ignored += int(np.count_nonzero(odd))
        self._force += change
        normals = self._force + self._upright
        lengths = [[math.hypot(*normal)] for normal in normals.tolist()]
        return np.asarray(normals / lengths)


class Heading:
    """Desired heading: towards the base's velocity, at most at ``rate`` [rad/s]; fixed if it moves back or slowly.

    gain [1/s]; least: speed below which the heading is fixed [m/s]; time_constant: low-pass of the velocity [s].
    """

    FORWARD = math.radians(100.0)

    def __init__(
        self,
        yaw: float,
        rate: float,
        period: float,
        *,
        gain: float = 1.0,
        least: float = 0.1,
        time_constant: float = 0.3,
    ) -> None:
        self.yaw, self._rate, self._period = yaw, rate, period
        self._gain, self._least, self._time_constant = gain, least, time_constant
        self._velocity = 0.0, 0.0

    def update(self, velocity: Vec) -> float:
        """Turn for a velocity of the base in the world ``(2,)`` [m/s]; the rate of the heading ``yaw`` [rad/s]."""
        share = self._period / self._time_constant
        (x, y), (led_x, led_y) = self._velocity, velocity.tolist()
        x, y = self._velocity = x + share * (led_x - x), y + share * (led_y - y)
        off = math.remainder(math.atan2(y, x) - self.yaw, 2.0 * math.pi)
        if math.hypot(x, y) < self._least or abs(off) > self.FORWARD:
            return 0.0
        rate = max(-self._rate, min(self._rate, self._gain * off))
        self.yaw += self._period * rate
        return rate


class Odometry:
    """Linear velocity of an omnidirectional base from its wheel rates and gyro.

    Each wheel's rim moves over the ground at r qd = rim . (v + omega x p), rim = axle x z: with the gyro's yaw rate,
    three equations for two unknowns.  If they contradict each other by more than APART, one wheel slips or spins in
    the air; the estimate then takes the two wheels that agree best with the previous velocity, if any two do.  With an
    accelerometer, it takes all three wheels if they agree with each other and with it; else it integrates the
    accelerometer, corrected by loaded wheels that agree with it.
    """

    APART = 0.05
    """Contradiction between the wheels beyond which one of them slips [m/s]."""
    SUDDEN = 0.1
    """Change of velocity in one tick above which wheels are rejected: pairs, and each beside an accelerometer [m/s]."""
    CORRECTED = 0.1
    """Share of a wheel's deviation from the accelerometer that a tick corrects."""

    def __init__(self, robot: Any) -> None:
        state = robot.state()
        names = tuple(robot.wheels)
        contacts = [state.position(frame) for frame in robot.landmarks["wheel_contacts"]]
        rims = [np.cross(robot.wheels[name].axle, UP) for name in names]
        self._rims = np.array(rims)
        self._rolled = np.zeros((len(names), robot.nv))  # r qd less the part of the yaw rate
        self._rolled[:, 5] = [-np.cross(p, rim)[2] for p, rim in zip(contacts, rims, strict=True)]
        self._rolled[range(len(names)), robot.joints("wheels")] = [robot.wheels[name].radius for name in names]
        self._velocity = self._of(range(len(names)), robot.nv)
        self._apart = self._rims @ self._velocity - self._rolled
        self._without = [self._of([k for k in range(len(names)) if k != i], robot.nv) for i in range(len(names))]
        self._last = np.zeros(3)
        self.contradiction = 0.0
        """Contradiction between the wheels at the latest tick [m/s]."""

    def _of(self, wheels: Sequence[int], nv: int) -> Mat:
        """Matrix from v to (v_x, v_y, 0) by some of the wheels ``(3, nv)``."""
        found = np.zeros((3, nv))
        found[:2] = np.linalg.pinv(self._rims[list(wheels), :2]) @ self._rolled[list(wheels)]
        return found

    def velocity(self, v: Vec, gained: Vec | None = None, bearing: Sequence[bool] = ()) -> Vec:
        """(v_x, v_y, 0) in the base ``(3,)`` [m/s] at a tick, from the wheel rates and the yaw rate in v ``(nv,)``.

        gained: change by the accelerometer since the last tick, in the base ``(3,)`` [m/s]; bearing: true for loaded
        wheels.
        """
        found, last = self._velocity @ v, self._last
        self.contradiction = max(map(abs, (self._apart @ v).tolist()))
        if gained is not None:
            carried = np.array([*(last + gained)[:2], 0.0])
            agree = self.contradiction < self.APART and math.hypot(*(found - carried)) < self.APART
            if not (agree and all(bearing)):
                found, off = carried, self._rolled @ v - self._rims @ carried
                for bears, apart, rim in zip(bearing, off, self._rims, strict=True):
                    if bears and abs(apart) < self.SUDDEN:
                        found = found + self.CORRECTED * apart * rim
        elif self.contradiction > self.APART:
            found = min((two @ v for two in self._without), key=lambda u: float((u - last) @ (u - last)))
            if math.hypot(*(found - last)) > self.SUDDEN:
                found = last.copy()
        self._last = found
        return found.copy()

    def spinning(self, v: Vec) -> Vec:
        """Speed of each rim beyond rolling at the latest velocity, ``(wheels,)`` [m/s]."""
        return np.asarray(self._rolled @ v - self._rims @ self._last)

    def slip(self, v: Vec) -> Vec:
        """Speed of each wheel's rim over the ground along its rolling direction, from the true v, ``(wheels,)`` [m/s].

        Neglects rotation about x and y at the contact points, which lie near their plane.
        """
        return np.asarray(self._rims @ v[:3] - self._rolled @ v)


class GroundForce:
    """Horizontal force on the wheels from ground outside the base's plane.

    A momentum observer's rows of the base contain all external forces, the rows of the wheels each wheel's traction:
    a rim that the ground holds back by f turns its wheel with -r f.  Without traction and the hand's force, the rest
    comes from normals off the base's own, sum N_i (n_i - n_base): along the fall line in any direction of travel, as
    soon as a wheel bears on a slope.  If the controller resists it like gravity, it equals the addition of the
    wheels' own normals to the gravity compensation, without a map or a force sensor.
    element: the stack's wrench for this force, None for a controller that does not resist it.
    time_constant: low-pass [s].  most: largest force to resist [N].  While the wheels contradict each other by more
    than SPINNING, or one is released or bears less than UNLOADED, the force decays to ``tilted`` newtons times the
    sine of the base's tilt: a wheel without load would look like a slope.  The base's rows also give the load of each
    wheel without load cells: the normal force and the two moments in the base's plane determine three loads.
    """

    SPINNING = 0.1
    """Contradiction (``Odometry.contradiction``) beyond which a wheel spins; at edges wheels slip by less [m/s]."""
    UNLOADED = 10.0
    """Load below which a wheel counts as unloaded [N]."""

    def __init__(
        self,
        robot: Any,
        element: ExternalWrench | None,
        period: float,
        time_constant: float = 0.05,
        most: float = 150.0,
        tilted: float = 0.0,
    ) -> None:
        names = tuple(robot.wheels)
        rims = np.array([np.cross(robot.wheels[name].axle, UP)[:2] for name in names])
        self._wheels = robot.joints("wheels")
        self._traction = rims.T / np.array([robot.wheels[name].radius for name in names])
        self._share, self._most, self._tilted = period / time_constant, most, tilted
        self._element = element
        state = robot.state()
        places = [state.position(frame) - state.position("base") for frame in robot.landmarks["wheel_contacts"]]
        self._bearing = np.linalg.inv([[1.0, p[1], -p[0]] for p in places]).T
        self.force: Vec = np.zeros(2)
        """Force in the plane, world axes ``(2,)`` [N]."""
        self.loads: Vec = np.zeros(len(names))
        """Load of each wheel, normal to the base's plane ``(wheels,)`` [N]."""

    def update(
        self, residual: Vec, rotation: Mat, hand: Vec, place: Vec, contradiction: float = 0.0, released: bool = False
    ) -> Vec:
        """The force after a tick ``(2,)`` [N].

        residual: of a MomentumObserver ``(nv,)``.  rotation: of the base ``(3, 3)``.  hand: force on it [N]; place:
        of the hand from the base [m]; both ``(3,)``, world axes.  contradiction: between the wheels [m/s].
        released: true if any wheel is released.
        """
        pull, turn = rotation.T @ hand, rotation.T @ np.cross(place, hand)
        self.loads = self._bearing @ np.array([residual[2] - pull[2], residual[3] - turn[0], residual[4] - turn[1]])
        lost = contradiction > self.SPINNING or self.loads.min() < self.UNLOADED or released
        if lost and not self._tilted:
            self.force = (1.0 - self._share) * self.force
            return self.force
        here = rotation[:2, :2] @ (residual[:2] - pull[:2] + self._traction @ residual[self._wheels])
        if lost:
            explained = self._tilted * math.hypot(rotation[0, 2], rotation[1, 2])
            here = min(1.0, explained / max(math.hypot(*here), 1e-300)) * here
        self.force = self.force + self._share * (here - self.force)
        return self.force

    def references(self) -> list[Reference]:
        """References of the controller: the force at the base's frame, which lies on the ground."""
        if self._element is None:
            return []
        x, y = self.force.tolist()
        share = min(1.0, self._most / max(math.hypot(x, y), 1e-300))
        return [self._element.at((share * x, share * y, 0.0, 0.0, 0.0, 0.0))]
