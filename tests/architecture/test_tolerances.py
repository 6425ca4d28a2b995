"""Tolerances that are constants in C++ equal those of hqp/tolerances.py."""

from __future__ import annotations

import re
from pathlib import Path

import pytest

from hqp import tolerances

CPP = Path(__file__).parents[2] / "hqp" / "cpp"

SAME = {
    ("solver/conditions.hpp", "kRank"): "CERTIFIED_RANK_TOLERANCE",
    ("solver/judge.hpp", "kEither"): "EITHER_RANK",
    ("solver/conditions.hpp", "kData"): "NULL_SPACE_ROUNDING",
    ("solver/conditions.hpp", "kTurned"): "LARGEST_ROUNDING",
    ("solver/judge.hpp", "kLock"): "LOCK_TOLERANCE",
    ("solver/judge.hpp", "kLeastLock"): "SMALLEST_LOCK",
    ("solver/row_sorted_least_squares.hpp", "kFlat"): "FLAT_ROW",
    ("solver/table.hpp", "kGraded"): "GRADED_ROWS",
    ("solver/lexicographic.hpp", "kActive"): "ACTIVITY_TOLERANCE",
    ("solver/violated.hpp", "kViolated"): "VIOLATION_TOLERANCE",
    ("solver/violated.hpp", "kMet"): "FEASIBILITY_TOLERANCE",
    ("solver/soft_choice.hpp", "kSeen"): "RANK_TOLERANCE",
    ("solver/order.hpp", "kDiffer"): "VIOLATION_TOLERANCE",
    ("solver/problem.hpp", "rank_tolerance"): "RANK_TOLERANCE",
    ("solver/problem.hpp", "multiplier_tolerance"): "MULTIPLIER_TOLERANCE",
    ("solver/problem.hpp", "feasibility_tolerance"): "FEASIBILITY_TOLERANCE",
}
"""Constants by file and name, with their names in Python."""


@pytest.mark.parametrize(("place", "name"), SAME.items(), ids=lambda x: x if isinstance(x, str) else x[1])
def test_a_constant_in_cpp_is_that_of_python(place: tuple[str, str], name: str) -> None:
    file, constant = place
    found = re.search(rf"\b{constant} = ([0-9.e-]+)", (CPP / file).read_text(encoding="utf-8"))
    assert found is not None, f"{file} has no {constant}"
    assert float(found.group(1)) == getattr(tolerances, name)
