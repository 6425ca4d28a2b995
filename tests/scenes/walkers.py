"""Walkers without deadlines, which a busy machine does not change."""

from __future__ import annotations

import math
from typing import Any

from hqp.walking import Walker

DT = 0.004


def made(robot: Any) -> Walker:
    """Walk on a copy of the robot."""
    return Walker(robot.copy(), dt=DT, deadline=math.inf)
