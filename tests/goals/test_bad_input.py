"""Invalid arguments of reach and solve_ik: hqp's errors with the allowed values."""

from __future__ import annotations

import math
from typing import Any

import numpy as np
import pytest

import hqp
from hqp import Level, Stack
from hqp.errors import HqpError
from hqp.tasks import Position, Posture

HAND = Position(frame="r_palm")
STACK = Stack(Level(HAND), Level(Posture()))


class Something:
    """A useless object, printed equally in every process: workers compare the names of tests."""

    def __repr__(self) -> str:
        return "Something()"


@pytest.fixture(scope="module")
def cbi() -> Any:
    return hqp.robots.load("cbi")


@pytest.mark.parametrize("bad", [math.nan, -1.0, "x", None, (), {}, Something(), np.zeros(3)], ids=repr)
@pytest.mark.parametrize("what", ["restarts", "steps", "tolerance", "budget", "q0", "reference", "stack", "robot"])
def test_reach(cbi: Any, what: str, bad: Any) -> None:
    given: dict[str, Any] = {"stack": STACK, "robot": cbi, "reference": HAND.at(np.zeros(3)), what: bad}
    if what == "q0" and bad is None:
        return
    with pytest.raises(HqpError):
        hqp.reach(given.pop("stack"), given.pop("robot"), given.pop("reference"), **given)


@pytest.mark.parametrize("bad", [math.nan, math.inf])
def test_a_start_that_is_no_number_is_not_reached(cbi: Any, bad: float) -> None:
    q = cbi.home.copy()
    q[-1] = bad
    with pytest.raises(HqpError, match="q0"):
        hqp.reach(STACK, cbi, HAND.at(cbi.state().position("r_palm")), q0=q)


@pytest.mark.parametrize("bad", [math.nan, -1.0, "x", (), Something()], ids=repr)
@pytest.mark.parametrize("what", ["robot", "q", "levels", "dt"])
def test_solve_ik(cbi: Any, what: str, bad: Any) -> None:
    given = {"robot": cbi, "q": cbi.home, "levels": STACK, "dt": 0.01, what: bad}
    with pytest.raises(HqpError):
        hqp.solve_ik(*given.values(), HAND.at(np.zeros(3)))
