"""Derivatives of the twists of joints by the configuration."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from hqp.arrays import Mat, Vec, cross
from hqp.declare.robot import State


def twist_derivatives(state: State, v: Vec | None = None) -> tuple[Mat, Mat, Mat, Mat]:
    """(V, A, t', t''): velocities and drifts of the bodies ``(n, 6)``, derivatives of the joints' twists ``(6, nv)``.

    v: velocity of the joints ``(nv,)``, by default that of the state.

    At zero acceleration a twist turns with its body: t' = V x t, t'' = A x t + V x (V x t), at the world's origin.
    """
    robot, v = state.robot, state.v if v is None else v
    state.kinematics()
    twists = np.array(robot.joint_twists)
    bodies = robot.bodies
    V, A = np.zeros((len(bodies), 6)), np.zeros((len(bodies), 6))
    first, second = np.zeros_like(twists), np.zeros_like(twists)
    for i, (parent, start, count, *_) in enumerate(bodies[1:], start=1):
        own = slice(start, start + count)
        step = twists[:, own] @ v[own]
        V[i] = V[parent] + step
        A[i] = A[parent] + _cross(V[i], step)
        first[:, own] = _cross(V[i], twists[:, own].T).T
        second[:, own] = _cross(A[i], twists[:, own].T).T + _cross(V[i], first[:, own].T).T
    return V, A, first, second


def _cross(V: NDArray[np.float64], t: NDArray[np.float64]) -> NDArray[np.float64]:
    """V x t of motions ``(6,)``, linear first, for each row of t."""
    linear = cross(V[3:], t[..., :3]) + cross(V[:3], t[..., 3:])
    return np.concatenate((linear, cross(V[3:], t[..., 3:])), axis=-1)
