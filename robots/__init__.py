"""Robots: models by name, file or Pinocchio model."""

from __future__ import annotations

if __name__ != "hqp.robots":
    raise ImportError("a second copy of the robots would have second classes; write `import hqp.robots`")

from .catalogue import load, names
from .on_pinocchio import Robot, Wheel
from .state import State

__all__ = ["Robot", "State", "Wheel", "load", "names"]
