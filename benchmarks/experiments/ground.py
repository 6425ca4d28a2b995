"""What a wheeled robot knows of the ground and of its own motion: filtered contact normals, odometry."""

from __future__ import annotations

import math
from typing import Any

import numpy as np

from hqp.arrays import Mat, Vec
from hqp.robots.on_mujoco import Contacts

UP = np.array([0.0, 0.0, 1.0])


class ContactNormals:
    """Ground normal under each wheel from its contact force, low-passed; an unloaded wheel keeps its last one.

    In simulation this is a privileged signal; on hardware it takes load cells at the wheels, or a map of the terrain.
    """

    def __init__(self, wheels: int, period: float, time_constant: float = 0.03, least_load: float = 1.0) -> None:
        self._share = 1.0 - math.exp(-period / time_constant)
        self._least = least_load
        self._sum = np.tile(UP, (wheels, 1))

    def update(self, contacts: Contacts) -> Mat:
        """Unit normals ``(wheels, 3)``, world axes."""
        for k, load in enumerate(contacts.load):
            if load > self._least:
                self._sum[k] += self._share * (contacts.normal[k] - self._sum[k])
        return self._sum / np.linalg.norm(self._sum, axis=1, keepdims=True)


class Odometry:
    """Linear velocity of an omnidirectional base from its wheel rates and gyro, assuming that nothing slips.

    Each wheel's rim moves over the ground at r qd = rim . (v + omega x p), rim = axle x z.
    """

    def __init__(self, robot: Any) -> None:
        state = robot.state()
        names = tuple(robot.wheels)
        contacts = [state.position(frame) for frame in robot.landmarks["wheel_contacts"]]
        rims = [np.cross(robot.wheels[name].axle, UP) for name in names]
        self._radius = np.array([robot.wheels[name].radius for name in names])
        self._wheels = robot.joints("wheels")
        self._rims = np.array(rims)
        self._turning = np.array([np.cross(p, rim)[2] for p, rim in zip(contacts, rims, strict=True)])
        self._inverse = np.linalg.pinv(self._rims[:, :2])

    def velocity(self, v: Vec) -> Vec:
        """(v_x, v_y, 0) in the base ``(3,)`` [m/s], from the wheel rates and the yaw rate in v ``(nv,)``."""
        rolled = self._radius * v[self._wheels] - self._turning * v[5]
        x, y = self._inverse @ rolled
        return np.array([x, y, 0.0])

    def slip(self, v: Vec) -> Vec:
        """Speed of each wheel's rim over the ground along its rolling direction, from the true v, ``(wheels,)`` [m/s].

        Neglects what the turning about x and y does at the contact points, which lie near their plane.
        """
        return np.asarray(self._rims @ v[:3] + self._turning * v[5] - self._radius * v[self._wheels])
