"""The same stack through several solvers, tick by tick, and the table of what came out."""

from __future__ import annotations

from hqp.comparison.runs import compare
from hqp.comparison.table import Comparison

__all__ = ["Comparison", "compare"]
