"""Rotations: conversion of user input, and roll, pitch and yaw with their rates."""

from __future__ import annotations

import math
from collections.abc import Sequence
from typing import Any

import numpy as np

from hqp.arrays import Mat, Vec
from hqp.declare.reference import numbers
from hqp.errors import DeclarationError

from .relative import Triple

try:
    from hqp import _assembly as native
except ImportError:  # no compiler was there
    native = None  # type: ignore[assignment]

ALLOWED = "a rotation matrix (3, 3) or a quaternion x, y, z, w"
GIMBAL = 1e-3  # |cos pitch| below which roll and yaw rates are held at their bound
ORTHONORMAL = 1e-5
UNIT = 1e-3
"""A quaternion whose length is further than this from one is normalised with a remark, in a state it is refused."""


def as_rotation(element: str, value: Any, remarks: list[str] | None = None) -> Mat:
    """A rotation matrix ``(3, 3)`` from one, or from a quaternion xyzw of any length.

    remarks: takes a sentence on a quaternion that is not of length one.  NaN and infinities pass: the loop reports
    them.  Raises DeclarationError for another shape, a matrix that is no rotation, a quaternion of zeros.
    """
    try:
        array = np.asarray(value, dtype=np.float64)
    except (TypeError, ValueError, OverflowError) as error:
        raise DeclarationError(element, "rotation is not numeric", value=value, allowed=ALLOWED) from error
    if array.shape == (4,):
        return _from_quaternion(element, array, remarks)
    R = numbers(element, f"rotation ({ALLOWED})", array, (3, 3))
    if native is not None and native.is_rotation(R, ORTHONORMAL):
        return R
    x, y, z = a = R.tolist()
    off = max(abs(sum(map(float.__mul__, a[i], a[j])) - (i == j)) for i in range(3) for j in range(i, 3))
    flat = R.ravel()
    finite = float(flat @ flat) < math.inf
    if finite and (off > ORTHONORMAL or _triple_product(x, y, z) < 0.0):
        raise DeclarationError(element, "not a rotation matrix", value=value, allowed=ALLOWED)
    return R


def is_pose(T: Mat) -> bool:
    """Return true if a ``(4, 4)`` is known to be finite and homogeneous with a rotation; False where nothing native
    is."""
    return native is not None and native.is_pose(T, ORTHONORMAL)


def _from_quaternion(element: str, quaternion: Vec, remarks: list[str] | None) -> Mat:
    x, y, z, w = quaternion.tolist()
    square = x * x + y * y + z * z + w * w
    if square == 0.0:
        raise DeclarationError(element, "zero quaternion", allowed=ALLOWED)
    length = math.sqrt(square)
    if remarks is not None and abs(length - 1.0) > UNIT:  # false for NaN, which the loop reports
        remarks.append(f"target quaternion x, y, z, w of length {length:.4g} was normalised; allowed: 1 +- {UNIT:g}")
    s = 2.0 / square
    return np.array(
        [
            [1.0 - s * (y * y + z * z), s * (x * y - z * w), s * (x * z + y * w)],
            [s * (x * y + z * w), 1.0 - s * (x * x + z * z), s * (y * z - x * w)],
            [s * (x * z - y * w), s * (y * z + x * w), 1.0 - s * (x * x + y * y)],
        ]
    )


def _triple_product(a: list[float], b: list[float], c: list[float]) -> float:
    return a[0] * (b[1] * c[2] - b[2] * c[1]) + a[1] * (b[2] * c[0] - b[0] * c[2]) + a[2] * (b[0] * c[1] - b[1] * c[0])


def roll_pitch_yaw(R: list[list[float]]) -> Triple:
    """Angles of R = Rz(yaw) Ry(pitch) Rx(roll) [rad]; pitch in [-pi/2, pi/2], roll zero-based where cos pitch is 0."""
    (r00, _, _), (r10, _, _), (r20, r21, r22) = R
    return math.atan2(r21, r22), math.atan2(-r20, math.sqrt(r00 * r00 + r10 * r10)), math.atan2(r10, r00)


def rate_rows(pitch: float, yaw: float) -> tuple[Triple, Triple, Triple]:
    """Rows of E(rpy)^-1: roll, pitch and yaw rates from the angular velocity in the axes R is in.

    Within GIMBAL of pitch = +-90 degrees, where roll and yaw mean nothing, rows stay bounded by 1 / GIMBAL.
    """
    c, s = math.cos(yaw), math.sin(yaw)
    inverse = 1.0 / max(math.cos(pitch), GIMBAL)
    tangent = math.sin(pitch) * inverse
    return (c * inverse, s * inverse, 0.0), (-s, c, 0.0), (c * tangent, s * tangent, 1.0)


def axes_rate(pitch: float, yaw: float, rates: Sequence[float]) -> Triple:
    """dE/dt (roll, pitch, yaw rates): d omega/dt minus E times the second derivatives of the angles."""
    c, s, cp, sp = math.cos(yaw), math.sin(yaw), math.cos(pitch), math.sin(pitch)
    roll, turn, spin = rates
    return (
        roll * (-sp * c * turn - cp * s * spin) - turn * c * spin,
        roll * (-sp * s * turn + cp * c * spin) - turn * s * spin,
        -roll * cp * turn,
    )
