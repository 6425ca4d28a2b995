"""Rotations of a base: small turns, headings, quaternions."""

from __future__ import annotations

import math

import numpy as np

from hqp.arrays import Mat, Vec


def yaw_of(rotation: Mat) -> float:
    """Heading of a rotation's x axis [rad]."""
    return math.atan2(rotation[1, 0], rotation[0, 0])


def about_vertical(angle: float) -> Mat:
    """Rotation about the world's z ``(3, 3)``."""
    c, s = math.cos(angle), math.sin(angle)
    return np.array([[c, -s, 0.0], [s, c, 0.0], [0.0, 0.0, 1.0]])


def exponential(w: Vec) -> Mat:
    """exp([w]x) ``(3, 3)``."""
    return np.array(exponential_rows(*w.tolist()))


def exponential_rows(x: float, y: float, z: float) -> list[list[float]]:
    """exp([w]x) for w = (x, y, z), as its rows."""
    square = x * x + y * y + z * z
    angle = math.sqrt(square)
    a, b = (math.sin(angle) / angle, (1.0 - math.cos(angle)) / square) if angle > 1e-9 else (1.0, 0.5)
    xy, xz, yz, ax, ay, az = b * x * y, b * x * z, b * y * z, a * x, a * y, a * z
    return [
        [1.0 - b * (y * y + z * z), xy - az, xz + ay],
        [xy + az, 1.0 - b * (x * x + z * z), yz - ax],
        [xz - ay, yz + ax, 1.0 - b * (x * x + y * y)],
    ]


def rotation_of(quaternion: Vec) -> Mat:
    """Rotation matrix of a quaternion (x, y, z, w) of any nonzero length ``(3, 3)``."""
    x, y, z, w = quaternion.tolist()
    s = 2.0 / (x * x + y * y + z * z + w * w)
    rows = [
        [1.0 - s * (y * y + z * z), s * (x * y - z * w), s * (x * z + y * w)],
        [s * (x * y + z * w), 1.0 - s * (x * x + z * z), s * (y * z - x * w)],
        [s * (x * z - y * w), s * (y * z + x * w), 1.0 - s * (x * x + y * y)],
    ]  # fmt: skip
    return np.array(rows)


def quaternion_of(R: Mat) -> Vec:
    """Unit quaternion (x, y, z, w) of a rotation ``(4,)``."""
    m = R.tolist()
    trace = m[0][0] + m[1][1] + m[2][2]
    if trace > 0.0:
        w = 0.5 * math.sqrt(1.0 + trace)
        f = 0.25 / w
        found = [f * (m[2][1] - m[1][2]), f * (m[0][2] - m[2][0]), f * (m[1][0] - m[0][1]), w]
    else:
        i = max(range(3), key=lambda k: m[k][k])
        j, k = (i + 1) % 3, (i + 2) % 3
        found = [0.0] * 4
        found[i] = 0.5 * math.sqrt(max(1.0 + m[i][i] - m[j][j] - m[k][k], 0.0))
        f = 0.25 / found[i]
        found[j], found[k], found[3] = f * (m[i][j] + m[j][i]), f * (m[i][k] + m[k][i]), f * (m[k][j] - m[j][k])
    size = math.sqrt(sum(x * x for x in found))
    return np.array([x / size for x in found])
