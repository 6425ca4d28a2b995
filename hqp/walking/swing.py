"""The path of a foot in the air: smooth, to a goal that may move, then down until it finds the ground."""

from __future__ import annotations

import math

import numpy as np

from hqp import _session
from hqp.arrays import Vec
from hqp.declare.reference import numbers
from hqp.errors import DeclarationError
from hqp.numbers import number

RISE, LEAD = _session.Swing.RISE, _session.Swing.LEAD
"""Share of the swing time at the foot's highest point; time before the landing at which it is above its goal [s]."""

FOLLOWS, SINKS, FALLS = _session.Swing.FOLLOWS, _session.Swing.SINKS, _session.Swing.FALLS
"""Shortest time to a moved goal [s]; growth of the downward acceleration of a foot without ground [m/s^3]; largest
acceleration of a foot on its way down [m/s^2]."""


class Swing:
    """Position and yaw of a foot from lift-off to touch-down: each tick a polynomial from where it is to its goal.

    start, goal: (x, y, z, yaw) ``(4,)`` [m, rad].  duration [s].  height: above the higher of start and goal [m].
    search: speed downwards at the goal, LEAD before the landing, which grows after it, until ``depth`` below it
    [m/s, m].  The foot takes the shorter turn to the yaw of its goal.  The path is twice continuously differentiable
    while the goal stays where it is; if the goal moves (``retarget``), position, velocity and acceleration stay
    continuous.
    Raises DeclarationError for fields.
    """

    def __init__(
        self, start: Vec, goal: Vec, duration: float, height: float, *, search: float = 0.1, depth: float = 0.06
    ) -> None:
        duration = number("swing", "duration", duration, 2.0 * LEAD, strict=True, unit="s")
        height = number("swing", "height", height, 0.0, unit="m")
        search = number("swing", "search", search, 0.0, unit="m/s")
        depth = number("swing", "depth", depth, 0.0, unit="m")
        first, last = (tuple(_four(what, given).tolist()) for what, given in (("start", start), ("goal", goal)))
        self._path = _session.Swing(first, last, duration, height, search, depth)
        self.search, self.depth = search, depth

    @property
    def x(self) -> Vec:
        """(x, y, z, yaw) now ``(4,)`` [m, rad]."""
        return np.array(self._path.x)

    @property
    def goal(self) -> Vec:
        """(x, y, z, yaw) of the goal now ``(4,)`` [m, rad]."""
        return np.array(self._path.goal)

    @property
    def duration(self) -> float:
        """Time from lift-off to touch-down [s]; it may change on the way."""
        return self._path.duration

    @duration.setter
    def duration(self, seconds: float) -> None:
        self._path.duration = number("swing", "duration", seconds, 0.0, strict=True, unit="s")

    @property
    def time(self) -> float:
        """Time since lift-off [s]."""
        return self._path.time

    @property
    def left(self) -> float:
        """Time until it is to land [s], negative afterwards."""
        return self._path.left

    def retarget(self, goal: Vec, fastest: float, dt: float) -> None:
        """Move the goal ``(4,)`` towards another one, over ground, up and in yaw by at most ``fastest`` dt each."""
        fastest = number("swing", "fastest", fastest, 0.0, unit="m/s")
        self._path.retarget(tuple(_four("goal", goal).tolist()), fastest, _period(dt))

    def clear(self, z: float) -> bool:
        """Rise again, to the swing's height above z [m] or as high as time allows: the foot has scuffed there.

        Returns false, and changes nothing, if the time does not suffice.
        """
        return self._path.clear(number("swing", "z", z, unit="m"))

    def step(self, dt: float) -> tuple[Vec, Vec, Vec]:
        """One tick on: (x, y, z, yaw), its velocity and acceleration, ``(4,)`` each."""
        self._path.step(_period(dt))
        return np.array(self._path.x), np.array(self._path.v), np.array(self._path.a)


def _period(dt: float) -> float:
    return number("swing", "dt", dt, 0.0, strict=True, unit="s")


def _four(what: str, given: Vec) -> Vec:
    found = numbers("swing", what, given, (4,), "(x, y, z, yaw)")
    if not all(map(math.isfinite, found.tolist())):
        raise DeclarationError("swing", f"bad {what}", value=given, allowed="(x, y, z, yaw), finite")
    return found
