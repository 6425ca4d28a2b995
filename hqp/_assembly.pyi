"""Rows of the common tasks, written by one call a tick (built from cpp/rows)."""

from collections.abc import Callable, Sequence

from numpy import int8
from numpy.typing import NDArray

from hqp.arrays import Index, Mat, Vec
from hqp.plans import Plan
from hqp.reference import Reference
from hqp.robot import Body

class Measure:
    """(q'q + v'v, whether parts of q, start to stop, have length one up to rounding)."""

    def __init__(self, units: Sequence[tuple[int, int]], rounding: float) -> None: ...
    def __call__(self, q: Vec, v: Vec) -> tuple[float, bool]: ...

def is_rotation(R: Mat, tolerance: float) -> bool:
    """Whether R ``(3, 3)`` is a rotation; False for what is not finite."""

def is_pose(T: Mat, tolerance: float) -> bool:
    """Whether T ``(4, 4)`` is a homogeneous matrix with a rotation; False for what is not finite."""

class Assembly:
    """Operations over live arrays, run in the order in which they were added; keeps references to the arrays.

    twists ``(6, nv)`` and bodies: of the robot.
    """

    def __init__(
        self, twists: Mat, bodies: Sequence[Body], dt: float, order: int, reference: type[Reference]
    ) -> None: ...
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

    def slot(
        self, name: str, target: Vec | None, shape: Sequence[int], normal: Vec | None, rate: Vec, feedforward: Vec
    ) -> None:
        """Where the reference of an element goes: target, flat, of that shape, None where Python reads the value."""

    def hold(self, name: str, value: Vec | None) -> None:
        """The value, flat, that an element has without a reference."""

    def answers(
        self,
        solve: Callable[[], tuple[int, int, int, bool]],
        values: Vec,
        active: NDArray[int8],
        command: Sequence[int],
        largest: float,
    ) -> None:
        """What ``solve`` of a bound kernel leaves: outcome (0: an optimum) and counts; x and slack; marks.

        command: which of x are one.  largest: a demand whose norm is beyond it is out of the ordinary.
        """

    def fill(self, q: Vec, v: Vec, references: tuple[Reference, ...], fresh: bool) -> bool:
        """Take references and write rows; False for an extraordinary one.  fresh: hold values first."""

    def solve(self, v: Vec) -> bytearray | tuple[int, int, int, bool] | None:
        """Laws and solver: a record of the tick, what ``solve`` returned if no optimum, None for extraordinary demands.

        The record: command, x, slack, begin and seconds for rows and for solve, iterations, factorisations; marks.
        """

    def step(
        self, q: Vec, v: Vec, references: tuple[Reference, ...], fresh: bool
    ) -> bytearray | tuple[int, int, int, bool] | None:
        """``fill`` and ``solve``; None where either finds something out of the ordinary."""
