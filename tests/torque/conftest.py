"""Robots of the torque tests, loaded once."""

from __future__ import annotations

import pytest

import hqp
from hqp.robots import Robot


@pytest.fixture(scope="session", params=["cbi", "talos"])
def humanoid(request: pytest.FixtureRequest) -> Robot:
    if request.param == "talos":
        pytest.importorskip("importlib.metadata").distribution("example-robot-data")
    return hqp.robots.load(request.param)


@pytest.fixture(scope="session")
def dreamer() -> Robot:
    return hqp.robots.load("dreamer")
