"""Run a stack and scenarios through pink, mink, placo and tsid, each in its own environment."""

from __future__ import annotations

from .compare import compare_rivals
from .environments import RIVALS
from .table import RivalTable

__all__ = ["RIVALS", "RivalTable", "compare_rivals"]
