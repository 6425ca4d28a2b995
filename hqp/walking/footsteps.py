"""From a velocity to steps: footholds, also after a push."""

from __future__ import annotations

import math
from dataclasses import dataclass, replace

import numpy as np

from hqp.angles import wrapped
from hqp.arrays import Mat, Vec
from hqp.errors import DeclarationError
from hqp.walking.gait import Reach, check

LEFT, RIGHT = 0, 1


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
        for field in ("forward", "left", "turn"):
            check("walking", field, getattr(self, field), -math.inf)


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
        check("footsteps", "period", self.period, 0.0, strict=True, unit="s")
        if not self.reach.least <= self.width <= self.reach.most:
            allowed = f"{self.reach.least:g} to {self.reach.most:g}, which the reach allows"
            raise DeclarationError("footsteps", "bad width", value=self.width, unit="m", allowed=allowed)

    def next(self, stance: Foothold, command: Command) -> Foothold:
        """Next foothold, at the height of the stance foot."""
        side = 1 - stance.side
        out = 1.0 if side == LEFT else -1.0
        opens = command.turn * out > 0.0
        turn = min(max(2.0 * command.turn * self.period, -self.reach.turn), self.reach.turn) if opens else 0.0
        across = 2.0 * command.left * self.period if command.left * out > 0.0 else 0.0
        step = np.array([command.forward * self.period, out * self.width + across])
        x, y = stance.xy + rotation(stance.yaw + 0.5 * turn) @ step
        return self.within(Foothold(side, float(x), float(y), stance.z, stance.yaw + turn), stance)

    def within(self, foothold: Foothold, stance: Foothold) -> Foothold:
        """The foothold, or the nearest one within reach of the stance foot."""
        out, reach = 1.0 if foothold.side == LEFT else -1.0, self.reach
        forward, aside = (stance.turn.T @ (foothold.xy - stance.xy)).tolist()
        held = np.array(
            [
                min(max(forward, -reach.forward), reach.forward),
                out * min(max(out * aside, reach.least), reach.most),
            ]
        )
        turn = min(max(wrapped(foothold.yaw - stance.yaw), -reach.turn), reach.turn)
        x, y = stance.xy + stance.turn @ held
        return replace(foothold, x=float(x), y=float(y), yaw=stance.yaw + turn)


def rotation(yaw: float) -> Mat:
    """Rotation about the vertical ``(2, 2)``."""
    c, s = math.cos(yaw), math.sin(yaw)
    return np.array([[c, -s], [s, c]])
