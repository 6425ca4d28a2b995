"""Numbers of declarations: every public class refuses NaN, words and lists with NaN, and takes any real scalar."""

from __future__ import annotations

import dataclasses
import inspect
import math
from typing import Any

import numpy as np
import pytest

import hqp
from hqp import estimation, motion, policies, solvers, tasks, teleoperation, walking
from hqp.errors import HqpError

GIVEN = {
    "frame": "tool0",
    "frames": ("tool0",),
    "relative_to": "world",
    "law": hqp.P(1.0),
    "joint": "elbow_joint",
    "joints": ("elbow_joint",),
    "normal": (0.0, 0.0, 1.0),
    "axis": "z",
    "radius": 0.1,
    "kp": 1.0,
    "kd": 1.0,
    "name": "n",
    "element": tasks.Position(frame="tool0"),
}
"""Arguments that a class needs."""

DATA = {hqp.Reference}
"""Values of a tick: the status of the tick reports them, nothing raises."""


def declarations() -> list[tuple[type, str, dict[str, Any]]]:
    """Class, parameter whose default is a number, and the arguments that the class needs."""
    found, seen = [], set(DATA)
    for package in (hqp, tasks, walking, motion, policies, teleoperation, estimation, solvers):
        for name in package.__all__:
            kind = getattr(package, name)
            if not inspect.isclass(kind) or inspect.isabstract(kind) or kind in seen or issubclass(kind, Exception):
                continue
            seen.add(kind)
            fields = inspect.signature(kind).parameters.values()
            needed = [
                f.name for f in fields if f.default is f.empty and f.kind not in (f.VAR_KEYWORD, f.VAR_POSITIONAL)
            ]
            if not set(needed) <= GIVEN.keys():
                continue
            given = {name: GIVEN[name] for name in needed}
            try:
                kind(**given)
            except (HqpError, TypeError):
                continue
            numbers = [f.name for f in fields if type(f.default) in (int, float) or f.name in ("kp", "kd", "radius")]
            found += [(kind, name, given) for name in numbers]
    return found


DECLARED = declarations()


def test_there_are_many() -> None:
    assert len(DECLARED) > 80
    assert len({kind for kind, *_ in DECLARED}) > 30


@pytest.mark.parametrize("bad", [math.nan, "one", [1.0, math.nan]], ids=str)
@pytest.mark.parametrize(("kind", "name", "given"), DECLARED, ids=[f"{k.__name__}-{n}" for k, n, _ in DECLARED])
def test_a_value_that_is_no_number_is_refused(kind: Any, name: str, given: dict[str, Any], bad: object) -> None:
    with pytest.raises(HqpError, match=name):
        kind(**{**given, name: bad})


@pytest.mark.parametrize("bits", [64, 32, 16, 0], ids=lambda bits: f"{bits} bits" if bits else "array")
@pytest.mark.parametrize(("kind", "name", "given"), DECLARED, ids=[f"{k.__name__}-{n}" for k, n, _ in DECLARED])
def test_the_storage_of_a_number_does_not_matter(kind: Any, name: str, given: dict[str, Any], bits: int) -> None:
    default = given.get(name, inspect.signature(kind).parameters[name].default)
    value = default if isinstance(default, (int, float)) else 1.0
    scalar = np.asarray(value, f"{np.asarray(value).dtype.kind}{bits // 8}") if bits else np.asarray(value)
    plain, other = (kind(**{**given, name: number}) for number in (scalar.item(), scalar[()] if bits else scalar))
    if dataclasses.is_dataclass(plain):
        for field in dataclasses.fields(plain):
            one, two = (getattr(made, field.name) for made in (plain, other))
            assert one == two
            assert type(one) is type(two)
