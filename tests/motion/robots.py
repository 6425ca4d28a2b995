"""Robots of these tests: copies, so that meshes are read once a process."""

from __future__ import annotations

from functools import cache

import hqp
from hqp.robots import Robot

_loaded = cache(hqp.robots.load)


def robot(name: str) -> Robot:
    """A robot of the catalogue with data of its own; capsules that one copy found are those of all."""
    return _loaded(name).copy()
