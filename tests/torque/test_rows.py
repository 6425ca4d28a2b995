"""Native rows on the torque are the readable ones: J X and the bounds less J c, from any c."""

from __future__ import annotations

import numpy as np
import pytest

import hqp.torque.rows
from hqp.problem import Motion
from hqp.torque.rows import TorqueRows

pytestmark = pytest.mark.skipif(hqp.torque.rows.native is None, reason="no native kernel here")


@pytest.mark.parametrize("other", [False, True], ids=["the map's own c", "another c"])
def test_native_rows_equal_readable_rows(other: bool, monkeypatch: pytest.MonkeyPatch) -> None:
    nv, n, rng = 7, 5, np.random.default_rng(0)
    map, J, asked = rng.normal(size=(nv, n + 1)), rng.normal(size=(3, nv)), rng.normal(size=(2, 3))
    index, weight, wanted = np.array([4, 1]), np.array([2.0, 0.5]), rng.normal(size=(2, 2))
    scale, v, c = rng.uniform(0.5, 2.0, nv), rng.normal(size=nv), rng.normal(size=nv) if other else None
    found = []
    for native in (True, False):
        if not native:
            monkeypatch.setattr(hqp.torque.rows, "native", None)
        rows, motion = TorqueRows(map), Motion(np.zeros((nv, n)), np.zeros(nv))
        arrays = [np.empty((3, n)), np.empty((2, 3)), np.empty((2, n)), np.empty((2, 2)), motion.F, motion.f]
        rows.product(J, arrays[0], asked, arrays[1])
        rows.pick(index, weight, arrays[2], wanted, arrays[3])
        rows.motion(scale, 3.0, motion)
        rows.fill(v, c)
        found.append(arrays)
    for fast, slow in zip(*found, strict=True):
        np.testing.assert_allclose(fast, slow, atol=1e-12)
