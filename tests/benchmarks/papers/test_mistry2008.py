"""Mistry 2008, equation by equation: the benchmark's checks at a few states, negative controls included."""

from __future__ import annotations

from collections.abc import Callable
from functools import cache
from types import ModuleType

import pytest

from benchmarks.mistry2008 import loop
from benchmarks.mistry2008.equations import contacts, headline, kinematics, prioritised, second_order, theorems
from benchmarks.mistry2008.equations.integration import COG_ERROR, FOOT_ERROR, GAIN, HAND_RMS
from benchmarks.reports.checks import Check
from hqp import robots
from hqp.robots import Robot
from tests.scenes.mistry2008 import GAINS, Gains, paper_stack, roles


@pytest.fixture(scope="module", params=["cbi", pytest.param("talos", marks=pytest.mark.slow)])
def robot(request: pytest.FixtureRequest) -> Robot:
    return robots.load(request.param)


@pytest.fixture(scope="module")
def rows(robot: Robot) -> Callable[[ModuleType, int], list[Check]]:
    """The rows of a module's checks at some states, made once."""
    return cache(lambda module, states: list(module.checks(robot, states)))


@pytest.mark.long
@pytest.mark.parametrize(
    ("module", "states"),
    [(kinematics, 3), (contacts, 4), (prioritised, 4), (second_order, 3), (theorems, 2), (headline, 4)],
    ids=["kinematics", "contacts", "prioritised", "second_order", "theorems", "headline"],
)
def test_every_row_holds(module: ModuleType, states: int, rows: Callable[[ModuleType, int], list[Check]]) -> None:
    checks = rows(module, states)
    assert checks
    failed = [
        f"{c.equation} {c.check}: {c.measured:.2g} against {c.tolerance:g} {c.note}" for c in checks if not c.passed
    ]
    assert not failed, "\n".join(failed)


@pytest.mark.long
def test_printed_errata_are_among_the_rows(rows: Callable[[ModuleType, int], list[Check]]) -> None:
    checks = [*rows(kinematics, 3), *rows(prioritised, 4), *rows(second_order, 3)]
    notes = " ".join(check.note for check in checks if check.kind == "negative control")
    assert all(f"M{number}" in notes for number in (1, 2, 3, 7, 8, 9, 10, 11, 12, 13))


@pytest.mark.long
def test_figure_eight_in_the_loop(robot: Robot) -> None:
    stack = paper_stack(roles(robot), Gains(hand=GAIN))
    recursive = loop.run(robot, "nullspace", 1.0, stack=stack)
    printed = loop.run(robot, "chiaverini", 1.0, stack=stack)
    assert recursive.hand_rms < HAND_RMS
    assert printed.hand_rms > 10.0 * HAND_RMS
    for trace in (recursive, printed):
        assert trace.com_error < COG_ERROR
        assert trace.slip < FOOT_ERROR


@pytest.mark.long
def test_cog_without_feedforward_lags_as_a_first_order_system(robot: Robot) -> None:
    trace = loop.run(robot, "nullspace", 10.0, hand=loop.rest, com=loop.side_to_side, feedforward=False, dt=0.01)
    gain, _ = loop.response(trace)
    w = 2.0 * 3.141592653589793 / loop.COG_PERIOD
    assert gain == pytest.approx(GAINS.cog / (GAINS.cog**2 + w**2) ** 0.5, abs=5e-3)


def test_feet_drift_in_proportion_to_the_period(robot: Robot) -> None:
    slips = [
        loop.run(robot, "nullspace", 1.0, com=loop.side_to_side, contact_gain=0.0, dt=dt).slip for dt in (0.02, 0.01)
    ]
    assert slips[0] / slips[1] == pytest.approx(2.0, abs=0.3)
