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
    bodies, twists = robot.bodies, np.array(robot.joint_twists).T
    V, steps, carrier = np.zeros((len(bodies), 6)), np.zeros((len(bodies), 6)), np.zeros(robot.nv, dtype=np.intp)
    for i, (parent, start, count, *_) in enumerate(bodies[1:], start=1):
        own = slice(start, start + count)
        steps[i] = v[own] @ twists[own]
        V[i], carrier[own] = V[parent] + steps[i], i
    A = _cross(V, steps)
    for i, (parent, *_) in enumerate(bodies[1:], start=1):
        A[i] += A[parent]
    first = _cross(V[carrier], twists)
    second = _cross(A[carrier], twists) + _cross(V[carrier], first)
    return V, A, first.T, second.T


def _cross(V: NDArray[np.float64], t: NDArray[np.float64]) -> NDArray[np.float64]:
    """V x t of motions ``(..., 6)``, linear first."""
    linear = cross(V[..., 3:], t[..., :3]) + cross(V[..., :3], t[..., 3:])
    return np.concatenate((linear, cross(V[..., 3:], t[..., 3:])), axis=-1)
