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

    A normal more than ``widest`` [rad] off the base's own is no ground that a wheel can stand on (an edge, a wall): its
    sample is ignored, the wheel keeps what it had, and ``ignored`` counts it.
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

    The base's tilt tells how high each wheel stands over the others.  The wheels behind stand on ground that is known,
    so that the one ahead tells what is new:  h(p) = g . p + f(d . p),  p the place in the plane from odometry, g the
    gradient under the base at the start, d the direction of travel.  Ground is taken to change along the travel only,
    whatever the robot's heading, and to go on as it began where no wheel has been.  The map starts anew, from the tilt
    at that moment, where the robot is led elsewhere by more than TURN.
    """

    CELL, SPAN = 0.01, 4
    REACH = 6.0
    SLOW, FAST, TIME_CONSTANT = 0.05, 0.15, 0.2  # [m/s], [m/s], [s]
    TURN, MET = math.radians(30.0), 0.003  # [rad], change of gradient

    def __init__(self, robot: Any, period: float) -> None:
        state = robot.state()
        self._wheels = np.array([state.position(frame) for frame in robot.landmarks["wheel_contacts"]])
        self._wheels -= state.position("base")
        self._period = period
        self._place, self._velocity = np.zeros(2), np.zeros(2)
        self._gradient: Vec | None = None
        self._along = np.zeros(2)
        self._height = np.zeros(round(2.0 * self.REACH / self.CELL))
        self._known, self._samples, self._origin = 0, 1, 0.0
        self._met = False

    def update(self, rotation: Mat, velocity: Vec) -> Mat:
        """Unit normals ``(3, 3)``, world axes, for the base's rotation and its velocity in its own axes [m/s]."""
        moving = (rotation @ velocity)[:2]
        self._place = self._place + self._period * moving
        self._velocity += self._period / self.TIME_CONSTANT * (moving - self._velocity)
        places = self._wheels @ rotation.T
        self._find_direction(rotation, self._place + places[:, :2])
        gradient = self._gradient
        assert gradient is not None
        if not self._along.any():
            return np.tile(rotation[:, 2], (3, 1))
        where = self._place + places[:, :2]
        s = where @ self._along - self._origin
        deviation = places[:, 2] - where @ gradient  # of each wheel from the first plane, but for the base's height
        cells = ((s + self.REACH) / self.CELL).astype(int)
        if cells.min() < self.SPAN or cells.max() >= self._height.size:
            return np.tile(rotation[:, 2], (3, 1))  # beyond the map
        behind = cells < self._known
        if not behind.any():
            behind[np.argmin(s)] = True
        height = float(np.mean(self._height[np.minimum(cells[behind], self._known)] - deviation[behind]))
        for i in np.argsort(s):
            if cells[i] >= self._known:
                self._learn(int(cells[i]), height + float(deviation[i]))
        slopes = np.array([self._slope(int(cell)) for cell in cells])
        normals = np.ones((3, 3))
        normals[:, :2] = -(gradient + slopes[:, None] * self._along)
        return np.asarray(normals / np.linalg.norm(normals, axis=1)[:, None])

    def _find_direction(self, rotation: Mat, where: Mat) -> None:
        """Where the robot is led; as long as it has met nothing new, or is led another way, the map starts anew."""
        speed = math.hypot(*self._velocity)
        tilt = -rotation[:2, 2] / rotation[2, 2]
        if self._gradient is None:
            self._gradient = tilt
        if speed < self.SLOW:
            return
        along = self._velocity / speed
        self._met |= self._along.any() and math.hypot(*(tilt - self._gradient)) > self.MET
        if self._met:
            if speed < self.FAST or abs(float(along @ self._along)) > math.cos(self.TURN):
                return
            self._gradient, self._met = tilt, False
        self._along = along
        self._origin = float(self._place @ along)
        self._height[:] = 0.0
        self._known = int((float((where @ along).max()) - self._origin + self.REACH) / self.CELL)
        self._samples = 1

    def _learn(self, cell: int, new: float) -> None:
        if cell > self._known:
            steps = np.arange(1, cell - self._known + 1) / (cell - self._known)
            last = self._height[self._known]
            self._height[self._known + 1 : cell + 1] = last + steps * (new - last)
            self._known, self._samples = cell, 1
        else:  # the mean of what the cell has seen
            self._samples += 1
            self._height[cell] += (new - self._height[cell]) / self._samples

    def _slope(self, cell: int) -> float:
        last = min(cell + self.SPAN // 2, self._known)
        first = last - self.SPAN
        return float(self._height[last] - self._height[first]) / (self.SPAN * self.CELL)
