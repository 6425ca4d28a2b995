"""Differences of angles: whole turns do not count."""

from __future__ import annotations

import math

import numpy as np

from hqp.arrays import Vec


def wrapped(angle: float) -> float:
    """Return the equal angle within [-pi, pi], so the shortest turn for a difference of two [rad]; NaN unless
    finite."""
    return math.remainder(angle, math.tau) if math.isfinite(angle) else math.nan


def all_wrapped(angles: Vec) -> Vec:
    """``wrapped`` of each ``(k,)`` [rad]."""
    return np.array([wrapped(angle) for angle in angles.tolist()])
