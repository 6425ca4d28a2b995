from __future__ import annotations

import numpy as np
import pytest

from hqp.errors import ProblemError
from hqp.floating_base import base_rank, base_velocity, consistent_velocity, generalized_velocity


def test_base_velocity_satisfies_the_constraints() -> None:
    rng = np.random.default_rng(1)
    J_C = rng.standard_normal((6, 12))
    v = generalized_velocity(J_C, rng.standard_normal(6))
    assert np.abs(J_C @ v).max() < 1e-11


def test_a_base_left_free_is_refused() -> None:
    J_C = np.random.default_rng(2).standard_normal((5, 12))
    assert base_rank(J_C) == 5
    with pytest.raises(ProblemError, match="rank 5 of 6"):
        base_velocity(J_C, np.zeros(6))


def test_shapes_are_checked() -> None:
    with pytest.raises(ProblemError, match="columns"):
        base_velocity(np.zeros((6, 12)), np.zeros(5))


def test_consistent_velocity_is_a_projection() -> None:
    rng = np.random.default_rng(3)
    J_C = rng.standard_normal((9, 20))
    J_C[6:] = J_C[:3]  # a foot with redundant points
    v = rng.standard_normal(20)
    once = consistent_velocity(J_C, v)
    assert np.abs(J_C @ once).max() < 1e-11
    assert np.allclose(consistent_velocity(J_C, once), once, atol=1e-12)
