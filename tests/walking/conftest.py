"""The robot of walkers that move on their own model."""

from __future__ import annotations

from typing import Any

import pytest

import hqp.robots


@pytest.fixture(scope="module")
def robot() -> Any:
    """G1 with the inertia of its motors."""
    return hqp.robots.load("g1", rotors=True)
