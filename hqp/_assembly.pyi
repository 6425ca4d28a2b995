"""Rows of the common tasks, written by one call a tick (built from cpp/rows)."""

from collections.abc import Mapping, Sequence
from typing import Any

from hqp.arrays import Mat, Vec
from hqp.declare.reference import Reference
from hqp.declare.robot import Body, Placed, TreeJoint

class Measure:
    """(q'q + v'v, whether parts of q, start to stop, have length one up to rounding); None for other shapes."""

    def __init__(self, units: Sequence[tuple[int, int]], rounding: float, nq: int, nv: int) -> None: ...
    def __call__(self, q: Vec, v: Vec) -> tuple[float, bool] | None: ...

def is_rotation(R: Mat, tolerance: float) -> bool:
    """Whether R ``(3, 3)`` is a rotation; False for what is not finite."""

def is_pose(T: Mat, tolerance: float) -> bool:
    """Whether T ``(4, 4)`` is a homogeneous matrix with a rotation; False for what is not finite."""

class Assembly:
    """Operations over live arrays, run in the order in which they were added; keeps references to the arrays.

    twists ``(6, nv)`` and bodies: of the robot.
    """

    def __init__(
        self, twists: Mat, bodies: Sequence[Body], nq: int, dt: float, order: int, reference: type[Reference]
    ) -> None: ...
    def add(self, operation: Mapping[str, Any]) -> None:
        """An operation of a plan, as the other parts in ``hqp.programs.assembly.Assembly.parts``; its arrays are live.

        Raises TypeError for a plan without an operation, ValueError for a wrong shape or number.
        """

    def laws(self, laws: Mapping[str, Any]) -> None:
        """What ``demand`` works on; laws as in hqp/declare/law.py."""

    def law(self, start: int, stop: int, law: Mapping[str, Any]) -> int:
        """Another law of the element with these rows, and its number; 0, the first one, is what it has.

        Raises ValueError for other rows.
        """

    def aim(self, start: int, stop: int, number: int, at_once: bool) -> None:
        """The element goes over to that law, or has it at once."""

    def go_on(self) -> None:
        """Laws that go over do so by one period."""

    def out(self, name: str, start: int, stop: int, out: bool) -> None:
        """Whether an element with these rows is out from now on: they are free, and no support stands on it.

        Raises ValueError for other rows.
        """

    def run(self, q: Vec, v: Vec, measured: Vec) -> None:
        """Write rows, errors, drifts and ways left; v: velocity that limits stand around, measured: of the state."""

    def demand(self, v: Vec) -> None:
        """Write demands and bounds from what is in the arrays."""

    def limit(self, v: Vec, reactions: object) -> None:
        """Write bounds around a speed anew, around what constraints leave; see ``hqp.tasks.JointLimits``.

        reactions: a capsule of ``_torque.Parts.reactions``, whose constraints are the first of all rows.
        """

    def core(self) -> object:
        """A capsule of the rows themselves, for ``_session``."""

    def slot(self, slot: Mapping[str, Any]) -> None:
        """Where the reference of an element goes: target, flat, of that shape, None where Python reads the value.

        plain: whether ``tick`` takes a target as it is: 0 no, 1 numbers, 2 a rotation, 3 a homogeneous matrix.
        operation: number of the one that tells what the element is at, None for none.
        """

    def dynamics(self, terms: Mapping[str, Any]) -> None:
        """Each ``run`` writes A ``(nv, nv)``, column-major, its upper triangle, and bias = b + g ``(nv,)`` with loads.

        inertias: of each of ``bodies``, see ``hqp.declare.robot.Robot.inertias``.  rotors: reflected inertia of each
        tangent coordinate.  gravity: acceleration of free fall ``(3,)``.
        """

    def load(self, load: Mapping[str, Any]) -> None:
        """A known load, its live value read at each ``run``; payloads count for centres of mass."""

    def answers(self, call: object, values: Vec, largest: float) -> None:
        """The solve of a bound kernel, a capsule, and its x and slack, for ``Descents`` and ``Snapshots``.

        largest: a demand whose norm is beyond it is out of the ordinary.
        """

    def move(self, robot: Kinematics) -> None:
        """``run`` begins with the forward kinematics of q."""

    def written(self, rows: Sequence[tuple[int, int]], bounds: Sequence[tuple[int, int]]) -> None:
        """Where rows in Python are written: first and last row in J, and, of inequalities, in the bounds."""

class Snapshots:
    """Live arrays copied into a ring of snapshots of ``size`` bytes; keeps references to all of them.

    parts: bytes, and where they begin in a snapshot.  Raises ValueError for a part that does not fit.
    """

    def __init__(self, parts: Sequence[tuple[memoryview, int]], ring: memoryview, size: int) -> None: ...
    def take(self, i: int) -> None:
        """Write snapshot ``i``; raises IndexError for one beyond the ring."""

class Pace:
    """Sizes of steps of a descent and when it ends: see hqp/goals/descent.py."""

    def __init__(
        self, step: float, least: float, progress: float, polish: float, still: float, stalled: int | None, last: int
    ) -> None: ...

class Kinematics:
    """Forward kinematics of a robot, written into its live views."""

    def __init__(self, twists: Mat, joints: Sequence[TreeJoint], frames: Sequence[Placed]) -> None: ...
    @property
    def size(self) -> int:
        """Numbers of a configuration."""

    def update(self, q: Vec) -> None:
        """Placements of joints and frames, and twists, at q ``(nq,)``."""

    def integrate(self, q: Vec, x: Vec, h: float, out: Vec) -> None:
        """The configuration after moving with velocity x for h [s], into out ``(nq,)``."""

class Descents:
    """Newton steps of an assembly, at gain 1 for a second, to the end in one call.

    members: first and last row of each element, the share of a violation that its bounds make up for in a step (0 for
    equalities) and its group, -1 where its error counts for nothing.
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
        """Take the references of the descents to follow; False for one that is out of the ordinary."""

    def run(self, q: Vec, merit: Vec, errors: Vec, tolerance: float, most: int, seconds: float) -> tuple[int, int]:
        """From q ``(nq,)``, which is where the best found is afterwards, as are merit and errors.

        (how it ended, steps taken): 0 met, 1 no solution, 2 no step improves, 3 stalled, 4 out of steps or time, 5
        something out of the ordinary, which the general path tells.
        """
