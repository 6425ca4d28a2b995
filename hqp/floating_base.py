"""A free base seen through its constraints: base velocity from joint velocities, and velocities made consistent."""

from __future__ import annotations

import numpy as np

from hqp.arrays import Mat, Vec, rank
from hqp.errors import ProblemError
from hqp.tolerances import RANK_TOLERANCE


def base_velocity(J_C: Mat, joint_velocity: Vec) -> Vec:
    """v_b = -J_Cb^+ J_Cr qd_r ``(6,)``: the base velocity that constraints at rest imply (Mistry 2008, eq. 10).

    J_C: ``(k, 6 + n)``, base columns first, rank of its base part 6 (condition 3).  joint_velocity: ``(n,)`` [rad/s],
    in the closed chains' subspace where k > 6.  Raises ProblemError for shapes, or for a base left under-constrained.
    """
    base, joints = _parts(J_C, joint_velocity)
    if base_rank(J_C) < 6:
        raise ProblemError(f"the constraints leave the base free: rank {base_rank(J_C)} of 6 (condition 3)")
    return np.asarray(-np.linalg.lstsq(base, joints @ joint_velocity, rcond=RANK_TOLERANCE)[0], dtype=np.float64)


def generalized_velocity(J_C: Mat, joint_velocity: Vec) -> Vec:
    """v = [-J_Cb^+ J_Cr; I] qd_r ``(6 + n,)`` (eq. 11, read as a vertical stack); raises as ``base_velocity``."""
    return np.concatenate((base_velocity(J_C, joint_velocity), joint_velocity))


def base_rank(J_C: Mat) -> int:
    """Rank of the base columns of J_C: 6 where the joints determine the base (condition 3)."""
    return rank(J_C[:, :6], RANK_TOLERANCE)


def consistent_velocity(J_C: Mat, v: Vec) -> Vec:
    """N_C v = (I - J_C^+ J_C) v ``(nv,)``: a measured velocity without its violation of the constraints.

    J_C holds the contacts alone: with the centre of mass among its rows its true velocity would be erased
    (Mistry 2008, below eq. 22, whose N_A is to be read as N_C).
    """
    return np.asarray(v - np.linalg.lstsq(J_C, J_C @ v, rcond=RANK_TOLERANCE)[0], dtype=np.float64)


def _parts(J_C: Mat, joint_velocity: Vec) -> tuple[Mat, Mat]:
    if J_C.ndim != 2 or J_C.shape[1] != 6 + joint_velocity.shape[0]:
        raise ProblemError(f"J_C {J_C.shape} needs 6 + n columns, n = {joint_velocity.shape[0]} joints")
    return J_C[:, :6], J_C[:, 6:]
