"""Rows of the common tasks, written by one call a tick (built from cpp/rows)."""

from collections.abc import Sequence

from numpy import int8
from numpy.typing import NDArray

from hqp.arrays import Index, Mat, Vec
from hqp.plans import Plan
from hqp.robot import Body

class Assembly:
    """Operations over live arrays, run in the order in which they were added; keeps references to the arrays.

    twists ``(6, nv)`` and bodies: of the robot.
    """

    def __init__(self, twists: Mat, bodies: Sequence[Body], dt: float, order: int) -> None: ...
    def add(
        self,
        plan: Plan,
        *,
        J: Mat | None,
        error: Vec,
        drift: Vec | None,
        lower: Vec,
        upper: Vec,
        reference: Vec,
        normal: Vec | None,
        weight: float,
    ) -> None:
        """The operation of a plan, with the arrays it writes; reference, flat, and normal ``(3,)`` are read.

        Raises TypeError for a plan without an operation.
        """

    def laws(
        self,
        *,
        J: Mat,
        error: Vec,
        rate: Vec,
        feedforward: Vec,
        drift: Vec,
        kp: Vec,
        kd: Vec,
        weight: Vec,
        pick: Index,
        kind: NDArray[int8],
        demand: Vec,
        lower: Vec,
        upper: Vec,
        saturations: Sequence[tuple[int, int, float, float, float]],
    ) -> None:
        """What ``demand`` works on: see ``hqp.assembly.Assembly``; the laws are those of hqp/law.py."""

    def run(self, q: Vec, v: Vec) -> None:
        """Write rows, errors, drifts and ways left."""

    def demand(self, v: Vec) -> None:
        """Write demands and bounds from what is in the arrays."""
