"""Run a stack through several solvers, tick by tick, and compare the results in a table."""

from __future__ import annotations

from hqp.comparison.runs import compare
from hqp.comparison.table import Comparison

__all__ = ["Comparison", "compare"]
