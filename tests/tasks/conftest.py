"""Rows of one element: native if it has a plan, or by its readable functions."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass
from typing import Any

import pytest

import hqp.programs.assembly
from hqp import PD, P
from hqp.arrays import Mat, Vec
from hqp.declare.element import Element
from hqp.declare.reference import Reference
from hqp.declare.robot import Robot, State
from hqp.programs.assembly import Assembly


@dataclass(frozen=True)
class Written:
    """The arrays of one element's rows after a fill."""

    J: Mat
    error: Vec
    drift: Vec
    lower: Vec
    upper: Vec


def assembly(element: Element, robot: Robot, order: int, native: bool, dt: float = 0.002) -> Assembly:
    """One element, all its rows dense."""
    laws: dict[str, Any] = {element.name: P(1.0) if order == 1 else PD(1.0, 1.0)}
    patch = pytest.MonkeyPatch()
    if not native:
        patch.setattr(hqp.programs.assembly, "native", None)
    try:
        return Assembly([element], [], robot, dt, laws)
    finally:
        patch.undo()


@pytest.fixture
def written() -> Callable[..., Written]:
    """The rows of an element: ``written(element, state, reference, order=2, native=True)``."""

    def run(element: Element, state: State, reference: Reference, order: int = 2, native: bool = True) -> Written:
        rows = assembly(element, state.robot, order, native)
        rows.fill(state, {element.name: reference}, ())
        return Written(rows.J / element.weight, rows.error, rows.drift, rows.lower, rows.upper)

    return run
