"""Estimation of a floating base from the sensors of a legged robot: an IMU at the base, joint encoders, and feet that
stand still."""

from __future__ import annotations

from collections.abc import Sequence
from typing import Any

import numpy as np

from hqp.arrays import Vec
from hqp.declare import plans
from hqp.declare.reference import numbers
from hqp.declare.robot import Robot
from hqp.errors import DeclarationError
from hqp.kinds import names, require_robot
from hqp.numbers import number


class FeetEstimator:
    """Orientation, position and velocity of the base, by complementary filters on IMU and legs.

    A foot that carries more than ``least_load`` [N] for LANDED stands where it was then, p_i in the world; all stand
    at the start.  With r_i and u_i its place and velocity relative to the base,

        dR/dt = R [gyro + (z_imu x z) / T_tilt]x,  and about the vertical the mean of the feet's yaw errors / T_yaw,
        dv/dt = R (f - b) + g + (sum w_i (-u_i) - v) / T_velocity,
        db/dt = -R' (sum w_i (-u_i) - v) / (T_velocity T_bias),
        dp/dt = v + (sum w_i (p_i - r_i) - p) / T_position,

    with weights w_i of the feet's loads and the bias b of the accelerometer.  Differences between the places of the
    base by two feet fade in AGREE, their mean stays: dp_i/dt = (sum w_j (p_j - r_j) - (p_i - r_i)) / T_agree, yaws
    alike; so a foot that settles beside another moves the base by its share of the load.  A foot whose velocity
    v + u_i over the ground, smoothed over SMOOTH, is more than SLIPS, or its angular velocity more than TURNS, has no
    weight until it rests again, where it then stands.  If no foot stands for LOST, all that bear load do, and b
    explains the velocity since.  The IMU's yaw is not used: it is not observable.  Without a foot on the ground the IMU
    alone goes on.  Measurements that are not finite leave the estimate as it is.

    robot: with a free base; the estimator has a copy of its own.  feet: frames of the soles.  period: between updates
    [s].  q: the configuration at the start ``(nq,)``, which defines the world.  Time constants [s].
    Raises DeclarationError for a robot with a fixed base or a constant that is not positive, FrameNotFound.
    """

    LANDED = 0.02
    """For how long a foot has to carry its load before it counts as standing, or to lack it before it does not [s]."""

    FAINT = 1e-3
    """Weight of a foot that still counts as standing and carries next to nothing [N]."""

    SLIPS, TURNS, SMOOTH, LOST = 0.06, 0.4, 0.01, 1.0
    """Velocity and angular velocity over the ground above which a foot that bears load does not stand, as it slides,
    rolls onto its sole or pivots [m/s, rad/s], smoothed over [s]; longest time without a foot that stands [s]."""

    AGREE = 0.03
    """Time constant with which the places of standing feet follow their common base [s]."""

    def __init__(
        self,
        robot: Robot,
        feet: Sequence[str],
        period: float,
        q: Vec,
        *,
        least_load: float = 30.0,
        tilt: float = 0.1,
        yaw: float = 2.0,
        velocity: float = 0.2,
        bias: float = 1.0,
        position: float = 0.02,
    ) -> None:
        require_robot("estimator", robot)
        feet = names("estimator", "feet", feet, "frames of the soles")
        if not robot.floating:
            raise DeclarationError("estimator", f"{robot.name} has a fixed base", allowed="a free base")
        constants = {"period": period, "tilt": tilt, "yaw": yaw, "velocity": velocity, "bias": bias}
        constants |= {"position": position}
        constants = {
            name: number("estimator", name, value, 0.0, strict=True, unit="s") for name, value in constants.items()
        }
        from hqp import _session  # a package without compiled parts imports this room

        self._robot, self._feet = robot.copy(), len(feet)
        least_load = number("estimator", "least_load", least_load, 0.0, unit="N")
        constants |= {"landed": self.LANDED, "faint": self.FAINT, "slips": self.SLIPS, "turns": self.TURNS}
        constants |= {"smooth": self.SMOOTH, "lost": self.LOST, "agree": self.AGREE, "least_load": least_load}
        tree = {**feet_tree(self._robot, feet), **constants, "gravity": robot.gravity.tolist()}
        self._native = _session.FeetEstimator(tree, numbers("estimator", "q", q, (robot.nq,)))

    @property
    def slipping(self) -> tuple[bool, ...]:
        """Flags of the feet that bear load and move along the ground."""
        return tuple(self._native.slipping)

    def update(self, q: Vec, v: Vec, specific_force: Vec, load: Vec) -> tuple[Vec, Vec]:
        """Return (q, v) with the estimated base, from measurements.

        q, v: joints from the encoders, the base's orientation and its angular velocity in its own axes from the IMU;
        their position and linear velocity of the base are not read.  specific_force: reading of the accelerometer, in
        the base's axes, at its origin ``(3,)`` [m/s^2].  load: normal force at each foot ``(feet,)`` [N].
        """
        found_q, found_v = np.empty(self._robot.nq), np.empty(self._robot.nv)
        at, speed = (numbers("estimator", "q", q, found_q.shape), numbers("estimator", "v", v, found_v.shape))
        felt = numbers("estimator", "specific_force", specific_force, (3,))
        self._native.update(at, speed, felt, numbers("estimator", "load", load, (self._feet,)), found_q, found_v)
        return found_q, found_v


def feet_tree(robot: Robot, feet: Sequence[str]) -> dict[str, Any]:
    """Joints, bodies and frames of feet, for native kinematics over the arrays of this robot.

    Raises FrameNotFound, and DeclarationError for a robot with a joint that native kinematics lack.
    """
    frames = [plans.frame(robot, name) for name in feet]
    if robot.tree_joints is None:
        raise DeclarationError("feet", f"{robot.name} has a screw joint", allowed="joints of native kinematics")
    motion = {"joints": robot.tree_joints, "frames": robot.placed_frames, "bodies": robot.bodies}
    return {"motion": {**motion, "twists": robot.joint_twists}, "feet": frames, "nv": robot.nv}
