"""What a wheeled robot knows of the ground and of its own motion: contact normals, a map of its own, odometry."""

from __future__ import annotations

import math
from typing import Any

import numpy as np

from hqp.arrays import Mat, Vec
from hqp.robots.on_mujoco import Contacts

UP = np.array([0.0, 0.0, 1.0])


class ContactNormals:
    """Ground normal under each wheel from its contact force, n ~ lowpass(load normal) + least_load up.

    Load is the weight: a wheel that strikes the flat at the foot of a slope tells so at once, and one that carries
    nothing turns upright, for it has no slope to hold.  With unweighted normals and 30 ms the wheels on the flat go on
    holding the slope for a moment; that tips the robot back, and a wheel in the air keeps it so.
    time_constant [s], least_load [N].  In simulation this is a privileged signal; on hardware it takes load cells at
    the wheels, or a map of the terrain.
    """

    def __init__(self, wheels: int, period: float, time_constant: float = 0.01, least_load: float = 10.0) -> None:
        self._share = 1.0 - math.exp(-period / time_constant)
        self._upright = least_load * UP
        self._force = np.zeros((wheels, 3))

    def update(self, contacts: Contacts) -> Mat:
        """Unit normals ``(wheels, 3)``, world axes."""
        self._force += self._share * (contacts.load[:, None] * contacts.normal - self._force)
        normals = self._force + self._upright
        lengths = [math.hypot(*normal) for normal in normals.tolist()]
        return np.asarray(normals / np.array(lengths)[:, None])


class Heading:
    """Where to face: where the base is led, at most at ``rate`` [rad/s]; backwards and slowly, where it faces."""

    GAIN, LEAST, FORWARD, TIME_CONSTANT = 1.0, 0.1, math.radians(100.0), 0.3  # [1/s], [m/s], [rad], [s]

    def __init__(self, yaw: float, rate: float, period: float) -> None:
        self.yaw, self._rate, self._period = yaw, rate, period
        self._velocity = 0.0, 0.0

    def update(self, velocity: Vec) -> float:
        """Turn for a velocity of the base in the world ``(2,)`` [m/s]; the rate of the heading ``yaw`` [rad/s]."""
        share = self._period / self.TIME_CONSTANT
        (x, y), (led_x, led_y) = self._velocity, velocity.tolist()
        x, y = self._velocity = x + share * (led_x - x), y + share * (led_y - y)
        off = math.remainder(math.atan2(y, x) - self.yaw, 2.0 * math.pi)
        if math.hypot(x, y) < self.LEAST or abs(off) > self.FORWARD:
            return 0.0
        rate = max(-self._rate, min(self._rate, self.GAIN * off))
        self.yaw += self._period * rate
        return rate


class Odometry:
    """Linear velocity of an omnidirectional base from its wheel rates and gyro, assuming that nothing slips.

    Each wheel's rim moves over the ground at r qd = rim . (v + omega x p), rim = axle x z.
    """

    def __init__(self, robot: Any) -> None:
        state = robot.state()
        names = tuple(robot.wheels)
        contacts = [state.position(frame) for frame in robot.landmarks["wheel_contacts"]]
        rims = [np.cross(robot.wheels[name].axle, UP) for name in names]
        self._rims = np.array(rims)
        self._rolled = np.zeros((len(names), robot.nv))  # r qd less the part of the yaw rate
        self._rolled[:, 5] = [-np.cross(p, rim)[2] for p, rim in zip(contacts, rims, strict=True)]
        self._rolled[range(len(names)), robot.joints("wheels")] = [robot.wheels[name].radius for name in names]
        self._velocity = np.zeros((3, robot.nv))
        self._velocity[:2] = np.linalg.pinv(self._rims[:, :2]) @ self._rolled

    def velocity(self, v: Vec) -> Vec:
        """(v_x, v_y, 0) in the base ``(3,)`` [m/s], from the wheel rates and the yaw rate in v ``(nv,)``."""
        return np.asarray(self._velocity @ v)

    def slip(self, v: Vec) -> Vec:
        """Speed of each wheel's rim over the ground along its rolling direction, from the true v, ``(wheels,)`` [m/s].

        Neglects what the turning about x and y does at the contact points, which lie near their plane.
        """
        return np.asarray(self._rims @ v[:3] - self._rolled @ v)


class HeightMap:
    """Ground normals under the wheels from the IMU and the wheels' own turning: no force sensor, no map given.

    The base's tilt theta says how much higher the front wheel stands than the rear ones, and that ground was driven
    over by the front wheel before:  h(x + front) = h(x - rear) + (front + rear) sin(theta), x from odometry.  The
    slope under a wheel is the difference of h over a few centimetres.  One dimension, along the heading; ground that
    no wheel has touched is taken to go on as it began.
    """

    CELL, SPAN = 0.01, 4
    FRONT, REAR, REACH = 0.24, 0.12, 6.0

    def __init__(self, period: float) -> None:
        self._period, self._x = period, 0.0
        count = round(2.0 * self.REACH / self.CELL)
        self._height = np.full(count, np.nan)
        self._known, self._samples = 0, 1

    def update(self, rotation: Mat, velocity: Vec) -> Mat:
        """Unit normals ``(3, 3)``, world axes, for the base's rotation and its velocity in its own axes [m/s]."""
        tilt = math.asin(min(max(rotation[2, 0], -1.0), 1.0))
        if not self._known:
            self._known = self._cell(self.FRONT)
            places = (np.arange(self._known + 1) + 0.5) * self.CELL - self.REACH
            self._height[: self._known + 1] = math.tan(tilt) * places
        self._x += self._period * float(velocity[0])
        ahead = self._cell(self._x + self.FRONT)
        if ahead >= self._known:
            behind = self._height[self._cell(self._x - self.REAR)]
            new = behind + (self.FRONT + self.REAR) * math.sin(tilt)
            if ahead > self._known:
                steps = np.arange(1, ahead - self._known + 1) / (ahead - self._known)
                last = self._height[self._known]
                self._height[self._known + 1 : ahead + 1] = last + steps * (new - last)
                self._known, self._samples = ahead, 1
            else:  # the mean of what the cell has seen
                self._samples += 1
                self._height[ahead] += (new - self._height[ahead]) / self._samples
        front, rear = self._normal(self.FRONT, rotation), self._normal(-self.REAR, rotation)
        return np.array([front, rear, rear])

    def _cell(self, x: float) -> int:
        return int((x + self.REACH) / self.CELL)

    def _normal(self, offset: float, rotation: Mat) -> Vec:
        last = min(self._cell(self._x + offset) + self.SPAN // 2, self._known)
        first = last - self.SPAN
        slope = math.atan((self._height[last] - self._height[first]) / (self.SPAN * self.CELL))
        c, s = rotation[0, 0], rotation[1, 0]
        length = math.hypot(c, s)
        return np.array([-math.sin(slope) * c / length, -math.sin(slope) * s / length, math.cos(slope)])
