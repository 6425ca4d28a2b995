"""Dreamer's compliant controller (Sentis et al. 2012, section IV) as a stack, and plausible misreadings of it.

CoM of the upper body over the wheel triangle > yaw > hand, relative to the base > posture.  Only the heading of the
base is in a task, so that a pull at the hand moves the whole robot.
"""

from __future__ import annotations

import math
from dataclasses import dataclass
from typing import Literal

import numpy as np

from benchmarks.sentis2012.experiments.ground import GROUND_PUSH, UP, Heading
from benchmarks.sentis2012.experiments.hand_loads import loads
from benchmarks.sentis2012.experiments.misread import AbsoluteCom, AbsolutePosition, RollingAlongAxle
from benchmarks.sentis2012.experiments.released import MOTORS, MovingLimits
from hqp import PD, Stack
from hqp.arrays import Mat, Vec
from hqp.declare.element import Element
from hqp.declare.law import Law, SelfMotion
from hqp.declare.reference import Reference
from hqp.robots import load
from hqp.tasks import (
    Com,
    ExternalWrench,
    FrictionCone,
    OmniWheelContact,
    Orientation,
    Position,
    Posture,
    TorqueLimits,
    UnilateralContact,
    Within,
)
from tests.scenes.sentis2012 import WHEELS, paper_stack

COM_GOAL = (0.0289, -0.0522)
"""Place of the upper body's CoM over the base in the posture goal, in the base's heading [m]."""

HAND_GOAL = (0.397, -0.216, 1.063)
"""Place of the palm in the base's heading frame at the posture goal [m]."""

Normals = Literal["contact", "map", "felt", "base", "contact in all", "vertical"]
"""Ground normals: ``contact``, the base's in the rows and each wheel's own in the gravity compensation; ``map``, like
``contact`` with normals from the robot's own map of heights; ``felt``, the base's, and gravity compensation also
resists the push of ground outside the base's plane (``GroundForce``); ``base``, the base's, from an IMU alone;
``contact in all``, each wheel's own also in the rows; ``vertical``."""

Wrench = Literal["none", "measured", "observed"]
"""Source of the force at the hand: unknown, a sensor at the wrist, or a momentum observer on torques and motion.  The
force enters dynamics and force bounds; the controller does not resist it."""

Payload = Literal["none", "known", "observed"]
"""Payload of the hand: unknown, known, or the lasting downward part of the observed force."""


@dataclass(frozen=True, kw_only=True)
class Compliance:
    """Gains [1/s^2], critically damped, and options; the last five are negative controls.

    carried: with the base's normals, the human's part of the weight along the slope: a share, and its upper limit [N];
    the wheels hold the rest (see ``gravity_share``).  limits: torque limits and friction bounds as inequalities;
    friction: the assumed coefficient.  turn: largest rate of the robot's turn towards the pull [rad/s], 0 to hold its
    heading; torso: rate of the torso's posture goal alone.  faces: world azimuth of the torso [rad], for a known
    slope.  least_load: least load of every wheel with ``limits`` [N].  bandwidth: of the observer [1/s].
    assist: share of the human's pull that the wheels add.  felt: low-pass of the ground's push [s], largest push to
    resist [N], and, while a wheel is unloaded, the largest share of the weight along the base's tilt to resist.
    released: with ``limits`` and felt ground, load below which the controller releases a wheel [N], see
    ``ReleasedWheels``; the robot then has an accelerometer.  own_weight: true to distinguish an upper body that is
    heavier than its model from a payload.  self_motion: k_E of the posture law of eqs. (40) to (44) [1/s], 0 for a PD
    law.  period: of control [s].
    """

    com: float = 400.0
    com_acceleration: float = 2.5
    yaw: float = 25.0
    hand: float = 400.0
    posture: float = 100.0
    period: float = 0.002
    normals: Normals = "contact"
    carried: tuple[float, float] = (0.0, 0.0)
    limits: bool = False
    friction: float = 0.8
    turn: float = 0.0
    torso: float = 0.0
    faces: float | None = None
    least_load: float = 0.0
    wrench: Wrench = "none"
    payload: Payload = "none"
    bandwidth: float = 20.0
    assist: float = 0.0
    felt: tuple[float, float, float] = (0.05, 150.0, 0.0)
    released: float = 0.0
    own_weight: bool = False
    self_motion: float = 0.0
    com_goal: tuple[float, float] = COM_GOAL
    gyro: bool = True
    absolute_jacobians: bool = False
    absolute_damping: bool = False
    goal_at_axles: bool = False
    axle_rolling: bool = False


def stack(choice: Compliance) -> Stack:
    """Eqs. (48) to (59) with the yaw task added, under coupling, wheels and, with ``limits``, limits."""
    com_kind: type[Com] = AbsoluteCom if choice.absolute_jacobians else Com
    hand_kind: type[Position] = AbsolutePosition if choice.absolute_jacobians else Position
    law = PD(choice.com, max_acceleration=choice.com_acceleration)
    wheels = [RollingAlongAxle(wheel=name) if choice.axle_rolling else OmniWheelContact(wheel=name) for name in WHEELS]
    posture_law: Law = PD(choice.posture)
    if choice.self_motion:
        posture_law = SelfMotion(choice.posture, 2.0 * math.sqrt(choice.posture), choice.self_motion)
    added: list[Element] = []
    pushed = [ExternalWrench(frame="base", name=GROUND_PUSH)] if choice.normals == "felt" else []
    if choice.limits:
        cones = [FrictionCone(contact=name, mu=choice.friction, edges=4) for name in WHEELS]
        most = load("dreamer").effort_limit[load("dreamer").actuated]
        motors = MovingLimits(lower=-most, upper=most, name=MOTORS) if choice.released else TorqueLimits()
        added = [motors, joint_range(), *cones]
        if choice.least_load:
            added += [UnilateralContact(contact=name, minimum=choice.least_load) for name in WHEELS]
    return paper_stack(
        [*added, *loads(choice.wrench != "none", choice.payload != "none"), *pushed],
        com=com_kind(axes="xy", subtree="torso_yaw", relative_to="base", heading=True, law=law, name="com"),
        yaw=Orientation(frame="base", axes="yaw", law=PD(choice.yaw), name="yaw"),
        hand=hand_kind(frame="hand_point", relative_to="base", heading=True, law=PD(choice.hand), name="hand"),
        posture=Posture(joints="upper_body", law=posture_law),
        contacts=wheels,
    )


def joint_range(margin: float = 0.03, rate: float = 10.0) -> Within:
    """Bounds that keep the upper body's joints off their stops, by a margin [rad] and a rate of approach [1/s].

    No limits of speed, which the table sets for safety and the edge of the slope exceeds by geometry.  A joint that
    runs into its stop throws the load from one wheel to another, and an observer takes the stop for a human's push.
    """
    robot = load("dreamer")
    joints = robot.joints("upper_body")
    lower, upper = robot.lower[joints] + margin, robot.upper[joints] - margin
    low, high = lower.tolist(), upper.tolist()
    return Within(Posture(joints="upper_body"), lower=low, upper=high, rate=rate, name="joint_range")


def gravity_share(normal: Vec, carried: tuple[float, float], weight: float) -> float:
    """Share of the weight along the slope that the wheels hold: 1 - min(share, newtons / (m g sin tilt)).

    An IMU does not sense which wheels stand on the slope.  If the wheels held all of the weight, the robot would push
    uphill by up to m g sin(tilt) after its rear wheels left the slope, and tip over; the human's share reduces that
    push.  The bound in newtons limits the human's pull.
    """
    share, most = carried
    along = weight * math.hypot(normal[0], normal[1])
    return 1.0 - min(share, most / along) if along > 0.0 else 1.0 - share


class Targets:
    """The references of every tick."""

    def __init__(self, choice: Compliance, tasks: Stack, posture: Vec, yaw: float, weight: float) -> None:
        self._choice, self._weight = choice, weight
        self._com, self._hand = tasks.find("com", Com), tasks.find("hand", Position)
        self._wheels = [tasks.find(name, OmniWheelContact) for name in WHEELS]
        self._posture, self._rest = tasks.find("posture", Posture), posture
        self._yaw, self._heading = tasks.find("yaw", Orientation), Heading(yaw, choice.turn, choice.period)
        self._led = Heading(yaw, choice.torso, choice.period, gain=5.0, least=0.03, time_constant=0.1)

    def __call__(
        self,
        rotation: Mat,
        velocity: Vec,
        contact_normals: Mat,
        loads: Vec | None = None,
    ) -> tuple[Reference, ...]:
        """For a base with a rotation ``(3, 3)`` and velocity ``(3,)`` [m/s] in its own axes, and normals at wheels.

        loads: measured at the wheels ``(3,)`` [N], None for a robot without load cells.
        """
        choice, base = self._choice, rotation[:, 2]
        goal = np.array(choice.com_goal)
        if choice.goal_at_axles:
            goal = goal + 0.101 * self._level(rotation, base)
        moving = rotation @ velocity
        turning = self._heading.update(moving[:2])
        posture, posture_rate = self._rest, np.zeros_like(self._rest)
        if choice.torso:  # the torso leans along the slope at any heading of the base
            posture = posture.copy()
            led = moving[:2] if choice.faces is None else np.array([math.cos(choice.faces), math.sin(choice.faces)])
            posture_rate[0] = self._led.update(led) - turning
            posture[0] += math.remainder(self._led.yaw - self._heading.yaw, 2.0 * math.pi)
        rate, hand_rate = None, None
        if choice.absolute_damping:
            rate = -self._level(rotation, moving)
            hand_rate = np.append(rate, -moving[2])
        return (
            self._com.at(goal, velocity=rate),
            self._hand.at(HAND_GOAL, velocity=hand_rate),
            self._yaw.at(self._heading.yaw, velocity=turning),
            self._posture.at(posture, velocity=posture_rate),
            *self._loaded(self._grounds(base, contact_normals), loads),
        )

    @staticmethod
    def _loaded(grounds: list[Reference], loads: Vec | None) -> list[Reference]:
        if loads is None:
            return grounds
        return [ground.loaded(load) for ground, load in zip(grounds, loads.tolist(), strict=True)]

    def _grounds(self, base: Vec, contact: Mat) -> list[Reference]:
        normals = self._choice.normals
        if normals in ("contact", "map"):
            return [w.at(normal=base, gravity_normal=n) for w, n in zip(self._wheels, contact, strict=True)]
        if normals == "contact in all":
            return [w.at(normal=n) for w, n in zip(self._wheels, contact, strict=True)]
        if normals == "vertical":
            return [w.at(normal=UP) for w in self._wheels]
        share = gravity_share(base, self._choice.carried, self._weight)
        reduced = None if share == 1.0 else (1.0 - share) * UP + share * base
        return [w.at(normal=base, gravity_normal=reduced) for w in self._wheels]

    @staticmethod
    def _level(rotation: Mat, vector: Vec) -> Vec:
        """Horizontal part of a world vector in the heading's axes ``(2,)``."""
        c, s = rotation[0, 0], rotation[1, 0]
        length = math.hypot(c, s)
        c, s = c / length, s / length
        return np.array([c * vector[0] + s * vector[1], c * vector[1] - s * vector[0]])
