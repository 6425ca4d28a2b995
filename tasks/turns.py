"""Derivatives of a rotation vector: bounds on one need them, exact at every angle below 2 pi."""

from __future__ import annotations

import math

import numpy as np

from hqp.arrays import Mat, Vec

from .relative import skew

SMALL = 0.1  # angle below which series are more exact [rad]


def rate_map(turn: Vec) -> Mat:
    """B ``(3, 3)`` with d(turn)/dt = B omega: 1 - [turn]x / 2 + b [turn]x^2, b = (1 - (t/2) cot(t/2)) / t^2.

    t is the length of the vector; omega is the angular velocity in the axes that the rotation is in.
    """
    b, _ = _curvature(turn)
    K = skew(turn)
    return np.asarray(np.eye(3) - 0.5 * K + b * (K @ K))


def rate_map_change(turn: Vec, rate: Vec) -> Mat:
    """dB/dt ``(3, 3)`` where the rotation vector changes at ``rate`` ``(3,)``."""
    b, slope = _curvature(turn)
    K, k = skew(turn), skew(rate)
    return np.asarray(-0.5 * k + slope * float(turn @ rate) * (K @ K) + b * (k @ K + K @ k))


def _curvature(turn: Vec) -> tuple[float, float]:
    """b, and its derivative by t over t."""
    t = math.hypot(*turn.tolist())
    if t < SMALL:
        return 1.0 / 12.0 + t * t / 720.0 + t**4 / 30240.0, 1.0 / 360.0 + t * t / 7560.0
    cot, sine = 1.0 / math.tan(0.5 * t), math.sin(0.5 * t)
    return (1.0 - 0.5 * t * cot) / t**2, (-2.0 / t**3 + cot / (2.0 * t * t) + 1.0 / (4.0 * t * sine * sine)) / t
