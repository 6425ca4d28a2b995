"""Viscous and dry friction of joints, from the robot's file, which torques overcome."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any, ClassVar

import numpy as np

from hqp.arrays import Index, Vec


@dataclass(frozen=True, eq=False)
class JointFriction:
    """Torque that overcomes the friction of joints at the rate v' that they will soon have:

        tau = d v' + f tanh(v' / BREAKS),   v' = v + SOON a,

    so that a joint at rest begins to move.  d, f: viscous and dry friction of the robot's file, less the share that dry
    friction has of the motor's largest torque: a motor that friction holds alone would push its joint from limit to
    limit.  Natively this is cpp/walking/joint_friction.hpp.

    viscous [N m s/rad], dry [N m]: ``(k,)``.
    """

    SOON: ClassVar[float] = 0.02
    BREAKS: ClassVar[float] = 0.3

    viscous: Vec
    dry: Vec

    @classmethod
    def of(cls, robot: Any, columns: Index) -> JointFriction:
        """Friction of actuated joints by their tangent coordinates."""
        model = robot.model
        viscous = np.ravel(model.damping)[columns]
        dry = np.ravel(getattr(model, "friction", np.zeros(robot.nv)))[columns]
        limits = robot.effort_limit[columns]
        held = np.divide(dry, limits, out=np.zeros(columns.size), where=limits > 0.0)
        part = np.maximum(1.0 - held, 0.0)
        return cls(part * viscous, part * dry)

    def __bool__(self) -> bool:
        return bool((self.viscous + self.dry).any())

    def torque(self, rate: Vec, acceleration: Vec) -> Vec:
        """Torque ``(k,)`` [N m] at rates [rad/s] and accelerations [rad/s^2]."""
        soon = rate + self.SOON * acceleration
        return np.asarray(self.viscous * soon + self.dry * np.tanh(soon / self.BREAKS))
