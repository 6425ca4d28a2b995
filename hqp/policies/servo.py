"""Joint servos tau = kp (q* - q) - kd v: torque of a target, target of a torque."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass
from functools import cached_property

import numpy as np
from numpy.typing import ArrayLike

from hqp.arrays import Index, Vec
from hqp.declare.robot import Robot
from hqp.errors import DeclarationError

Gains = float | ArrayLike | Mapping[str, float]
"""A number for all joints, one for each, or by joint name."""


@dataclass(frozen=True, eq=False)
class Servos:
    """PD servos tau = kp (q* - q) - kd v with constant targets q* during a period dt.

    Over an implicit step their torque is kp (q* - q - dt v) - kd v - D qdd, D = dt kd + dt^2 kp: D adds to the inertia.
    Functions work on the last axis, so that rows of a batch have the bits of a single one.  kp [N m/rad], kd
    [N m s/rad], effort [N m], dt [s], each ``(n,)``.
    """

    kp: Vec
    kd: Vec
    effort: Vec
    dt: float

    @classmethod
    def of(cls, owner: str, robot: Robot, joints: Index, kp: Gains | None, kd: Gains | None, dt: float) -> Servos:
        """Servos of these coordinates; gains of zero for None, which take torques.

        Raises DeclarationError for gains and for tendons.
        """
        require_own_motors(owner, robot, joints)
        names = [robot.joint_name(int(c)) for c in joints]
        effort = np.where(robot.effort_limit[joints] > 0.0, robot.effort_limit[joints], np.inf)
        kp, kd = (
            np.zeros(len(names)) if g is None else gains(owner, what, g, names) for what, g in (("kp", kp), ("kd", kd))
        )
        return cls(kp, kd, effort, dt)

    @cached_property
    def stiffening(self) -> Vec:
        """D = dt kd + dt^2 kp ``(n,)`` [kg m^2]."""
        return self.dt * (self.kd + self.dt * self.kp)

    def torque(self, target: Vec, q: Vec, v: Vec) -> Vec:
        """Torque under a target [N m]."""
        return self.kp * (target - q) - self.kd * v

    def target(self, torque: Vec, q: Vec, v: Vec) -> Vec:
        """The target of this torque."""
        return q + (torque + self.kd * v) / self.kp


def require_own_motors(owner: str, robot: Robot, joints: Index) -> None:
    """Raise DeclarationError for motors of these coordinates that pull other joints too: they take no joint targets."""
    rows = np.isin(robot.actuated, joints) & (np.count_nonzero(robot.actuation, axis=1) > 1)
    if rows.any():
        names = [robot.joint_name(int(c)) for c in robot.actuated[rows]]
        allowed = "motors of one joint each; a Controller with Torque commands tendons"
        raise DeclarationError(owner, "motors that pull several joints by a tendon", value=names, allowed=allowed)


def gains(owner: str, what: str, given: Gains, names: list[str]) -> Vec:
    """Gains of the joints ``(n,)``; raises DeclarationError unless they are positive (kd: at least 0) and finite."""
    if isinstance(given, Mapping):
        missing = [name for name in names if name not in given]
        if missing:
            raise DeclarationError(owner, what, value=sorted(given)[:5], allowed=f"a number for {missing[0]} too")
        given = [given[name] for name in names]
    try:
        found = np.broadcast_to(np.asarray(given, dtype=np.float64), (len(names),)).copy()
    except (TypeError, ValueError) as error:
        raise DeclarationError(owner, what, value=given, allowed=f"a number, {len(names)} or by joint") from error
    if not (np.isfinite(found).all() and (found >= 0.0).all() and (what != "kp" or (found > 0.0).all())):
        raise DeclarationError(
            owner, what, value=given, allowed="positive numbers [N m/rad], kd at least 0 [N m s/rad]"
        )
    return found
