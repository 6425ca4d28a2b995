"""Rows of the common tasks, written by one call a tick (built from cpp/assembly_bindings.cpp)."""

from collections.abc import Sequence
from typing import TypeAlias

from hqp.arrays import Index, Mask, Mat, Vec

_Placement: TypeAlias = tuple[Vec, Mat]
_Body: TypeAlias = tuple[int, int, int, float, tuple[float, float, float], _Placement]
_Rows: TypeAlias = tuple[Mat, Vec, Vec | None, Vec, float]
_Frame: TypeAlias = tuple[_Placement, int, Sequence[int]]
_Observer: TypeAlias = tuple[_Frame, bool, float]

class Elimination:
    """The sparse and small parts of ``hqp.dynamics.ConstrainedDynamics.update``.

    parents: the tangent coordinate before each on its way to the world, -1 for none.  rows: m constraints.
    """

    def __init__(self, parents: Sequence[int], actuated: Sequence[int], rows: int) -> None: ...
    def eliminate(
        self, A: Mat, bias: Vec, J: Mat, gamma: Vec, tolerance: float, X: Mat, phi: Mat, Q: Mat, T: Mat, top: Mat
    ) -> int:
        """A = H^T H, Y = H^-T [U^T, -bias], H^-T J^T = Q T, top = Q^T Y - [0, T^-T gamma], P = Y - Q top.

        X = H^-1 P ``(nv, n + 1)`` and phi, the products of P's first n columns.  A by columns, the rest by rows.
        1; 0 with no such X, phi, Q, T, top for dependent constraints; -1 for an A that is not positive definite.
        """

class Holding:
    """``hqp.gravity.holding_torque`` for as many constraints as ``others``, the coordinates without a motor."""

    def __init__(self, actuated: Sequence[int], others: Sequence[int]) -> None: ...
    def torque(self, J: Mat, g: Vec, tau: Vec) -> bool:
        """tau = g - J^T f on the actuated coordinates, f zeroing it on the others; False where no f does."""

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
        acceleration: float,
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
