"""The same stack and scenarios through pink, mink, placo and tsid, each in an environment of its own."""

from __future__ import annotations

from .compare import compare_rivals
from .environments import RIVALS
from .table import RivalTable

__all__ = ["RIVALS", "RivalTable", "compare_rivals"]
