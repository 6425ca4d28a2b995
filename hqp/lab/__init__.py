"""A lab for one's own stack: closed loops through several solvers, measured, compared and reported."""

from __future__ import annotations

from .closed_loop import bench
from .result import Bench
from .trajectory import Trajectory

__all__ = ["Bench", "Trajectory", "bench"]
