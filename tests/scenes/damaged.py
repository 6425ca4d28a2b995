"""Damage a part of a plan's file behind a right hash; its loader must refuse it with one sentence."""

from __future__ import annotations

import json
from collections.abc import Callable, Iterable
from copy import deepcopy
from pathlib import Path
from typing import Any

import hqp
from hqp.errors import HqpError
from hqp.loop.file import FORMAT, fnv1a

Way = tuple[str | int, ...]


def plan_of(path: Path) -> dict[str, Any]:
    """The plan of a file."""
    found: dict[str, Any] = json.loads(path.read_bytes().split(b"\n", 1)[1])
    return found


def refused(plan: dict[str, Any], path: Path, load: Callable[[Path], object]) -> str:
    """Why the plan is refused, "" if it is not."""
    body = json.dumps(plan).encode()
    head = f"hqp plan, format {FORMAT}, version {hqp.__version__}, size {len(body)}, hash {fnv1a(body):016x}\n"
    path.write_bytes(head.encode() + body)
    try:
        load(path)
    except HqpError as error:
        return str(error)
    return ""


def places(tree: Any, way: Way = ()) -> list[Way]:
    """Ways to the fields of a part, those of the first item of a list."""
    found = [way] if way else []
    if isinstance(tree, dict) and "@" not in tree:
        found += [place for key, value in tree.items() for place in places(value, (*way, key))]
    elif isinstance(tree, list) and tree and isinstance(tree[0], dict):
        found += places(tree[0], (*way, 0))
    return found


def taken(
    plan: dict[str, Any], part: str, path: Path, load: Callable[[Path], object], unread: Iterable[Way] = ()
) -> list[tuple[Way, str, str]]:
    """Fields of a part that may be missing, or no number, without one sentence about the plan."""
    found = []
    for way in places(plan[part]):
        if way in unread:
            continue
        for damage in ("text",) if isinstance(way[-1], int) else ("missing", "text"):
            damaged = deepcopy(plan)
            at = damaged[part]
            for step in way[:-1]:
                at = at[step]
            if damage == "missing":
                del at[way[-1]]
            else:
                at[way[-1]] = {"nothing": "of a plan"}
            sentence = refused(damaged, path, load)
            if "plan" not in sentence or "\n" in sentence:
                found.append((way, damage, sentence))
    return found
