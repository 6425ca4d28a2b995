"""Coordinates of the motors: T with U T = [1, 0], for robots whose motors pull one joint each or several by tendons."""

from __future__ import annotations

from typing import Any

import numpy as np

from hqp.arrays import Index, Mat


def pivots(U: Mat) -> Index:
    """A coordinate of its own for each motor ``(n,)``, by Gaussian elimination; U ``(n, nv)`` has full row rank."""
    rows, found = U.copy(), np.zeros(len(U), dtype=np.intp)
    for k in np.argsort(np.count_nonzero(U, axis=1), kind="stable"):
        found[k] = column = np.abs(rows[k]).argmax()
        later = np.arange(len(U)) != k
        rows[later] -= np.outer(rows[later, column] / rows[k, column], rows[k])
    return found


def motor_axes(U: Mat) -> Mat:
    """T ``(nv, nv)``, qd = T y: y has U qd at the pivots and qd elsewhere."""
    y = np.eye(U.shape[1])
    y[pivots(U)] = U
    return np.asarray(np.linalg.inv(y), dtype=np.float64) if np.count_nonzero(U) > len(U) else y


def passive_motions(U: Mat) -> Mat:
    """Basis ``(nv, nv - n)`` of the motions in which no motor moves."""
    return np.delete(motor_axes(U), pivots(U), axis=1)


def motor_parts(U: Mat) -> dict[str, Any]:
    """Data of the native elimination: a coordinate of each motor, the entries of U, and T for motors of tendons."""
    motors, joints = np.nonzero(U)
    entries = {"motors": motors.tolist(), "joints": joints.tolist(), "factors": U[motors, joints].tolist()}
    axes = motor_axes(U).ravel().tolist() if motors.size > len(U) else None
    return {"actuated": pivots(U).tolist(), **entries, "axes": axes}
