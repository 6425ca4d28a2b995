"""Models whose joints are in any order: an inertia like that of Newton and Euler's recursion, or an error."""

from __future__ import annotations

from typing import Any

import numpy as np
import pinocchio as pin
import pytest

import hqp
from hqp.errors import ModelError

MAKERS = (pin.JointModelRX, pin.JointModelPY, pin.JointModelRUBZ, pin.JointModelSpherical)


def drawn(rng: Any) -> Any:
    """A tree of drawn joints; a new joint's parent is the universe or one of the last three joints."""
    model, joints = pin.Model(), [0]
    for i in range(rng.integers(3, 9)):
        place = pin.SE3(pin.exp3(rng.normal(size=3)), rng.normal(size=3))
        joint = MAKERS[rng.integers(len(MAKERS))]()
        joints.append(model.addJoint(int(rng.choice(joints[-3:])), joint, place, f"joint {i}"))
        model.appendBodyToJoint(joints[-1], pin.Inertia.Random(), pin.SE3.Identity())
    return model


def by_recursion(model: Any, q: Any) -> Any:
    """The joint-space inertia, column by column."""
    data, zero = model.createData(), np.zeros(model.nv)
    bias = pin.rnea(model, data, q, zero, zero).copy()
    return np.column_stack([pin.rnea(model, data, q, zero, unit) - bias for unit in np.eye(model.nv)])


def test_the_inertia_is_right_or_the_model_is_refused() -> None:
    pin.seed(0)
    right = refused = 0
    for seed in range(200):
        model = drawn(np.random.default_rng(seed))
        q = pin.randomConfiguration(model, -np.ones(model.nq), np.ones(model.nq))
        A, data = by_recursion(model, q), model.createData()
        upper = np.triu(pin.crba(model, data, q))
        if np.allclose(upper, np.triu(A), atol=1e-9):
            robot = hqp.robots.load(model)
            np.testing.assert_allclose(robot.state(q).mass_matrix(), A, atol=1e-9)
            right += 1
        else:
            with pytest.raises(ModelError, match="depth-first order"):
                hqp.robots.load(model)
            refused += 1
    assert min(right, refused) > 20
