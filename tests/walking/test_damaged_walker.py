"""A file whose walker is damaged behind a right hash is refused with one sentence."""

from __future__ import annotations

import math
from copy import deepcopy
from pathlib import Path
from typing import Any

import pytest

import hqp
from hqp.robots.soles import feet
from hqp.walking import Walker, Walkers
from tests.scenes.bipeds import biped
from tests.scenes.damaged import plan_of, refused, taken

UNREAD = {("soles", 0, "frame", "class"), ("soles", 0, "frame", "columns"), ("start",)}
"""Fields that a batch of walkers does not read."""


@pytest.fixture(scope="module")
def intact(tmp_path_factory: pytest.TempPathFactory) -> dict[str, Any]:
    folder = tmp_path_factory.mktemp("walker")
    robot, soles = feet(hqp.robots.load(biped(folder, damping=1.0, dry=1.0), floating=True, rotors=True))
    Walker(robot, soles=soles, deadline=math.inf).export(folder / "walker.hqp")
    return plan_of(folder / "walker.hqp")


def load(path: Path) -> Walkers:
    return Walkers.load(path, 1)


@pytest.mark.long
def test_a_field_that_is_missing_or_no_number_is_refused(intact: dict[str, Any], tmp_path: Path) -> None:
    assert not refused(intact, tmp_path / "walker.hqp", load)
    assert not taken(intact, "walker", tmp_path / "walker.hqp", load, UNREAD)


@pytest.mark.parametrize("field", ["motor", "column"])
@pytest.mark.parametrize("wild", [-1, 10_000])
def test_friction_of_no_motor_is_refused(field: str, wild: int, intact: dict[str, Any], tmp_path: Path) -> None:
    plan = deepcopy(intact)
    plan["walker"]["friction"][0][field] = wild
    assert "friction is that of a motor" in refused(plan, tmp_path / "walker.hqp", load)
