"""Dreamer simulated under a torque law: eq. (2) by the KKT solve, integrated by Runge-Kutta of order four."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass
from functools import cached_property

import numpy as np
import pinocchio as pin

from benchmarks.sentis2012.equations.constraints import dynamics
from benchmarks.sentis2012.equations.ground import Ground, Snapshot
from benchmarks.sentis2012.equations.law import (
    Demand,
    orthogonal_projector,
    posture_demand,
    projector_rate,
    self_motion,
)
from hqp.arrays import Mat, Vec

Law = Callable[[Snapshot, float], Vec]


def simulate(ground: Ground, q: Vec, v: Vec, law: Law, step: float, duration: float, watch: Law) -> tuple[Vec, Mat]:
    """Times, and the value of ``watch`` at each state; ``law`` gives the torque."""
    times, seen = [], []
    for k in range(round(duration / step) + 1):
        t = k * step
        s = Snapshot(ground, q, v)
        times.append(t)
        seen.append(watch(s, t))
        q, v = _step(ground, q, v, law, t, step)
    return np.array(times), np.array(seen)


def _step(ground: Ground, q: Vec, v: Vec, law: Law, t: float, h: float) -> tuple[Vec, Vec]:
    def rate(q: Vec, v: Vec, t: float) -> tuple[Vec, Vec]:
        s = Snapshot(ground, _normalised(q), v)
        return _configuration_rate(q, v), s.kkt(law(s, t))[0]

    a1, b1 = rate(q, v, t)
    a2, b2 = rate(q + 0.5 * h * a1, v + 0.5 * h * b1, t + 0.5 * h)
    a3, b3 = rate(q + 0.5 * h * a2, v + 0.5 * h * b2, t + 0.5 * h)
    a4, b4 = rate(q + h * a3, v + h * b3, t + h)
    return _normalised(q + h / 6.0 * (a1 + 2.0 * a2 + 2.0 * a3 + a4)), v + h / 6.0 * (b1 + 2.0 * b2 + 2.0 * b3 + b4)


def _configuration_rate(q: Vec, v: Vec) -> Vec:
    """dq/dt in the coordinates themselves (quaternion xyzw), so that a plain Runge-Kutta step keeps its order."""
    x, y, z, w = q[3:7]
    R = pin.Quaternion(w, x, y, z).toRotationMatrix()
    a, b, c = v[3:6]
    turn = 0.5 * np.array([w * a + y * c - z * b, w * b + z * a - x * c, w * c + x * b - y * a, -x * a - y * b - z * c])
    return np.concatenate((R @ v[:3], turn, v[6:]))


def _normalised(q: Vec) -> Vec:
    q = q.copy()
    q[3:7] /= np.linalg.norm(q[3:7])
    return q


@dataclass(frozen=True)
class SelfMotionRun:
    """The hand follows a sine while the posture law of eqs. (39) to (41) acts in its null space.

    gains: (kp, kv, ke).  sign: factor of dPhi/dt in eq. (41), -1 as printed.  amplitude: the hand's [m/s^2].
    """

    ground: Ground
    q: Vec
    v: Vec
    goal: Vec
    gains: tuple[float, float, float] = (4.0, 4.0, 1.0)
    sign: float = 1.0
    amplitude: float = 0.5

    @cached_property
    def hand(self) -> Vec:
        """First place of the hand."""
        return Snapshot(self.ground, self.q, self.v).frame("hand")[0]

    def task(self, s: Snapshot, t: float) -> Demand:
        """The hand: a sine about its first place, with feedback on position and velocity."""
        J, dJ = s.hand
        direction = np.array([1.0, 0.5, -0.7]) * self.amplitude
        w = 4.0
        target = self.hand + direction * (1.0 - np.cos(w * t)) / w**2
        velocity, acceleration = direction * np.sin(w * t) / w, direction * np.cos(w * t)
        a = acceleration - 100.0 * (s.frame("hand")[0] - target) - 20.0 * (J @ s.v - velocity)
        return Demand(*s.star(J, dJ), a)

    def error(self, s: Snapshot) -> Vec:
        """e = q_act - goal."""
        return np.asarray(self.ground.U @ np.concatenate((np.zeros(6), s.q[7:])) - self.goal)

    def torque(self, s: Snapshot, t: float) -> Vec:
        """The corrected law, gravity counted once."""
        d, task = dynamics(s), self.task(s, t)
        Phi, dPhi = orthogonal_projector(task.J), projector_rate(task.J, task.dJ)
        demand = posture_demand(Phi, dPhi, self.error(s), s.q_act, self.gains, self.sign)
        return self_motion(d.phi, d.h, task, demand, s.q_act)[0]

    def energy(self, s: Snapshot, t: float) -> Vec:
        """V = E^T E / 2 and the norm of Phi e."""
        Phi = orthogonal_projector(self.task(s, t).J)
        E = Phi @ (-self.gains[0] * self.error(s) - self.gains[1] * s.q_act)
        return np.array([0.5 * float(E @ E), float(np.linalg.norm(Phi @ self.error(s)))])

    def run(self, step: float, duration: float) -> tuple[Vec, Mat]:
        """Times and (V, norm of Phi e)."""
        return simulate(self.ground, self.q, self.v, self.torque, step, duration, self.energy)
