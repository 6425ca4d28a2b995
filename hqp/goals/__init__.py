"""Inverse kinematics on strict levels: one step, or to a target."""

from __future__ import annotations

from .reaching import Reached, reach
from .step import solve_ik

__all__ = ["Reached", "reach", "solve_ik"]
