"""A file whose walker is damaged behind a right hash is refused with one sentence."""

from __future__ import annotations

import json
import math
from copy import deepcopy
from pathlib import Path
from typing import Any

import pytest

import hqp
from hqp.errors import HqpError
from hqp.loop.file import FORMAT, fnv1a
from hqp.robots.soles import feet
from hqp.walking import Walker, Walkers
from tests.scenes.bipeds import biped

UNREAD = {("soles", 0, "frame", "class"), ("soles", 0, "frame", "columns"), ("start",)}
"""Fields that a batch of walkers does not read."""


@pytest.fixture(scope="module")
def intact(tmp_path_factory: pytest.TempPathFactory) -> dict[str, Any]:
    folder = tmp_path_factory.mktemp("walker")
    robot, soles = feet(hqp.robots.load(biped(folder, damping=1.0, dry=1.0), floating=True, rotors=True))
    Walker(robot, soles=soles, deadline=math.inf).export(folder / "walker.hqp")
    found: dict[str, Any] = json.loads((folder / "walker.hqp").read_bytes().split(b"\n", 1)[1])
    return found


def refused(plan: dict[str, Any], path: Path) -> str:
    body = json.dumps(plan).encode()
    head = f"hqp plan, format {FORMAT}, version {hqp.__version__}, size {len(body)}, hash {fnv1a(body):016x}\n"
    path.write_bytes(head.encode() + body)
    try:
        Walkers.load(path, 1)
    except HqpError as error:
        return str(error)
    return ""


def places(tree: Any, way: tuple[str | int, ...] = ()) -> list[tuple[str | int, ...]]:
    """Ways to the fields of a walker, those of the first item of a list."""
    found = [way] if way else []
    if isinstance(tree, dict) and "@" not in tree:
        found += [place for key, value in tree.items() for place in places(value, (*way, key))]
    elif isinstance(tree, list) and tree and isinstance(tree[0], dict):
        found += places(tree[0], (*way, 0))
    return found


def test_a_field_that_is_missing_or_no_number_is_refused(intact: dict[str, Any], tmp_path: Path) -> None:
    assert not refused(intact, tmp_path / "walker.hqp")
    taken = []
    for way in places(intact["walker"]):
        if way in UNREAD:
            continue
        for damage in ("text",) if isinstance(way[-1], int) else ("missing", "text"):
            plan = deepcopy(intact)
            at = plan["walker"]
            for step in way[:-1]:
                at = at[step]
            if damage == "missing":
                del at[way[-1]]
            else:
                at[way[-1]] = {"nothing": "of a walker"}
            sentence = refused(plan, tmp_path / "walker.hqp")
            if "plan" not in sentence or "\n" in sentence:
                taken.append((way, damage, sentence))
    assert not taken


@pytest.mark.parametrize("field", ["motor", "column"])
@pytest.mark.parametrize("wild", [-1, 10_000])
def test_friction_of_no_motor_is_refused(field: str, wild: int, intact: dict[str, Any], tmp_path: Path) -> None:
    plan = deepcopy(intact)
    plan["walker"]["friction"][0][field] = wild
    assert "friction is that of a motor" in refused(plan, tmp_path / "walker.hqp")
