"""Problem definition: rows in levels, their prices, and the judge of an answer."""

from __future__ import annotations

from .hierarchy import (
    EQUALITY,
    ETA,
    Hierarchy,
    Motion,
    Rows,
    Selection,
    Shape,
    Solution,
    Stacked,
    Stats,
    Status,
    has_inequalities,
)

__all__ = [
    "EQUALITY",
    "ETA",
    "Hierarchy",
    "Motion",
    "Rows",
    "Selection",
    "Shape",
    "Solution",
    "Stacked",
    "Stats",
    "Status",
    "has_inequalities",
]
