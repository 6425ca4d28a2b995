"""References by singular values, written from the definitions and independent of the library that they judge."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np

from hqp.arrays import Mat, Vec

CUT = 1e-10
"""Singular values below this share of the unprojected largest one count as zero."""


def pinv(A: Mat, size: float | None = None) -> Mat:
    """A^+ by singular values; ``size``: norm of the relative cut-off, by default that of A."""
    U, s, Vt = np.linalg.svd(A, full_matrices=False)
    keep = s > CUT * (s.max(initial=0.0) if size is None else size)
    return np.asarray((Vt[keep].T / s[keep]) @ U[:, keep].T)


def right_inverse(A: Mat) -> Mat:
    """A^T (A A^T)^-1, as printed below eq. (7); meaningless without full row rank."""
    return np.asarray(np.linalg.solve(A @ A.T, A).T)


def projector(A: Mat) -> Mat:
    """N = I - A^+ A (below eq. 16)."""
    return np.eye(A.shape[1]) - pinv(A) @ A


def rank(A: Mat) -> int:
    """Number of singular values above the cut-off."""
    s = np.linalg.svd(A, compute_uv=False)
    return int(np.count_nonzero(s > 1e-9 * s.max(initial=0.0)))


def as_printed(levels: Sequence[tuple[Mat, Vec]]) -> Vec:
    """Eq. (16): J_A^+ x_A + N_A J_B^+ x_B + N_AB J_E^+ x_E."""
    x = np.zeros(levels[0][0].shape[1])
    above = np.zeros((0, x.size))
    for J, target in levels:
        x = x + (projector(above) if above.size else np.eye(x.size)) @ pinv(J) @ target
        above = np.concatenate((above, J))
    return x


def siciliano_slotine(levels: Sequence[tuple[Mat, Vec]]) -> Vec:
    """nu_k = nu_{k-1} + (J_k N_{k-1})^+ (x_k - J_k nu_{k-1}) with N_k = N_{k-1} - (J_k N_{k-1})^+ J_k N_{k-1}."""
    n = levels[0][0].shape[1]
    x, N = np.zeros(n), np.eye(n)
    for J, target in levels:
        projected = J @ N
        inverse = pinv(projected, float(np.linalg.norm(J, 2)))
        x = x + inverse @ (target - J @ x)
        N = N - inverse @ projected
    return x


def skew(a: Vec) -> Mat:
    """[a]x."""
    return np.array([[0.0, -a[2], a[1]], [a[2], 0.0, -a[0]], [-a[1], a[0], 0.0]])


def largest(difference: Mat | Vec) -> float:
    """The largest entry in size."""
    return float(np.abs(difference).max(initial=0.0))


def rpy(R: Mat) -> Vec:
    """Roll, pitch, yaw of R = Rz(yaw) Ry(pitch) Rx(roll)."""
    return np.array([
        np.arctan2(R[2, 1], R[2, 2]), np.arctan2(-R[2, 0], np.hypot(R[0, 0], R[1, 0])), np.arctan2(R[1, 0], R[0, 0])
    ])  # fmt: skip


def rates_to_angular(angles: Vec) -> Mat:
    """E with omega = E d(rpy)/dt, world axes; singular at pitch 90 deg."""
    _, pitch, yaw = angles
    return np.array([
        [np.cos(yaw) * np.cos(pitch), -np.sin(yaw), 0.0],
        [np.sin(yaw) * np.cos(pitch), np.cos(yaw), 0.0],
        [-np.sin(pitch), 0.0, 1.0],
    ])  # fmt: skip


def rotation_vector(R: Mat) -> Vec:
    """w with exp([w]x) = R, for rotations well below half a turn."""
    vee = 0.5 * np.array([R[2, 1] - R[1, 2], R[0, 2] - R[2, 0], R[1, 0] - R[0, 1]])
    sine = float(np.linalg.norm(vee))
    if sine < 1e-12:
        return vee
    return vee * (np.arctan2(sine, 0.5 * (np.trace(R) - 1.0)) / sine)
