"""Rows of the common tasks, written by one call a tick (built from cpp/assembly_bindings.cpp)."""

from collections.abc import Sequence

from hqp.arrays import Mat, Vec

class Assembly:
    """Operations over live arrays, run in the order in which they were added; keeps references to the arrays."""

    def __init__(self) -> None: ...
    def point(
        self,
        *,
        J: Mat,
        error: Vec,
        reference: Vec,
        weight: float,
        position: Vec,
        rotation: Mat,
        twists: Mat,
        columns: Sequence[int],
        axes: Sequence[int],
        offset: Sequence[float],
    ) -> None: ...
    def pose(
        self,
        *,
        J: Mat,
        error: Vec,
        reference: Vec,
        weight: float,
        position: Vec,
        rotation: Mat,
        twists: Mat,
        columns: Sequence[int],
    ) -> None: ...
    def rotation(
        self,
        *,
        J: Mat,
        error: Vec,
        reference: Vec,
        weight: float,
        position: Vec,
        rotation: Mat,
        twists: Mat,
        columns: Sequence[int],
    ) -> None: ...
    def angles(
        self,
        *,
        J: Mat,
        error: Vec,
        reference: Vec,
        weight: float,
        position: Vec,
        rotation: Mat,
        twists: Mat,
        columns: Sequence[int],
        picked: Sequence[int],
        gimbal: float,
    ) -> None: ...
    def com(
        self,
        *,
        J: Mat,
        error: Vec,
        reference: Vec,
        weight: float,
        com: Vec,
        jacobian: Mat,
        axes: Sequence[int],
    ) -> None: ...
    def joints(self, *, J: Mat, error: Vec, reference: Vec, weight: float, positions: Sequence[int]) -> None: ...
    def box(
        self,
        *,
        lower: Vec,
        upper: Vec,
        positions: Sequence[int],
        columns: Sequence[int],
        low: Vec,
        high: Vec,
        speed: Vec,
        acceleration: float,
        return_velocity: float,
        dt: float,
        order: int,
    ) -> None: ...
    def run(self, q: Vec, v: Vec) -> None: ...
