"""The prioritised controllers of Sentis 2012 in NumPy: as printed, and with the terms that the print omits."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from benchmarks.sentis2012.equations.ground import pinv, symmetric_pinv
from hqp.arrays import Mat, Vec

CUT = 1e-9
"""Relative cut-off of the eigenvalues of J_k| phi* J_k|^T."""


@dataclass(frozen=True)
class Demand:
    """Task of the hierarchy: J* and dJ*/dt ``(k, n)``, desired acceleration."""

    J: Mat
    dJ: Mat
    a: Vec


@dataclass(frozen=True)
class Step:
    """One level: its prioritised Jacobian, dynamically consistent inverse and inertia, and the next null space."""

    J: Mat
    Jbar: Mat
    Lambda: Mat
    N: Mat


def prioritise(phi: Mat, jacobians: Sequence[Mat]) -> list[Step]:
    """J_k| = J*_k N_{k-1}, Jbar_k| = phi* J_k|^T (J_k| phi* J_k|^T)^+, N_k = N_{k-1} - Jbar_k| J_k| (eqs. 49 to 53).

    In eq. (53) Jbar_hand is that of the prioritised Jacobian: with the other J_com N does not vanish.
    """
    steps, N = [], np.eye(phi.shape[0])
    for J_star in jacobians:
        J = J_star @ N
        Lambda = _inverse(J @ phi @ J.T, J_star @ phi @ J_star.T)
        Jbar = phi @ J.T @ Lambda
        N = N - Jbar @ J
        steps.append(Step(J, Jbar, Lambda, N))
    return steps


def printed(phi: Mat, g: Vec, tasks: Sequence[Demand]) -> Vec:
    """tau = sum_k J_k|^T (Lambda_k| a_k + Jbar_k|^T g*) (eqs. 48, 57 to 59): no mu*, no coupling between levels."""
    tau = np.zeros(phi.shape[0])
    for step, task in zip(prioritise(phi, [t.J for t in tasks]), tasks, strict=True):
        tau += step.J.T @ (step.Lambda @ task.a + step.Jbar.T @ g)
    return tau


def compensated(phi: Mat, h: Vec, tasks: Sequence[Demand], q_act: Vec) -> Vec:
    """tau_k = tau_{k-1} + J_k|^T Lambda_k| (a_k - dJ*_k q_act + J*_k phi* h - J*_k phi* tau_{k-1})."""
    tau = np.zeros(phi.shape[0])
    for step, task in zip(prioritise(phi, [t.J for t in tasks]), tasks, strict=True):
        tau = tau + step.J.T @ (step.Lambda @ (task.a - task.dJ @ q_act + task.J @ (phi @ (h - tau))))
    return tau


def self_motion(phi: Mat, h: Vec, task: Demand, v: Vec, q_act: Vec) -> tuple[Vec, Vec]:
    """(tau, tau_posture) of one task and the posture x = q_act with demand v (eqs. 27, 30 to 39, gravity counted once).

    F_posture = phi_p|t^+ (v - qdd_before) with qdd_before = -phi* h + phi* J*^T F_task.
    """
    (step,) = prioritise(phi, [task.J])
    tau_task = step.J.T @ (step.Lambda @ (task.a - task.dJ @ q_act + task.J @ (phi @ h)))
    phi_pt = step.N @ phi @ step.N.T
    before = phi @ (tau_task - h)
    tau_posture = step.N.T @ (symmetric_pinv(phi_pt, CUT) @ (v - before))
    return tau_task + tau_posture, tau_posture


def orthogonal_projector(J: Mat) -> Mat:
    """Phi = I - J*^+ J*: onto the self motions of the task (eq. 39)."""
    return np.eye(J.shape[1]) - pinv(J) @ J


def projector_rate(J: Mat, dJ: Mat) -> Mat:
    """dPhi/dt = -(J^+ dJ Phi) - (J^+ dJ Phi)^T."""
    half = pinv(J) @ dJ @ orthogonal_projector(J)
    return -half - half.T


def posture_demand(Phi: Mat, dPhi: Mat, e: Vec, rate: Vec, gains: tuple[float, float, float], sign: float = 1.0) -> Vec:
    """v of eq. (41), gains (kp, kv, ke); sign = -1 as printed, +1 for dV/dt = -ke E^T E."""
    kp, kv, ke = gains
    y = -kp * e - kv * rate
    return np.asarray((ke * (Phi @ y) - kp * rate + sign * (dPhi @ y)) / kv)


def _inverse(M: Mat, whole: Mat) -> Mat:
    values, vectors = np.linalg.eigh(0.5 * (M + M.T))
    # a vanishing projected Jacobian needs the unprojected one's scale: its own is rounding
    floor = max(CUT * values.max(initial=0.0), 1e-13 * np.linalg.norm(whole, 2))
    kept = values > floor
    return np.asarray((vectors[:, kept] / values[kept]) @ vectors[:, kept].T)
