"""From a velocity to steps: footholds, also after a push."""

from __future__ import annotations

import math
from collections.abc import Iterable, Sequence
from dataclasses import astuple, dataclass

import numpy as np

from hqp import _session
from hqp.arrays import Mat, Vec
from hqp.errors import DeclarationError
from hqp.kinds import require
from hqp.numbers import number, plain, set_numbers
from hqp.walking.gait import REACH, Reach

LEFT, RIGHT = 0, 1

COMMAND, FOOTHOLD = "Command(forward, left, turn)", "Foothold(LEFT, x, y, z, yaw)"


@dataclass(frozen=True)
class Foothold:
    """A foot on the ground: the middle of its sole ``(x, y, z)`` [m], its yaw [rad], LEFT or RIGHT."""

    side: int
    x: float
    y: float
    z: float = 0.0
    yaw: float = 0.0

    @property
    def xy(self) -> Vec:
        """The middle of the sole from above ``(2,)`` [m]."""
        return np.array([self.x, self.y])

    @property
    def turn(self) -> Mat:
        """Rotation about the vertical ``(2, 2)``."""
        return rotation(self.yaw)


@dataclass(frozen=True)
class Command:
    """Requested velocity, in the axes of the robot's heading: forward, to the left [m/s], turning [rad/s]."""

    forward: float = 0.0
    left: float = 0.0
    turn: float = 0.0

    def __post_init__(self) -> None:
        set_numbers(self, "walking", ("forward", "left", "turn"))


@dataclass(frozen=True, kw_only=True)
class Footsteps:
    """Steps of one period each that make a commanded velocity, each within reach of the foot that stands.

    Seen from the stance foot, turned half as far as the step turns, the next one lands at

        (v_x T, +-width + 2 v_y T),    yaw 2 w T,

    the sideways part only by the foot on the side that it goes to, the turn only by the foot that opens it, so that
    feet do not meet; then both are held within ``reach``.
    period [s]: T.  width: distance of the feet side by side [m].  Raises DeclarationError for fields.
    """

    period: float
    width: float
    reach: Reach

    def __post_init__(self) -> None:
        set_numbers(self, "footsteps", ("period", "width"), 0.0, strict=True)
        require("footsteps", "reach", self.reach, Reach, REACH)
        if not self.reach.least <= self.width <= self.reach.most:
            allowed = f"{self.reach.least:g} to {self.reach.most:g}, which the reach allows"
            raise DeclarationError("footsteps", "bad width", value=self.width, unit="m", allowed=allowed)

    def next(self, stance: Foothold, command: Command) -> Foothold:
        """Next foothold, at the height of the stance foot."""
        require("footsteps", "stance", stance, Foothold, FOOTHOLD)
        require("footsteps", "command", command, Command, COMMAND)
        found = _session.next_foothold(self.period, self.width, astuple(self.reach), astuple(stance), astuple(command))
        return Foothold(*found)

    def within(self, foothold: Foothold, stance: Foothold) -> Foothold:
        """The foothold, or the nearest one within reach of the stance foot."""
        for field, one in (("foothold", foothold), ("stance", stance)):
            require("footsteps", field, one, Foothold, FOOTHOLD)
        return Foothold(*_session.within_reach(astuple(self.reach), astuple(foothold), astuple(stance)))


def routed(footholds: Sequence[Foothold]) -> list[tuple[int, float, float, float, float]]:
    """Numbers of footholds that are LEFT and RIGHT in turn, and finite; raises DeclarationError for others."""
    found: list[tuple[int, float, float, float, float]] = []
    require("follow", "footholds", footholds, Iterable, f"a sequence of {FOOTHOLD}")
    for one in footholds:
        require("follow", "foothold", one, Foothold, FOOTHOLD)
        side = plain(one.side)
        if side not in (LEFT, RIGHT) or (found and side == found[-1][0]):
            sides = [*(each[0] for each in found), one.side]
            raise DeclarationError("follow", "bad side", value=sides, allowed="LEFT (0) and RIGHT (1) in turn")
        x, y, z, yaw = (number("follow", field, getattr(one, field)) for field in ("x", "y", "z", "yaw"))
        found.append((int(side), x, y, z, yaw))
    return found


def rotation(yaw: float) -> Mat:
    """Rotation about the vertical ``(2, 2)``."""
    c, s = math.cos(yaw), math.sin(yaw)
    return np.array([[c, -s], [s, c]])
