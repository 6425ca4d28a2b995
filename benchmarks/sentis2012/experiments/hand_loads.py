"""What acts on Dreamer's hand, as far as the robot can know it: the human's pull, and what the hand carries."""

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
"""The body that carries a payload, and where [m]."""

WRENCH, ASSIST, PAYLOAD = "hand_wrench", "hand_assist", "hand_payload"

SLOW = 1.0
"""Of the low-pass that takes a lasting downward force for a weight [s]."""

GRAVITY = 9.81

EXPECTED = 0.1
"""By how much the upper body may weigh more than its model, as a share: the prior of its estimate."""
DOUBT = 0.5
"""Of the observer's torques [N m]."""


def loads(wrench: bool, payload: bool) -> list[Element]:
    """The elements of ``subject_to`` for what is known.

    Two wrenches at the hand, whose sum is the force there: what gravity compensation holds of the second, the opposite
    of a share of that force, is the push of wheels that go along with the human.
    """
    found: list[Element] = []
    if wrench:
        found.append(ExternalWrench(frame="hand_point", resisted=False, name=WRENCH))
        found.append(ExternalWrench(frame="hand_point", name=ASSIST))
    if payload:
        found.append(Payload(frame=HAND, com=CARRIED_AT, name=PAYLOAD))
    return found


class HandLoads:
    """References of the hand's wrench and payload, and of what it carries.

    The observer takes the joints of the upper body, whose rows hold no contact force; hip and thorax together, so that
    the coupling's force drops out.  damping: of the joints, in the order of torques ``(n,)`` [N m s/rad], as in the
    controller's feedforward.  mass: what is carried where it is told [kg].
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
        """The force at the hand by the observer, whether anything takes it or not [N]."""
        self.force: Vec = np.zeros(3)
        """At the hand, as known: the human's pull, without what a payload weighs [N]."""
        self._down, self._heavier = 0.0, 0.0
        self._share = 1.0 - math.exp(-choice.period / SLOW)

    @property
    def mass(self) -> float:
        """Of the payload as known [kg]."""
        return self._mass

    @property
    def residual(self) -> Vec:
        """Of the observer ``(nv,)`` [N, N m]."""
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
        """The force ``(3,)`` [N] without what the upper body weighs more than its model, by a share e of its gravity.

        Least squares S r = S (J^T f + e g) with a prior on e: a payload bends the arm more than the hip.  Upright the
        two look alike; leaning on the slope they do not.
        """
        S = self._observer.rows
        J, g, r = S @ state.jacobian("hand_point")[:3].T, S @ state.gravity_force(), S @ self._observer.residual
        A = np.vstack((np.column_stack((J, g)), (0.0, 0.0, 0.0, DOUBT / EXPECTED)))
        found = np.linalg.lstsq(A, np.append(r, 0.0), rcond=None)[0]
        self._heavier += self._share * (found[3] - self._heavier)
        return np.asarray(np.linalg.lstsq(J, r - self._heavier * g, rcond=None)[0])

    def _lever(self, state: State) -> float:
        """A weight at the payload's place weighs this much less on the joints than one at the hand's point."""
        base = state.position("base")
        there = state.position(HAND) + state.rotation(HAND) @ CARRIED_AT - base
        here = state.position("hand_point") - base
        return float(np.hypot(*here[:2]) / np.hypot(*there[:2]))
