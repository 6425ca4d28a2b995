"""Estimated loads on Dreamer's hand: the human's pull, and the payload."""

from __future__ import annotations

import math
from typing import TYPE_CHECKING, Any

import numpy as np

from hqp import Stack
from hqp.arrays import Vec
from hqp.declare.element import Element
from hqp.declare.reference import Reference
from hqp.declare.robot import State
from hqp.estimation import MomentumObserver
from hqp.tasks import ExternalWrench, Payload

if TYPE_CHECKING:
    from benchmarks.sentis2012.experiments.compliance import Compliance

HAND, CARRIED_AT = "hand", (0.07, 0.0, 0.0)
"""Body that carries a payload, and its place there [m]."""

WRENCH, ASSIST, PAYLOAD = "hand_wrench", "hand_assist", "hand_payload"

SLOW = 1.0
"""Time constant of the low-pass that turns a lasting downward force into a payload [s]."""

GRAVITY = 9.81

EXPECTED = 0.1
"""Prior deviation of the upper body's excess weight over its model, as a share."""
DOUBT = 0.5
"""Standard deviation of the observer's torques [N m]."""


def loads(wrench: bool, payload: bool) -> list[Element]:
    """Elements of ``subject_to`` for the known loads.

    The force at the hand is the sum of two wrenches.  Gravity compensation resists the second, the opposite of a share
    of that force, so that the wheels add this share to the human's pull.
    """
    found: list[Element] = []
    if wrench:
        found.append(ExternalWrench(frame="hand_point", resisted=False, name=WRENCH))
        found.append(ExternalWrench(frame="hand_point", name=ASSIST))
    if payload:
        found.append(Payload(frame=HAND, com=CARRIED_AT, name=PAYLOAD))
    return found


class HandLoads:
    """References of the hand's wrench and payload.

    The observer uses the joints of the upper body, whose rows contain no contact force; it adds hip and thorax, so
    that the coupling's force cancels.  damping: of the joints, in the order of torques ``(n,)`` [N m s/rad], as in the
    controller's feedforward.  mass: known payload [kg].
    """

    def __init__(self, robot: Any, choice: Compliance, tasks: Stack, damping: Vec, mass: float) -> None:
        self._choice, self._mass = choice, mass if choice.payload == "known" else 0.0
        self._wrench = tasks.find(WRENCH, ExternalWrench) if choice.wrench != "none" else None
        self._assist = tasks.find(ASSIST, ExternalWrench) if choice.wrench != "none" else None
        self._payload = tasks.find(PAYLOAD, Payload) if choice.payload != "none" else None
        by_coordinate = np.zeros(robot.nv)
        by_coordinate[robot.actuated] = damping
        self._observer = MomentumObserver(
            robot, "hand_point", "upper_body", choice.period, coupled={"torso_thorax": ("torso_hip", 1.0)},
            bandwidth=choice.bandwidth, damping=by_coordinate,
        )  # fmt: skip
        self.observing = "observed" in (choice.wrench, choice.payload) or choice.normals == "felt"
        self.observed: Vec = np.zeros(3)
        """Force at the hand by the observer, also if the controller does not use it [N]."""
        self.force: Vec = np.zeros(3)
        """Estimated force at the hand: the human's pull, without the payload's weight [N]."""
        self._down, self._heavier = 0.0, 0.0
        self._share = 1.0 - math.exp(-choice.period / SLOW)

    @property
    def mass(self) -> float:
        """Estimated payload [kg]."""
        return self._mass

    @property
    def residual(self) -> Vec:
        """Residual of the observer ``(nv,)`` [N, N m]."""
        return self._observer.residual

    def references(self, state: State, measured: Vec) -> list[Reference]:
        """The references of a tick; the CoM task sees the payload by itself.

        measured: force at the wrist ``(3,)`` [N], for a robot that has a sensor there.
        """
        found: list[Reference] = []
        if self._wrench is not None:
            if self._choice.wrench == "measured":
                self.force = measured
            force = np.array([*self.force.tolist(), 0.0, 0.0, 0.0])
            found.append(self._wrench.at((1.0 + self._choice.assist) * force))
            if self._assist is not None:
                found.append(self._assist.at(-self._choice.assist * force))
        if self._payload is not None:
            found.append(self._payload.at(self.mass))
        return found

    def sent(self, state: State, torque: Vec) -> None:
        """Take the torque that goes to the motors at a state."""
        if not self.observing:
            return
        force = self._observer.update(state, torque)
        if self._choice.own_weight:
            force = self._less_own_weight(state)
        if self._choice.payload == "observed":
            self._down += self._share * (-force[2] * self._lever(state) - self._down)
            self._mass = max(self._down / GRAVITY, 0.0)
        if self._mass:
            force = force + np.array([0.0, 0.0, self._mass * GRAVITY / self._lever(state)])
        self.observed = force
        if self._choice.wrench == "observed":
            self.force = force

    def _less_own_weight(self, state: State) -> Vec:
        """Force ``(3,)`` [N] without the upper body's excess weight over its model, a share e of its gravity.

        Least squares S r = S (J^T f + e g) with a prior on e: a payload loads the arm more than the hip.  The two are
        distinguishable if the robot leans on the slope, not if it is upright.
        """
        S = self._observer.rows
        J, g, r = S @ state.jacobian("hand_point")[:3].T, S @ state.gravity_force(), S @ self._observer.residual
        A = np.vstack((np.column_stack((J, g)), (0.0, 0.0, 0.0, DOUBT / EXPECTED)))
        found = np.linalg.lstsq(A, np.append(r, 0.0), rcond=None)[0]
        self._heavier += self._share * (found[3] - self._heavier)
        return np.asarray(np.linalg.lstsq(J, r - self._heavier * g, rcond=None)[0])

    def _lever(self, state: State) -> float:
        """Ratio of joint torques of a weight at the payload's place to those of one at the hand's point."""
        base = state.position("base")
        there = state.position(HAND) + state.rotation(HAND) @ CARRIED_AT - base
        here = state.position("hand_point") - base
        return float(np.hypot(*here[:2]) / np.hypot(*there[:2]))
