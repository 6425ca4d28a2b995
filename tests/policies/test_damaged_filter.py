"""A file whose filter is damaged behind a right hash is refused with one sentence."""

from __future__ import annotations

import math
from copy import deepcopy
from pathlib import Path
from typing import Any

import pytest

import hqp
from hqp.policies import PolicyFilters
from tests.scenes.damaged import plan_of, refused, taken


@pytest.fixture(scope="module")
def intact(tmp_path_factory: pytest.TempPathFactory) -> dict[str, Any]:
    path = tmp_path_factory.mktemp("filter") / "filter.hqp"
    hqp.PolicyFilter(kp=60.0, kd=2.0).session(hqp.robots.load("ur5"), 0.002, deadline=math.inf).export(path)
    return plan_of(path)


def load(path: Path) -> PolicyFilters:
    return PolicyFilters.load(path, 1)


@pytest.mark.long
def test_a_field_that_is_missing_or_no_number_is_refused(intact: dict[str, Any], tmp_path: Path) -> None:
    assert not refused(intact, tmp_path / "filter.hqp", load)
    unread = {("model", "bodies", 0, "class")}
    assert not taken(intact, "filter", tmp_path / "filter.hqp", load, unread)


@pytest.mark.parametrize("field", ["columns", "kd", "effort", "largest", "rounding", "stiffening", "most"])
@pytest.mark.parametrize("wild", [[], [0.0] * 100])
def test_a_list_of_another_length_is_refused(
    field: str, wild: list[float], intact: dict[str, Any], tmp_path: Path
) -> None:
    plan = deepcopy(intact)
    plan["filter"][field] = wild
    sentence = refused(plan, tmp_path / "filter.hqp", load)
    assert "plan" in sentence
    assert "\n" not in sentence


@pytest.mark.parametrize(("part", "wild"), [("kind", 3), ("kind", -1), ("nv", 5), ("nq", 5), ("nv", 10**9)])
def test_a_wild_number_is_refused(part: str, wild: int, intact: dict[str, Any], tmp_path: Path) -> None:
    plan = deepcopy(intact)
    (plan["filter"] if part == "kind" else plan["filter"]["model"])[part] = wild
    assert "plan" in refused(plan, tmp_path / "filter.hqp", load)


def test_a_file_without_a_filter_names_the_cure(tmp_path: Path) -> None:
    path = tmp_path / "stack.hqp"
    hqp.PolicyFilter(kp=60.0, kd=2.0).session(hqp.robots.load("ur5"), 0.002).session.export(path)
    with pytest.raises(hqp.HqpError, match="PolicyFilterSession"):
        load(path)
