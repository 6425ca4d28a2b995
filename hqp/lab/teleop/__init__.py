"""Teleoperation, measured: Measure teleoperation with hqp and other libraries."""

from __future__ import annotations

from .compare import compare_teleop
from .families import FAMILIES
from .table import TeleopTable

__all__ = ["FAMILIES", "TeleopTable", "compare_teleop"]
