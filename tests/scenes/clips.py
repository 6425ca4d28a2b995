"""Generated clips of six kinds, drawn by seed: jumping jacks, a dab, a jump, a kick, a squat, hops."""

from __future__ import annotations

from collections.abc import Callable, Iterator
from typing import Any

import numpy as np

from hqp.motion import Motion

FPS, GRAVITY = 60.0, 9.81
NAMES = (
    "Hips", "LeftUpLeg", "LeftLeg", "LeftFoot", "LeftToeBase", "RightUpLeg", "RightLeg", "RightFoot", "RightToeBase",
    "LeftArm", "LeftForeArm", "LeftHand", "RightArm", "RightForeArm", "RightHand",
)  # fmt: skip
PARENTS = (-1, 0, 1, 2, 3, 0, 5, 6, 7, 0, 9, 10, 0, 12, 13)
THIGH, SHANK, ANKLE, HIPS = 0.43, 0.42, 0.08, 0.9


def kinds(seed: int) -> Iterator[tuple[str, Motion]]:
    """Names and motions of the six kinds; the seed draws sizes, times and the side."""
    for name, make in KINDS.items():
        yield name, make(np.random.default_rng(seed))


def ease(times: Any, first: float, last: float) -> Any:
    """0 before, 1 after, without a jerk at the ends ``(T,)``."""
    x = np.clip((times - first) / (last - first), 0.0, 1.0)
    return x**3 * (10.0 - 15.0 * x + 6.0 * x * x)


def bump(times: Any, first: float, top: float, leaves: float, last: float) -> Any:
    """Up to 1 from first to top, down to 0 from leaves to last ``(T,)``."""
    return ease(times, first, top) - ease(times, leaves, last)


class Puppet:
    """A person who stands: hips and ankles from there ``(T, 3)`` [m], arms raised sideways and ahead, bends [rad]."""

    def __init__(self, seconds: float) -> None:
        self.times: Any = np.arange(round(seconds * FPS)) / FPS
        zero = np.zeros(len(self.times))
        self.hips = np.zeros((len(self.times), 3))
        self.feet = [np.zeros((len(self.times), 3)) for _ in (0, 1)]
        self.raised = [zero.copy(), zero.copy()]
        self.ahead = [zero.copy(), zero.copy()]
        self.lean, self.aside = zero.copy(), zero.copy()

    def motion(self) -> Motion:
        """The motion, its knees bent ahead."""
        frames = [self._frame(i) for i in range(len(self.times))]
        return Motion(NAMES, np.array(frames), FPS, PARENTS)

    def _frame(self, i: int) -> list[Any]:
        hips = np.array([0.0, 0.0, HIPS]) + self.hips[i]
        joints = [hips]
        for k, side in enumerate((1.0, -1.0)):
            hip = hips + [0.0, 0.1 * side, 0.0]
            ankle = np.array([-0.03, 0.1 * side, ANKLE]) + self.feet[k][i]
            joints += [hip, _knee(hip, ankle), ankle, ankle + [0.14, 0.0, 0.03 - ANKLE]]
        c, s, d = np.cos(self.lean[i]), np.sin(self.lean[i]), np.sin(self.aside[i])
        trunk = np.array([[c, 0.0, s], [0.0, 1.0, 0.0], [-s, 0.0, c]])
        for k, side in enumerate((1.0, -1.0)):
            shoulder = hips + trunk @ [0.0, 0.19 * side + 0.5 * d, 0.5 * np.sqrt(1.0 - d * d)]
            up, forward = self.raised[k][i], self.ahead[k][i]
            way = np.array([np.sin(forward), side * np.sin(up) * np.cos(forward), -np.cos(up) * np.cos(forward)])
            elbow = shoulder + trunk @ (0.28 * way + [0.0, 0.03 * side, 0.0])
            joints += [shoulder, elbow, elbow + trunk @ (0.24 * way + [0.05, 0.0, 0.0])]
        return joints


def _knee(hip: Any, ankle: Any) -> Any:
    way = ankle - hip
    length = min(float(np.linalg.norm(way)), 0.998 * (THIGH + SHANK))
    unit = way / np.linalg.norm(way)
    along = (THIGH**2 - SHANK**2 + length**2) / (2.0 * length)
    ahead = np.array([1.0, 0.0, 0.0]) - unit[0] * unit
    return hip + along * unit + np.sqrt(max(THIGH**2 - along**2, 0.0)) * ahead / np.linalg.norm(ahead)


def squat(rng: Any) -> Motion:
    """Down and up, arms ahead."""
    slow, deep = rng.uniform(0.7, 1.1), rng.uniform(0.2, 0.35)
    p = Puppet(2.0 * slow + 1.5)
    down = bump(p.times, 0.5, 0.5 + slow, 0.8 + slow, 0.8 + 2.0 * slow)
    p.hips += np.outer(down, [-0.25 * deep, 0.0, -deep])
    p.lean += 0.5 * down
    for arm in p.ahead:
        arm += 1.3 * down
    return p.motion()


def bend(rng: Any) -> Motion:
    """A deep crouch with the trunk on the thighs, and up; no clip of the page."""
    slow, deep, lean = rng.uniform(0.6, 1.0), rng.uniform(0.4, 0.6), rng.uniform(0.6, 1.2)
    p = Puppet(2.0 * slow + 1.2)
    down = bump(p.times, 0.3, 0.3 + slow, 0.7 + slow, 0.7 + 2.0 * slow)
    p.hips += np.outer(down, [-0.2 * deep, 0.0, -deep])
    p.lean += lean * down
    for arm in p.ahead:
        arm += rng.uniform(0.2, 1.2) * down
    for arm in p.raised:
        arm += rng.uniform(0.0, 0.4) * down
    return p.motion()


def dab(rng: Any) -> Motion:
    """A step aside, one arm up and the other across, the trunk bent aside."""
    p, side, wide = Puppet(3.5), rng.choice([0, 1]), rng.uniform(0.1, 0.2)
    sign = 1.0 - 2.0 * side
    step, there = ease(p.times, 0.7, 1.15), ease(p.times, 0.5, 1.4)
    p.feet[side] += np.column_stack((0.0 * step, sign * wide * step, 0.05 * bump(p.times, 0.7, 0.92, 0.93, 1.15)))
    weight = -0.08 * sign * bump(p.times, 0.2, 0.7, 0.9, 1.4)
    p.hips[:, 1] += weight + 0.5 * sign * wide * there
    p.hips[:, 2] -= 0.04 * there
    pose = bump(p.times, 1.5, 1.8, 2.4, 2.8)
    p.aside += 0.25 * sign * pose
    p.lean += 0.15 * pose
    p.raised[side] += 1.9 * pose
    p.ahead[1 - side] += 1.6 * pose
    p.raised[1 - side] += 0.9 * pose
    return p.motion()


def kick(rng: Any) -> Motion:
    """The weight on one foot, the other kicks ahead and comes back."""
    p, side, high, far = Puppet(4.0), rng.choice([0, 1]), rng.uniform(0.2, 0.35), rng.uniform(0.3, 0.45)
    sign = 1.0 - 2.0 * side
    p.hips[:, 1] -= sign * 0.1 * bump(p.times, 0.3, 1.0, 2.5, 3.2)
    p.hips[:, 2] -= 0.03 * bump(p.times, 0.3, 1.0, 2.5, 3.2)
    p.feet[side] += np.outer(bump(p.times, 1.3, 1.7, 1.8, 2.3), [far, 0.0, high])
    p.feet[side][:, 2] += 0.06 * bump(p.times, 1.1, 1.4, 2.1, 2.45)
    p.lean -= 0.15 * bump(p.times, 1.2, 1.7, 1.9, 2.4)
    p.ahead[1 - side] += 0.6 * bump(p.times, 1.2, 1.7, 1.9, 2.4)
    return p.motion()


def jump(rng: Any) -> Motion:
    """A jump on the spot."""
    return hops(rng, 1, rng.uniform(0.25, 0.35))


def hop(rng: Any) -> Motion:
    """Three small hops."""
    return hops(rng, 3, rng.uniform(0.12, 0.18))


def jumping_jacks(rng: Any) -> Motion:
    """Feet apart and together in small jumps, arms up and down."""
    return hops(rng, 4, rng.uniform(0.14, 0.2), apart=rng.uniform(0.15, 0.22))


def hops(rng: Any, count: int, air: float, apart: float = 0.0) -> Motion:
    """Jumps with so long a flight [s], feet that much further apart after every other one [m]."""
    crouch, rest = rng.uniform(0.08, 0.12), rng.uniform(0.5, 0.65)
    each = air + rest
    p = Puppet(0.8 + count * each + 0.8)
    for k in range(count):
        lift = 0.8 + k * each + 0.5 * rest
        land, speed = lift + air, 0.5 * GRAVITY * air
        t = p.times
        inside = (t >= lift) & (t <= land)
        flight = np.where(inside, speed * (t - lift) - 0.5 * GRAVITY * (t - lift) ** 2, 0.0)
        p.hips[:, 2] += flight
        for sign, start in ((-1.0, lift), (1.0, land)):  # pushes off and lands with the flight's speed
            s = sign * (t - start) / (0.5 * rest)
            p.hips[:, 2] += np.where((s > 0.0) & (s < 1.0), -_dip(s, crouch, speed * 0.5 * rest), 0.0)
        for foot, side in zip(p.feet, (1.0, -1.0), strict=True):
            foot[:, 2] += np.maximum(flight, 0.0)
            moved = apart if k % 2 == 0 else -apart
            foot[:, 1] += side * moved * ease(t, lift, land)
        if apart:
            way = 1.0 if k % 2 == 0 else -1.0
            for arm in p.raised:
                arm += way * 2.2 * ease(t, lift - 0.1, land + 0.1)
    return p.motion()


def _dip(s: Any, deep: float, slope: float) -> Any:
    """Depth below standing: 0 with a slope at s = 0, deep about the middle, 0 and at rest at s = 1."""
    rise = slope * s * (1.0 - s) ** 3
    return rise + deep * 16.0 * s * s * (1.0 - s) ** 2


KINDS: dict[str, Callable[[Any], Motion]] = {
    "jumping jacks": jumping_jacks, "dab": dab, "jump": jump, "kick": kick, "squat": squat, "hop": hop,
}  # fmt: skip
