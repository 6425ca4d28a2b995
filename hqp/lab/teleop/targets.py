"""Targets of a library without a source of references: the latest packet, as it is or smoothed."""

from __future__ import annotations

import math

import numpy as np

from hqp.arrays import Mat, Vec

from .families import Family

TAU = 0.06
"""Time constant of the usual filter [s]."""


def latest(one: Family, seconds: float, dt: float) -> Mat:
    """The shift of the latest packet at each tick ``(n, 3)`` [m]."""
    packets, found, now = list(one.packets(seconds)), np.zeros((round(seconds / dt), 3)), np.zeros(3)
    k = 0
    for i in range(len(found)):
        while k < len(packets) and packets[k][0] <= i * dt:
            now = packets[k][1]
            k += 1
        found[i] = now
    return found


def smoothed(shifts: Mat, dt: float) -> Mat:
    """The usual filter: exponential smoothing of 60 ms at the rate of the loop."""
    share, found = 1.0 - math.exp(-dt / TAU), np.empty_like(shifts)
    now: Vec = shifts[0]
    for i, shift in enumerate(shifts):
        now = now + share * (shift - now)
        found[i] = now
    return found
