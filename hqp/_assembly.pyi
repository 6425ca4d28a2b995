"""Rows of the common tasks, written by one call per tick (built from cpp/rows)."""

from collections.abc import Mapping, Sequence
from typing import Any

from hqp.arrays import Mat, Vec
from hqp.declare.reference import Reference
from hqp.declare.robot import Body, Placed, TreeJoint

class Measure:
    """(q'q + v'v, true if the parts of q from start to stop have unit length up to rounding); None for other shapes."""

    def __init__(self, units: Sequence[tuple[int, int]], rounding: float, nq: int, nv: int) -> None: ...
    def __call__(self, q: Vec, v: Vec) -> tuple[float, bool] | None: ...

def is_rotation(R: Mat, tolerance: float) -> bool:
    """Return true if R ``(3, 3)`` is a rotation; false for numbers that are not finite."""

def is_pose(T: Mat, tolerance: float) -> bool:
    """Return true if T ``(4, 4)`` is a homogeneous matrix with a rotation; false for numbers that are not finite."""

class Assembly:
    """Operations over live arrays, run in the order of ``add``; keeps references to the arrays.

    twists ``(6, nv)`` and bodies belong to the robot.
    """

    def __init__(
        self, twists: Mat, bodies: Sequence[Body], nq: int, dt: float, order: int, reference: type[Reference]
    ) -> None: ...
    def add(self, operation: Mapping[str, Any]) -> None:
        """Append an operation of a plan, one of ``hqp.programs.assembly.Assembly.parts``; its arrays are live.

        Raises TypeError for a plan without an operation, ValueError for a wrong shape or number.
        """

    def laws(self, laws: Mapping[str, Any]) -> None:
        """Set the laws that ``demand`` applies, as in hqp/declare/law.py."""

    def law(self, start: int, stop: int, law: Mapping[str, Any]) -> int:
        """Add a law for the element with these rows and return its number; its first law has number 0.

        Raises ValueError for other rows.
        """

    def aim(self, start: int, stop: int, number: int, at_once: bool) -> None:
        """Change the element to that law, over time or at once."""

    def go_on(self) -> None:
        """Advance changes of laws by one period."""

    def out(self, name: str, start: int, stop: int, out: bool) -> None:
        """Switch the element with these rows off or on; rows of an absent element are free, and it supports nothing.

        Raises ValueError for other rows.
        """

    def run(self, q: Vec, v: Vec, measured: Vec) -> None:
        """Write rows, errors, drifts and ways left; v: velocity in the centre of limits, measured: the state's
        velocity."""

    def demand(self, v: Vec) -> None:
        """Write demands and bounds from the contents of the arrays."""

    def limit(self, v: Vec, reactions: object) -> None:
        """Write the bounds on speeds again, relative to the speed that constraints leave; see
        ``hqp.tasks.JointLimits``.

        reactions: a capsule of ``_torque.Parts.reactions``, whose constraints are the first of all rows.
        """

    def core(self) -> object:
        """Return a capsule of the rows for ``_session``."""

    def slot(self, slot: Mapping[str, Any]) -> None:
        """Declare the place of an element's reference: flat target and its shape, None if Python reads the value.

        plain: target that ``tick`` accepts unchanged: 0 none, 1 numbers, 2 a rotation, 3 a homogeneous matrix.
        operation: number of the operation that gives the element's present value, None for none.
        """

    def dynamics(self, terms: Mapping[str, Any]) -> None:
        """Add dynamics: ``run`` writes A ``(nv, nv)``, column-major, upper triangle, and bias = b + g ``(nv,)`` with
        loads.

        inertias: one for each of ``bodies``, see ``hqp.declare.robot.Robot.inertias``.  rotors: reflected inertia of
        each tangent coordinate.  gravity: acceleration of free fall ``(3,)``.
        """

    def load(self, load: Mapping[str, Any]) -> None:
        """Add a known load; ``run`` reads its live value, and payloads enter the centres of mass."""

    def answers(self, call: object, values: Vec, largest: float) -> None:
        """Bind the solve of a kernel, a capsule, with its x and slack, for ``Descents`` and ``Snapshots``.

        largest: norm above which a demand ends a descent as extraordinary.
        """

    def move(self, robot: Kinematics) -> None:
        """Let ``run`` begin with the forward kinematics of q."""

    def written(self, rows: Sequence[tuple[int, int]], bounds: Sequence[tuple[int, int]]) -> None:
        """Declare rows written in Python: first and last row in J and, for inequalities, in the bounds."""

class Snapshots:
    """Ring of snapshots of ``size`` bytes of live arrays; keeps references to all of them.

    parts: bytes, and their offset in a snapshot.  Raises ValueError for a part that does not fit.
    """

    def __init__(self, parts: Sequence[tuple[memoryview, int]], ring: memoryview, size: int) -> None: ...
    def take(self, i: int) -> None:
        """Write snapshot ``i``; raises IndexError beyond the ring."""

class Pace:
    """Step sizes and termination of a descent: see hqp/search/descent.py."""

    def __init__(
        self, step: float, least: float, progress: float, polish: float, still: float, stalled: int | None, last: int
    ) -> None: ...

class Kinematics:
    """Forward kinematics of a robot, written into its live views."""

    def __init__(self, twists: Mat, joints: Sequence[TreeJoint], frames: Sequence[Placed]) -> None: ...
    @property
    def size(self) -> int:
        """Length of a configuration."""

    def update(self, q: Vec) -> None:
        """Write placements of joints and frames, and twists, at q ``(nq,)``."""

    def integrate(self, q: Vec, x: Vec, h: float, out: Vec) -> None:
        """Write the configuration after motion with velocity x for h [s] to out ``(nq,)``."""

class Descents:
    """Newton steps of an assembly, at gain 1 for a second, to the end in one call.

    members: first and last row of each element, the share of a violation that its bounds correct in a step (0 for
    equalities) and its group, -1 if its error does not count.
    """

    def __init__(
        self,
        assembly: Assembly,
        robot: Kinematics,
        members: Sequence[tuple[int, int, float, int]],
        groups: int,
        nq: int,
        pace: Pace,
    ) -> None: ...
    def aim(self, references: tuple[Reference, ...]) -> bool:
        """Take the references of the next descents; return false for one that the general path must handle."""

    def run(self, q: Vec, merit: Vec, errors: Vec, tolerance: float, most: int, seconds: float) -> tuple[int, int]:
        """Descend from q ``(nq,)``; write the best configuration to q, and its merit and errors.

        Returns (outcome, steps taken): 0 met, 1 no solution, 2 no step improves, 3 stalled, 4 out of steps or time, 5
        extraordinary, left to the general path.
        """
