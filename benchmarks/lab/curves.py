"""Smooth references: ramps, sine, figure-8; gain and lag of the response to a sine."""

from __future__ import annotations

import math

import numpy as np

from hqp.arrays import Mat, Vec


def smooth(s: float) -> float:
    """Quintic from 0 to 1 for s from 0 to 1, with zero velocity and acceleration at both ends."""
    s = min(max(s, 0.0), 1.0)
    return s * s * s * (10.0 - 15.0 * s + 6.0 * s * s)


def side(t: float, amplitude: float, frequency: float) -> Vec:
    """Offset ``(2,)`` [m] to the left and right, its amplitude grown over the first period."""
    phase = frequency * t
    return np.array([0.0, amplitude * smooth(phase) * math.sin(2.0 * math.pi * phase)])


def figure_eight(t: float, across: float, up: float, frequency: float) -> Vec:
    """Offset ``(3,)`` [m] on a figure-8 in the frontal plane, grown over the first quarter of a period."""
    phase, grown = 2.0 * math.pi * frequency * t, smooth(4.0 * frequency * t)
    return np.array([0.0, grown * across * math.sin(phase), grown * up * math.sin(2.0 * phase)])


def response(t: Vec, wanted: Vec, actual: Vec, frequency: float) -> tuple[float, float]:
    """Gain and lag [s] of ``actual`` behind ``wanted``, both ``(ticks,)``, at a frequency [Hz].

    The window is the last whole periods within half the time.
    """
    step = t[1] - t[0]
    periods = max(1, math.floor(0.5 * (t[-1] - t[0]) * frequency))
    count = round(periods / (frequency * step))
    wave = np.exp(-2j * math.pi * frequency * t[-count:])
    ratio = np.mean(actual[-count:] * wave) / np.mean(wanted[-count:] * wave)
    return float(abs(ratio)), float(-np.angle(ratio) / (2.0 * math.pi * frequency))


def rms(errors: Mat) -> float:
    """Root of the mean square length of errors ``(ticks, k)`` or ``(ticks,)``."""
    squared = np.square(errors) if errors.ndim == 1 else np.square(errors).sum(axis=1)
    return float(np.sqrt(squared.mean()))


def largest(errors: Mat) -> float:
    """The greatest length of errors ``(ticks, k)`` or ``(ticks,)``."""
    return float(np.abs(errors).max()) if errors.ndim == 1 else float(np.linalg.norm(errors, axis=1).max())
