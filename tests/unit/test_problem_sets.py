"""Stored problem sets load as hierarchies with the shapes of their page."""

from __future__ import annotations

import numpy as np
import pytest

from hqp import Selection
from tests.scenes import problems


def test_every_set_is_documented_and_loads() -> None:
    page = (problems.FOLDER / "README.md").read_text()
    for name in problems.names():
        assert name.split("_")[0] in page
        (first,) = problems.load(name, 1)
        assert first.n == {"randint10": 10, "rand12": 12, "rand20": 20}.get(name, first.n)
        assert first.levels
    assert len(problems.load("a38")) == 20


def test_simple_bounds_come_as_selections_of_the_same_rows() -> None:
    (picked,), (dense,) = problems.load("b5_38", 1), problems.load("b5_38", 1, selections=False)
    assert isinstance(picked.levels[0].A, Selection)
    for one, two in zip(picked.levels, dense.levels, strict=True):
        np.testing.assert_array_equal(one.dense(picked.n), two.dense(dense.n))


def test_an_unknown_set_names_those_there_are() -> None:
    with pytest.raises(FileNotFoundError, match="a38"):
        problems.load("nosuchset")
