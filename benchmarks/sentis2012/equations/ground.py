"""Dreamer on a slope: consistent states, and every matrix of the paper derived from Pinocchio's calls.

Nothing here uses the library's tasks, constraints or dynamics: they are checked against it.
"""

from __future__ import annotations

import math
from collections.abc import Iterator
from dataclasses import dataclass, field
from functools import cached_property
from typing import Any

import numpy as np
import pinocchio as pin

import hqp
from hqp.arrays import Mat, Vec
from hqp.robots import Robot

WHEELS = ("wheel_0", "wheel_1", "wheel_2")
GRAVITY = 9.81
_WORLD = pin.ReferenceFrame.LOCAL_WORLD_ALIGNED


def skew(a: Vec) -> Mat:
    """[a]x with [a]x b = a x b."""
    return np.array([[0.0, -a[2], a[1]], [a[2], 0.0, -a[0]], [-a[1], a[0], 0.0]])


def pinv(M: Mat, tolerance: float = 1e-9) -> Mat:
    """Moore-Penrose inverse with the relative cut-off of the acceptance list."""
    return np.linalg.pinv(M, rcond=tolerance)


def symmetric_pinv(M: Mat, tolerance: float = 1e-9) -> Mat:
    """Moore-Penrose inverse of a symmetric matrix, symmetrised first."""
    return np.linalg.pinv(0.5 * (M + M.T), rcond=tolerance, hermitian=True)


def relative(difference: Mat | Vec, reference: Mat | Vec) -> float:
    """Largest deviation over the largest entry of the reference."""
    return float(np.abs(difference).max(initial=0.0) / max(np.abs(reference).max(initial=0.0), 1e-300))


def largest(M: Mat | Vec) -> float:
    """The largest entry."""
    return float(np.abs(M).max(initial=0.0))


class Ground:
    """Dreamer on a plane inclined by ``degrees`` about the world's y axis; rotors: with their inertia."""

    def __init__(self, degrees: float, rotors: bool = False) -> None:
        self.degrees = degrees
        self.robot: Robot = hqp.robots.load("dreamer", rotors=rotors)
        angle = math.radians(degrees)
        self.tilt = np.array(pin.utils.rotate("y", -angle))
        self.normal = self.tilt[:, 2].copy()
        self.label = f"dreamer {degrees:g} deg"
        robot = self.robot
        self.U = robot.actuation
        self.upper = robot.joints("upper_body")
        self.S = np.eye(robot.nv)[self.upper]
        self.bodies = [
            j for j in range(1, robot.model.njoints) if robot.model.getJointId("torso_yaw") in robot.model.supports[j]
        ]

    def configuration(self, rng: np.random.Generator, spread: float = 1.0) -> Vec:
        """Wheels on the plane at a random place and heading; joints random, hip and thorax at the same angle."""
        robot = self.robot
        q = robot.random_configuration(rng, spread)
        thorax, hip = (robot.model.joints[robot.model.getJointId(n)].idx_q for n in ("torso_thorax", "torso_hip"))
        q[thorax] = q[hip] = float(np.clip(q[hip], *_common(robot)))
        heading = np.array(pin.utils.rotate("z", rng.uniform(-np.pi, np.pi)))
        place = self.tilt @ np.array([*rng.uniform(-1.0, 1.0, 2), 0.0])
        q[:3] = place
        q[3:7] = pin.Quaternion(self.tilt @ heading).coeffs()
        return q

    def states(self, count: int, seed: int, speed: float = 1.0) -> Iterator[Snapshot]:
        """Random states whose velocity of that norm keeps all constraints."""
        rng = np.random.default_rng(seed)
        for _ in range(count):
            q = self.configuration(rng)
            at_rest = Snapshot(self, q, np.zeros(self.robot.nv))
            v = at_rest.UNbar @ rng.normal(size=self.robot.actuated.size)
            yield Snapshot(self, q, v * (speed / np.linalg.norm(v)), rng)

    def free_states(self, count: int, seed: int) -> Iterator[Snapshot]:
        """The configurations of ``states`` with any velocity; the base also turns and lifts."""
        rng = np.random.default_rng(seed)
        for _ in range(count):
            q = self.configuration(rng)
            yield Snapshot(self, q, rng.normal(size=self.robot.nv), rng)


def _common(robot: Robot) -> tuple[float, float]:
    hip, thorax = robot.joints(["torso_hip", "torso_thorax"])
    return (
        max(float(robot.lower[hip]), float(robot.lower[thorax])),
        min(float(robot.upper[hip]), float(robot.upper[thorax])),
    )


@dataclass
class Snapshot:
    """One state and the paper's formulas at it, each by its definition."""

    ground: Ground
    q: Vec
    v: Vec
    rng: np.random.Generator = field(default_factory=lambda: np.random.default_rng(0))

    def __post_init__(self) -> None:
        model = self.ground.robot.model
        data: Any = model.createData()
        self.model, self.data = model, data
        pin.computeAllTerms(model, data, self.q, self.v)
        pin.computeJointJacobiansTimeVariation(model, data, self.q, self.v)
        pin.updateFramePlacements(model, data)
        self.A: Mat = np.triu(data.M) + np.triu(data.M, 1).T
        self.bias: Vec = np.array(data.nle)
        self.gravity: Vec = np.array(pin.computeGeneralizedGravity(model, model.createData(), self.q))

    def frame(self, name: str) -> tuple[Vec, Mat, Mat, Mat]:
        """Position, rotation, J and dJ/dt ``(6, nv)`` of a frame, world axes."""
        index = self.model.getFrameId(name)
        placement = self.data.oMf[index]
        J = pin.getFrameJacobian(self.model, self.data, index, _WORLD)
        dJ = pin.getFrameJacobianTimeVariation(self.model, self.data, index, _WORLD)
        return placement.translation.copy(), placement.rotation.copy(), J, dJ

    def wheel_rows(self, wheel: str, axle: Vec | None = None, normal: Vec | None = None) -> tuple[Mat, Mat]:
        """Rolling and normal row of a wheel, and their time derivative, ``(2, nv)`` each (eqs. 9 to 11 corrected).

        u = n x a / |n x a| with a the axle and delta = -r n from the centre to the contact.
        """
        n, about = self.ground.normal if normal is None else normal, self.ground.robot.wheels[wheel]
        _, _, J, dJ = self.frame(wheel)
        _, R, Jb, _ = self.frame("base")
        turn = Jb[3:] @ self.v
        a = R @ np.array(about.axle if axle is None else axle)
        da = np.cross(turn, a)
        across = np.cross(n, a)
        length = np.linalg.norm(across)
        u = across / length
        du = (np.eye(3) - np.outer(u, u)) @ np.cross(n, da) / length
        delta = skew(-about.radius * n)
        contact, contact_rate = J[:3] - delta @ J[3:], dJ[:3] - delta @ dJ[3:]
        rows = np.vstack((u @ contact, n @ contact))
        rates = np.vstack((u @ contact_rate + du @ contact, n @ contact_rate))
        return rows, rates

    def assemble(self, axles: dict[str, Vec] | None = None, normals: dict[str, Vec] | None = None) -> tuple[Mat, Mat]:
        """J_constr and its rate ``(7, nv)``: the biarticular row, then each wheel's two (eqs. 5, 8, 11)."""
        biart = np.zeros((1, self.ground.robot.nv))
        hip, thorax = self.ground.robot.joints(["torso_hip", "torso_thorax"])
        biart[0, hip], biart[0, thorax] = 1.0, -1.0
        pairs = [self.wheel_rows(w, (axles or {}).get(w), (normals or {}).get(w)) for w in WHEELS]
        return np.vstack([biart, *(p[0] for p in pairs)]), np.vstack([0.0 * biart, *(p[1] for p in pairs)])

    @cached_property
    def constraints(self) -> tuple[Mat, Mat]:
        """J_constr and dJ_constr/dt."""
        return self.assemble()

    @property
    def J(self) -> Mat:
        """J_constr ``(7, nv)``."""
        return self.constraints[0]

    @property
    def dJ(self) -> Mat:
        """dJ_constr/dt ``(7, nv)``."""
        return self.constraints[1]

    @cached_property
    def inverse(self) -> tuple[Mat, Mat]:
        """[K, UNbar] = [J_constr; U]^-1: independent of the inertia."""
        both = np.linalg.inv(np.vstack((self.J, self.ground.U)))
        return both[:, : self.J.shape[0]], both[:, self.J.shape[0] :]

    @property
    def UNbar(self) -> Mat:
        """``(nv, n)`` with qd = UNbar q_act on the constraints (eq. 13)."""
        return self.inverse[1]

    def star(self, J: Mat, dJ: Mat) -> tuple[Mat, Mat]:
        """J* = J UNbar and its rate (dJ - J K dJ_constr) UNbar (eq. 17)."""
        K, UNbar = self.inverse
        return J @ UNbar, (dJ - J @ K @ self.dJ) @ UNbar

    @property
    def q_act(self) -> Vec:
        """Velocities of the actuated joints."""
        return self.ground.U @ self.v

    def kkt(self, tau: Vec) -> tuple[Vec, Vec]:
        """qdd and lambda of eq. (2) with J qdd + dJ qd = 0 as one linear system, without the paper's formulas."""
        nv, m = self.A.shape[0], self.J.shape[0]
        system = np.block([[self.A, self.J.T], [self.J, np.zeros((m, m))]])
        right = np.concatenate((self.ground.U.T @ tau - self.bias, -self.dJ @ self.v))
        scale = np.concatenate((1.0 / np.sqrt(np.diag(self.A)), np.ones(m)))
        scaled = system * np.outer(scale, scale)
        x = np.linalg.solve(scaled, right * scale)
        x = (x + np.linalg.solve(scaled, right * scale - scaled @ x)) * scale  # refined once
        return x[:nv], x[nv:]

    @cached_property
    def hand(self) -> tuple[Mat, Mat]:
        """J and dJ/dt of the hand's position in the world ``(3, nv)`` (eq. 47)."""
        _, _, J, dJ = self.frame("hand")
        return J[:3], dJ[:3]

    @cached_property
    def com(self) -> tuple[Mat, Mat]:
        """J and dJ/dt of the upper body's centre of mass ``(2, nv)``, divided by the upper body's own mass (eq. 46)."""
        _, J, dJ, _ = self.upper_body()
        return J[:2], dJ[:2]

    def upper_body(self) -> tuple[Vec, Mat, Mat, float]:
        """Centre ``(3,)``, J and dJ/dt ``(3, nv)`` summed body by body, and the mass summed over."""
        c, J, dJ = np.zeros(3), np.zeros((3, self.v.size)), np.zeros((3, self.v.size))
        total = 0.0
        for joint in self.ground.bodies:
            inertia = self.model.inertias[joint]
            arm = self.data.oMi[joint].rotation @ inertia.lever
            Jj = pin.getJointJacobian(self.model, self.data, joint, _WORLD)
            dJj = pin.getJointJacobianTimeVariation(self.model, self.data, joint, _WORLD)
            turn = Jj[3:] @ self.v
            c += inertia.mass * (self.data.oMi[joint].translation + arm)
            J += inertia.mass * (Jj[:3] - skew(arm) @ Jj[3:])
            dJ += inertia.mass * (dJj[:3] - skew(arm) @ dJj[3:] - skew(np.cross(turn, arm)) @ Jj[3:])
            total += inertia.mass
        return c / total, J / total, dJ / total, total

    @property
    def posture(self) -> tuple[Mat, Mat]:
        """S_act^upper ``(9, nv)`` and its rate, zero (eq. 56)."""
        return self.ground.S, 0.0 * self.ground.S

    def at(self, v: Vec, t: float) -> Snapshot:
        """The snapshot after moving along v for time t, at the same velocity."""
        return Snapshot(self.ground, pin.integrate(self.model, self.q, v * t), self.v, self.rng)
