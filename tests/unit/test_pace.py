"""The bound on postures below a level that is not met (hqp/pace.py)."""

from __future__ import annotations

import numpy as np
import pytest

from hqp.pace import common_bound


def test_the_largest_are_bound_alike() -> None:
    size = np.array([0.1, 2.0, 0.5, 3.0])
    bound = common_bound(size, 1.0)
    assert 0.5 < bound < 2.0
    assert np.linalg.norm(np.minimum(size, bound)) == pytest.approx(1.0, rel=1e-12)


def test_a_size_above_the_speed_by_rounding_alone_is_no_error() -> None:
    """sqrt(speed^2 / 3) may round to above all three: nothing is left to bound."""
    size = np.full(3, 0.022754496303722532)
    assert common_bound(size, 0.03941194369868564) >= size[0]


def test_numbers_that_are_none_end_the_search() -> None:
    assert common_bound(np.array([np.nan, np.nan]), 1.0) == 0.0
