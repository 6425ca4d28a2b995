"""The human who pulls at a robot's hand: a spring and a damper with a moving end."""

from __future__ import annotations

import math
from dataclasses import dataclass

import numpy as np

from hqp.arrays import Vec


@dataclass(frozen=True, kw_only=True)
class Walk:
    """Walk along a line: rest, out at a speed, a stop, back at that speed, rest.

    speed [m/s], distance [m], start: time of the first step [s], easing: time of acceleration [s], stop: time before
    the return [s]; back: true to return.
    """

    speed: float = 0.35
    distance: float = 0.9
    start: float = 1.0
    easing: float = 1.5
    stop: float = 2.0
    back: bool = True

    @property
    def duration(self) -> float:
        """Duration of one way [s]."""
        return self.distance / self.speed + self.easing

    @property
    def turn(self) -> float:
        """Start of the way back [s]."""
        return self.start + self.duration + self.stop

    @property
    def end(self) -> float:
        """Time of the final rest [s]."""
        return self.turn + self.duration if self.back else self.start + self.duration

    def at(self, t: float) -> tuple[float, float]:
        """Place [m] and velocity [m/s] along the line."""
        x, v = self._way(t - self.start)
        if self.back:
            y, w = self._way(t - self.turn)
            x, v = x - y, v - w
        return x, v

    def _way(self, t: float) -> tuple[float, float]:
        gain, whole = self.speed / self.easing, self.distance / self.speed
        if t <= 0.0:
            return 0.0, 0.0
        if t < self.easing:
            return 0.5 * gain * t * t, gain * t
        if t < whole:
            return self.speed * (t - 0.5 * self.easing), self.speed
        left = whole + self.easing - t
        if left > 0.0:
            return self.distance - 0.5 * gain * left * left, gain * left
        return self.distance, 0.0


@dataclass(frozen=True, kw_only=True)
class SpringHand:
    """Spring at the robot's hand in the ground plane: f = k (anchor - x) + d (anchor rate - v), |f| <= cap.

    stiffness [N/m], damping [N s/m], cap [N].  direction: azimuth of the walk in the world [rad].
    """

    stiffness: float = 200.0
    damping: float = 200.0
    cap: float = 120.0
    direction: float = 0.0

    def force(self, walk: Walk, t: float, at_rest: Vec, hand: Vec, velocity: Vec) -> Vec:
        """Force ``(3,)`` [N] on the hand at ``hand`` [m] moving at ``velocity`` [m/s], both ``(3,)``."""
        x, v = walk.at(t)
        c, s = math.cos(self.direction), math.sin(self.direction)
        (ax, ay, _), (hx, hy, _), (vx, vy, _) = at_rest.tolist(), hand.tolist(), velocity.tolist()
        fx = self.stiffness * (ax + x * c - hx) + self.damping * (v * c - vx)
        fy = self.stiffness * (ay + x * s - hy) + self.damping * (v * s - vy)
        size = math.hypot(fx, fy)
        scale = self.cap / size if size > self.cap else 1.0
        return np.array([scale * fx, scale * fy, 0.0])
