"""Tolerances that are constants in C++ equal those of hqp/tolerances.py."""

from __future__ import annotations

import re
from pathlib import Path

import pytest

from hqp import tolerances

CPP = Path(__file__).parents[2] / "hqp" / "cpp"

SAME = [
    ("solver/tolerances.hpp", "kEither", "EITHER_RANK"),
    ("solver/tolerances.hpp", "kTurned", "LARGEST_ROUNDING"),
    ("solver/conditions.hpp", "kClearDirection", "CLEAR_DIRECTION"),
    ("solver/tolerances.hpp", "kClearOf", "LOCK_TOLERANCE"),
    ("solver/tolerances.hpp", "kOnRow", "SMALLEST_LOCK"),
    ("solver/table.hpp", "kGraded", "GRADED_ROWS"),
    ("solver/tolerances.hpp", "kActive", "ACTIVITY_TOLERANCE"),
    ("solver/tolerances.hpp", "kDirection", "CERTIFIED_RANK_TOLERANCE"),
    ("solver/tolerances.hpp", "kRounding", "NULL_SPACE_ROUNDING"),
    ("solver/tolerances.hpp", "kRounding", "ROUNDING"),
    ("solver/tolerances.hpp", "kSeen", "FLAT_ROW"),
    ("solver/tolerances.hpp", "kSeen", "RANK_TOLERANCE"),
    ("solver/tolerances.hpp", "kViolated", "VIOLATION_TOLERANCE"),
    ("solver/tolerances.hpp", "kMet", "FEASIBILITY_TOLERANCE"),
]
"""Constants by file and name, with their names in Python."""


@pytest.mark.parametrize(("file", "constant", "name"), SAME)
def test_a_constant_in_cpp_is_that_of_python(file: str, constant: str, name: str) -> None:
    found = re.search(rf"\b{constant} = ([0-9.e-]+)", (CPP / file).read_text(encoding="utf-8"))
    assert found is not None, f"{file} has no {constant}"
    assert float(found.group(1)) == getattr(tolerances, name)
