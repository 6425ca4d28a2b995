"""Native rows on the torque are J X, with bounds minus J c, from any c."""

from __future__ import annotations

import numpy as np
import pytest

import hqp.torque.dynamics
from hqp.problem import Motion
from hqp.torque.dynamics import ConstrainedDynamics
from hqp.torque.rows import TorqueRows

pytestmark = pytest.mark.skipif(hqp.torque.dynamics.native is None, reason="no native kernel here")


@pytest.mark.parametrize("other", [False, True], ids=["the map's own c", "another c"])
def test_native_rows_are_products_with_the_map(other: bool) -> None:
    nv, n, rng = 7, 5, np.random.default_rng(0)
    dynamics = ConstrainedDynamics(nv, 0, np.eye(nv)[2:])
    dynamics.map[:] = rng.normal(size=(nv, n + 1))
    J, asked, index, weight = rng.normal(size=(3, nv)), rng.normal(size=(2, 3)), np.array([4, 1]), np.array([2.0, 0.5])
    wanted, scale, v = rng.normal(size=(2, 2)), rng.uniform(0.5, 2.0, nv), rng.normal(size=nv)
    given = rng.normal(size=nv) if other else None
    rows, motion = TorqueRows(dynamics.map), Motion(np.zeros((nv, n)), np.zeros(nv))
    A, bounds, picked, limits = np.empty((3, n)), np.empty((2, 3)), np.empty((2, n)), np.empty((2, 2))
    rows.product(J, A, asked, bounds)
    rows.pick(index, weight, picked, wanted, limits)
    rows.motion(scale, 3.0, motion)
    dynamics.follow(rows.parts, None)
    dynamics.native.write(v, given)
    X, own = dynamics.X, dynamics.c
    c = own if given is None else given
    found = [A, bounds, picked, limits, motion.F, motion.f]
    expected = [J @ X, asked - J @ c, weight[:, None] * X[index], wanted - weight * c[index]]
    expected += [scale[:, None] * X, -scale * (own + 3.0 * v)]
    for fast, slow in zip(found, expected, strict=True):
        np.testing.assert_allclose(fast, slow, atol=1e-12)
