"""The one place where coal is imported, or hpp-fcl 2, which Pinocchio 2.7 was built with, under coal's name."""

from __future__ import annotations

import importlib
from typing import Any

try:
    coal: Any = importlib.import_module("coal")
except ImportError:
    coal = importlib.import_module("hppfcl")

MESH_DISTANCES: bool = coal.__name__ == "coal"
"""False beside hpp-fcl 2.4, which returns 0.397 m for a sphere 0.35 m from a box of triangles, and wrong normals."""

Placement: Any = coal.Transform3s if MESH_DISTANCES else coal.Transform3f

__all__ = ["MESH_DISTANCES", "Placement", "coal"]
