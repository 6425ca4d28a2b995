"""Blocks made by hand, and what a session would make of them."""

from __future__ import annotations

from collections.abc import Callable

import numpy as np
import pytest

from hqp.element import Block, Element, Writer
from hqp.reference import Reference
from hqp.robot import Robot, State

Bind = Callable[[Robot, Block], Writer]


def make_block(element: Element, robot: Robot, order: int, dt: float = 0.002) -> Block:
    """A block for one element, filled with NaN but for J, so that whatever a writer leaves out shows."""
    m = element.rows(robot)
    n = robot.nv if element.quantity == "motion" else robot.actuated.size
    error, drift, lower, upper = (np.full(m, np.nan) for _ in range(4))
    return Block(np.zeros((m, n)), error, np.zeros(m), np.zeros(m), drift, lower, upper, order, dt)


@pytest.fixture
def written() -> Callable[..., Block]:
    """A block after one call of an element's writer: ``written(element, state, reference, order, bind=...)``."""

    def run(
        element: Element,
        state: State,
        reference: Reference,
        order: int = 2,
        bind: Bind | None = None,
        dt: float = 0.002,
    ) -> Block:
        block = make_block(element, state.robot, order, dt)
        write = (bind or element.bind)(state.robot, block)
        write(state, reference)
        if block.twist is not None and block.support is not None:
            block.J[:] = (block.twist @ state.robot.joint_twists) * block.support
        return block

    return run
