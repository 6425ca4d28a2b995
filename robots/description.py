"""Result of reading a model file: the model, and all that a Pinocchio model does not hold."""

from __future__ import annotations

from dataclasses import dataclass, field
from pathlib import Path
from typing import Any, Literal

from hqp.arrays import Vec
from hqp.errors import ModelError

from .obstacles import Obstacles

MOST = 400
"""Most coordinates of a model: Pinocchio's data grow with their cube."""

LARGEST = 1e50
"""Lengths, masses and inertias beyond this are no numbers of a robot; the square of their product still is a number."""


def require_room(path: Path | str, nv: int) -> None:
    """Raise ModelError for a file with more coordinates than Pinocchio's data have room for."""
    if nv > MOST:
        size = 32 * nv**3 / 1e9  # four tensors
        raise ModelError(f"{path}: nv = {nv}, allowed {MOST}: Pinocchio would need {size:.0f} GB")


@dataclass(frozen=True)
class Closure:
    """Two frames of the model that coincide: in a point (``Ball``) or as a whole (``Weld``)."""

    name: str
    kind: Literal["Ball", "Weld"]
    frame: str
    relative_to: str


@dataclass
class Description:
    """A model read from a file.

    model: pinocchio.Model.  source: the file, None for a MjModel.  rooted: true if its root was freed or fixed on
    reading.  simulated: the MjModel behind an MJCF.  carriers: for each of its bodies the joint that moves it and its
    placement there.  roots: its bodies that carry the robot and hang on the world.  scene: its moving bodies that are
    not the robot, obstacles.
    actuated: joints with a motor, None for all of one axis.  tendons: for motors that pull several joints their
    coefficients, 1 at the motor's own joint.  home ``(nq,)`` and named configurations.  couplings:
    (coefficients by joint, offset), sum c_j q_j = offset.  closures: of loops.  cones: by joint of three axes the
    largest turn from its zero [rad].  disabled_pairs: links that an SRDF disables.  notes: parts of the file that the
    model lacks.  warnings: probable mistakes in the file.
    """

    model: Any
    source: Path | None
    simulated: Any = None
    rooted: bool | None = None
    carriers: list[tuple[int, Any]] = field(default_factory=list)
    roots: tuple[int, ...] = ()
    scene: frozenset[int] = frozenset()
    obstacles: Obstacles = field(default_factory=Obstacles)
    actuated: tuple[str, ...] | None = None
    tendons: dict[str, dict[str, float]] = field(default_factory=dict)
    home: Vec | None = None
    configurations: dict[str, Vec] = field(default_factory=dict)
    couplings: list[tuple[dict[str, float], float]] = field(default_factory=list)
    closures: list[Closure] = field(default_factory=list)
    cones: dict[str, float] = field(default_factory=dict)
    disabled_pairs: frozenset[frozenset[str]] = frozenset()
    notes: list[str] = field(default_factory=list)
    warnings: list[str] = field(default_factory=list)
