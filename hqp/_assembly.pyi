"""Rows of the common tasks, written by one call a tick (built from cpp/rows)."""

from collections.abc import Sequence
from typing import TypeAlias

from hqp.arrays import Index, Mask, Mat, Vec

_Placement: TypeAlias = tuple[Vec, Mat]
_Body: TypeAlias = tuple[int, int, int, float, tuple[float, float, float], _Placement]
_Rows: TypeAlias = tuple[Mat, Vec, Vec | None, Vec, float]
_Frame: TypeAlias = tuple[_Placement, int, Sequence[int]]
_Observer: TypeAlias = tuple[_Frame, bool, float]

class Assembly:
    """Operations over live arrays, run in the order in which they were added; keeps references to the arrays.

    twists ``(6, nv)`` and bodies: of the robot.  rows: J ``(m, nv)``, error and drift ``(m,)`` to be written, drift
    None where it is not asked for, the reference, flat, and the weight of the rows of J.
    frame: placement, body and columns.  observer: frame, whether its heading is meant, least length of its x axis.
    """

    def __init__(self, twists: Mat, bodies: Sequence[_Body]) -> None: ...
    def point(
        self,
        *,
        rows: _Rows,
        frame: _Frame,
        observer: _Observer | None,
        axes: Sequence[int],
        offset: Sequence[float],
    ) -> None: ...
    def pose(self, *, rows: _Rows, frame: _Frame, observer: _Observer | None) -> None: ...
    def rotation(self, *, rows: _Rows, frame: _Frame, observer: _Observer | None) -> None: ...
    def angles(
        self, *, rows: _Rows, frame: _Frame, observer: _Observer | None, picked: Sequence[int], gimbal: float
    ) -> None: ...
    def edge(
        self,
        *,
        rows: _Rows,
        frame: _Frame,
        axis: Sequence[float],
        first: Sequence[float],
        other: Sequence[float],
    ) -> None: ...
    def wheel(
        self,
        *,
        rows: _Rows,
        frame: _Frame,
        normal: Vec,
        radius: float,
        axle: Sequence[float],
        picked: Sequence[int],
        aligned: float,
    ) -> None: ...
    def com(self, *, rows: _Rows, observer: _Observer | None, part: int, axes: Sequence[int]) -> None: ...
    def joints(self, *, rows: _Rows, positions: Sequence[int]) -> None: ...
    def coupling(self, *, rows: _Rows, positions: Sequence[int], coefficients: Sequence[float]) -> None: ...
    def box(
        self,
        *,
        lower: Vec,
        upper: Vec,
        positions: Sequence[int],
        columns: Sequence[int],
        low: Sequence[float],
        high: Sequence[float],
        speed: Sequence[float],
        acceleration: Sequence[float],
        braking: Sequence[float],
        return_velocity: float,
        dt: float,
        order: int,
    ) -> None: ...
    def laws(
        self,
        *,
        order: int,
        J: Mat,
        error: Vec,
        rate: Vec,
        feedforward: Vec,
        drift: Vec,
        kp: Vec,
        kd: Vec,
        weight: Vec,
        pick: Index,
        equality: Mask,
        demand: Vec,
        lower: Vec,
        upper: Vec,
        saturations: Sequence[tuple[int, int, float, float, float]],
    ) -> None:
        """What ``demand`` does; as hqp.demands.Demands."""

    def run(self, q: Vec, v: Vec) -> None:
        """Write rows, errors and drifts."""

    def demand(self, v: Vec) -> None:
        """Write demands and bounds from what is in the arrays."""
