"""Sensors of a plant: noise, bias, and the readings of one tick."""

from __future__ import annotations

import math
from dataclasses import dataclass, field

import numpy as np

from hqp.arrays import Mat, Vec
from hqp.errors import DeclarationError
from hqp.numbers import set_numbers

from .ground_contact import Contacts


@dataclass(frozen=True)
class Noise:
    """measured = true + bias + std * white noise, drawn anew at every reading; a bias may differ by axis.

    Raises DeclarationError for a negative or non-finite number.
    """

    std: float = 0.0
    bias: float | tuple[float, ...] = 0.0

    def __post_init__(self) -> None:
        set_numbers(self, "noise", ("std",), 0.0)
        if not np.all(np.isfinite(self.bias)):
            raise DeclarationError("noise", "bad bias", value=self.bias, allowed="finite numbers")

    def read(self, true: Vec, rng: np.random.Generator) -> Vec:
        """The reading of a true value, same shape."""
        measured: Vec = true + self.bias
        if self.std:
            measured += rng.normal(0.0, self.std, measured.shape)
        return measured


@dataclass(frozen=True, kw_only=True)
class Sensors:
    """Noise of every sensor; the default reads the truth.

    orientation: rotation vector of the IMU's error, IMU axes [rad].  gyro [rad/s] and accelerometer [m/s^2]: IMU axes.
    angle [rad] and rate [rad/s]: joints.  force: contact forces, world axes [N].
    """

    orientation: Noise = field(default_factory=Noise)
    gyro: Noise = field(default_factory=Noise)
    accelerometer: Noise = field(default_factory=Noise)
    angle: Noise = field(default_factory=Noise)
    rate: Noise = field(default_factory=Noise)
    force: Noise = field(default_factory=Noise)


@dataclass(frozen=True)
class Reading:
    """Readings of the sensors at one instant.

    q, v: Pinocchio's coordinates as an estimator with these sensors would give them: joints from their sensors, the
    base's orientation and angular velocity from the IMU; its position and linear velocity are the truth.
    rotation: IMU axes in the world ``(3, 3)``.  gyro ``(3,)`` [rad/s], accelerometer: specific force
    ``(3,)`` [m/s^2], its mean over the last call of ``step``; contact forces are those of the last step.
    """

    time: float
    q: Vec
    v: Vec
    rotation: Mat
    gyro: Vec
    accelerometer: Vec
    contacts: Contacts


def rotation_vector(w: Vec) -> Mat:
    """exp([w]x), the rotation by the vector w [rad], ``(3, 3)``."""
    angle = math.sqrt(float(w.dot(w)))
    if angle == 0.0:
        return np.eye(3)
    x, y, z = (w / angle).tolist()
    cross = np.array([[0.0, -z, y], [z, 0.0, -x], [-y, x, 0.0]])
    return np.asarray(_IDENTITY + math.sin(angle) * cross + (1.0 - math.cos(angle)) * cross @ cross)


_IDENTITY = np.eye(3)
