"""The linear inverted pendulum: a plan of the ZMP and the divergent component of motion that follows from it."""

from __future__ import annotations

import math
from collections.abc import Iterable, Sequence
from dataclasses import dataclass
from itertools import pairwise

import numpy as np

from hqp import _session
from hqp.arrays import Vec
from hqp.declare.reference import numbers
from hqp.declare.robot import State
from hqp.errors import DeclarationError
from hqp.kinds import require
from hqp.numbers import number, set_numbers

GRAVITY = 9.81
"""Gravity of the Earth [m/s^2]."""


def natural_frequency(height: float, gravity: float = GRAVITY) -> float:
    """omega = sqrt(g / height) [1/s] of a CoM at a height above the ground [m]; raises DeclarationError."""
    height = number("pendulum", "height", height, 0.0, strict=True, unit="m")
    gravity = number("pendulum", "gravity", gravity, 0.0, strict=True, unit="m/s^2")
    return math.sqrt(gravity / height)


def capture_point(state: State, omega: float) -> Vec:
    """xi = c + dc/dt / omega ``(2,)`` [m]: standing there, the robot comes to rest (Pratt et al. 2006, eq. 5)."""
    return np.asarray(state.com()[:2] + state.com_velocity()[:2] / omega)


@dataclass(frozen=True)
class Piece:
    """The ZMP moves in a line from ``start`` to ``end`` ``(2,)`` [m] in ``duration`` [s].  Raises DeclarationError."""

    duration: float
    start: Vec
    end: Vec

    def __post_init__(self) -> None:
        set_numbers(self, "piece", ("duration",), 0.0)
        for field in ("start", "end"):
            place = numbers("piece", field, getattr(self, field), (2,))
            if not np.isfinite(place).all():
                raise DeclarationError("piece", f"bad {field}", value=place, unit="m", allowed="finite numbers")
            object.__setattr__(self, field, place)


class DcmPlan:
    """The DCM xi of a ZMP p that is linear piece by piece, in closed form (Englsberger, Ott, Albu-Schaeffer 2015).

    From d xi/dt = omega (xi - p), with p = a + r t in a piece of duration T,

        xi(t) = p(t) + r / omega + (xi(T) - p(T) - r / omega) exp(-omega (T - t)),

    backwards from the last piece, at whose end the DCM is on the ZMP: there the pendulum rests. Raises DeclarationError
    for no piece, and for pieces that are not joined.
    """

    def __init__(self, pieces: Sequence[Piece], omega: float) -> None:
        omega = number("DCM plan", "omega", omega, 0.0, strict=True, unit="1/s")
        require("DCM plan", "pieces", pieces, Iterable, "a sequence of Piece(duration, start, end)")
        pieces = list(pieces)
        for piece in pieces:
            require("DCM plan", "piece", piece, Piece, "Piece(duration, start, end)")
        kept = [p for p in pieces if p.duration > 0.0]
        if not kept:
            raise DeclarationError("DCM plan", "all pieces have zero duration", value=len(pieces))
        for one, other in pairwise(kept):
            if np.abs(one.end - other.start).max() > 1e-9:
                raise DeclarationError("DCM plan", "pieces are not continuous", value=(one.end, other.start), unit="m")
        self.omega = omega
        self._plan = _session.DcmPlan([(p.duration, tuple(p.start), tuple(p.end)) for p in kept], omega)

    @property
    def duration(self) -> float:
        """Sum of the durations of the pieces [s]."""
        return self._plan.duration

    def at(self, time: float) -> tuple[Vec, Vec]:
        """ZMP and DCM ``(2,)`` each [m]; before the start those of the start, after the end those of the end."""
        zmp, dcm = self._plan.at(number("DCM plan", "time", time, unit="s"))
        return np.array(zmp), np.array(dcm)
