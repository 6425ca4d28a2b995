"""Robots: models by name, file or Pinocchio model."""

from __future__ import annotations

import importlib
from typing import TYPE_CHECKING

if __name__ != "hqp.robots":
    raise ImportError("a second copy of the robots would have second classes; write `import hqp.robots`")

from .catalogue import load, names
from .on_pinocchio import Robot, Wheel
from .state import State

if TYPE_CHECKING:
    from .on_mujoco import Bumps, Noise, Plane, Plant, Ramp, Sensors, Servo, Step

__all__ = [
    "Bumps", "Noise", "Plane", "Plant", "Ramp", "Robot", "Sensors", "Servo", "State", "Step", "Wheel", "load", "names",
]  # fmt: skip

_SIMULATED = frozenset({"Bumps", "Noise", "Plane", "Plant", "Ramp", "Sensors", "Servo", "Step"})


def __getattr__(name: str) -> object:
    """Import modules that need MuJoCo, an extra, on first use."""
    if name in _SIMULATED:
        return getattr(importlib.import_module(f"{__name__}.on_mujoco"), name)
    raise AttributeError(f"module {__name__!r} has no attribute {name!r}")
