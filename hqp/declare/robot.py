"""Interface of a robot for tasks, formulations and sessions; hqp.robots holds the implementation on Pinocchio."""

from __future__ import annotations

from collections.abc import Collection, Mapping, Sequence
from contextlib import AbstractContextManager
from typing import Any, Protocol, TypeAlias

from hqp.arrays import Index, Mat, Vec
from hqp.shapes import LinkCapsule

Placement: TypeAlias = tuple[Vec, Mat]
"""Live views of a position ``(3,)`` and a rotation ``(3, 3)`` in the world, as of the current state."""

Body: TypeAlias = tuple[int, int, int, float, tuple[float, float, float], Placement]
"""A link: the body that carries it, the first and the number of the tangent coordinates of the joint between them,
its mass [kg], its centre of mass ``(3,)`` [m] in its own axes, its placement."""

Placed: TypeAlias = tuple[int, tuple[float, ...], tuple[float, ...], Placement]
"""Something fixed in a body: the body's index, position ``(3,)`` [m] and rotation, column by column ``(9,)``, in it,
and its placement in the world."""

TreeJoint: TypeAlias = tuple[int, int, int, tuple[float, ...], Placed]
"""A joint for native forward kinematics: 0 turning, 1 turning with cosine and sine in q, 2 sliding, 3 a ball, 4 free,
5 planar (x, y, cosine and sine in q), 6 translating; its first places in q and v, its axis, and where it stands in the
body that carries it."""

Load: TypeAlias = tuple[str, float, Vec]
"""A point mass that the robot carries: on which frame, mass [kg], where in the frame's axes ``(3,)`` [m]."""


class Wheel(Protocol):
    """A wheel: radius [m] and axle, a unit vector in the wheel's frame."""

    @property
    def radius(self) -> float: ...
    @property
    def axle(self) -> tuple[float, float, float]: ...


class Robot(Protocol):
    """A kinematic tree with ``nv`` tangent coordinates, some of them actuated."""

    @property
    def name(self) -> str: ...
    @property
    def nq(self) -> int: ...
    @property
    def nv(self) -> int: ...

    @property
    def current(self) -> State | None:
        """The state that the robot was moved to last, None after ``leave``."""
        ...

    @property
    def floating(self) -> bool:
        """True if the first six tangent coordinates are a free base."""
        ...

    @property
    def joint_names(self) -> tuple[str, ...]:
        """The actuated joints, in the order of a command."""
        ...

    @property
    def actuated(self) -> Index:
        """Tangent coordinate of each actuated joint, ``(n_actuated,)``."""
        ...

    @property
    def actuation(self) -> Mat:
        """U ``(n_actuated, nv)``: maps generalised to actuated velocities (Sentis 2012, eq. 6).

        A motor's row has a 1 at its joint, alone or, if it pulls a tendon, with the coefficients of other joints.
        """
        ...

    @property
    def frame_names(self) -> tuple[str, ...]: ...
    @property
    def groups(self) -> Mapping[str, tuple[str, ...]]:
        """Joint groups by name."""
        ...

    @property
    def wheels(self) -> Mapping[str, Wheel]:
        """Wheels by frame."""
        ...

    @property
    def landmarks(self) -> Mapping[str, tuple[str, ...]]:
        """Frames by role, such as ``soles``, ``palms``, ``base``."""
        ...

    @property
    def capsules(self) -> Sequence[LinkCapsule]:
        """Capsules around the links, for collision avoidance; raises ModelError for a robot without shapes."""
        ...

    def contacts(self) -> Any:
        """The collision shapes: ``touch(body, body, pose, pose)`` is true if they overlap at poses as in ``bodies``.

        Raises ModelError without shapes.
        """
        ...

    def keep_shapes(self) -> AbstractContextManager[None]:
        """Return a context in which ``capsules`` and ``contacts`` read the shapes of the file at most once."""
        ...

    @property
    def disabled_pairs(self) -> Collection[frozenset[str]]:
        """Pairs of links that need not be kept apart, by the SRDF of the robot's URDF."""
        ...

    @property
    def couplings(self) -> Sequence[Any]:
        """Relations of joints and closures of loops that the robot's file states, as constraints of a stack."""
        ...

    @property
    def continuous(self) -> Index:
        """Tangent coordinates of joints that turn without end and whose angle is known up to full turns."""
        ...

    @property
    def lower(self) -> Vec:
        """Lower joint limits ``(nv,)`` [rad or m], -inf if unlimited."""
        ...

    @property
    def upper(self) -> Vec:
        """Upper joint limits ``(nv,)`` [rad or m], inf if unlimited."""
        ...

    @property
    def velocity_limit(self) -> Vec:
        """Speed limits ``(nv,)`` [rad/s or m/s], inf if unlimited."""
        ...

    @property
    def effort_limit(self) -> Vec:
        """Effort limits ``(nv,)`` [N m or N], inf if unlimited."""
        ...

    @property
    def home(self) -> Vec:
        """A standing configuration ``(nq,)``."""
        ...

    @property
    def gravity(self) -> Vec:
        """Acceleration of free fall, world axes, ``(3,)`` [m/s^2]."""
        ...

    def frame(self, name: str) -> int:
        """Index of a frame; raises FrameNotFound with the closest names."""
        ...

    def joints(self, names: str | Sequence[str] | None) -> Index:
        """Tangent coordinates of joints or groups, of all joints but free ones for None; raises JointNotFound."""
        ...

    def joint_name(self, column: int) -> str:
        """Name of the joint of a tangent coordinate, 'base' for the free base."""
        ...

    def placement(self, frame: int) -> Placement:
        """Live views of a frame's position and rotation."""
        ...

    @property
    def bodies(self) -> Sequence[Body]:
        """The world, then the moving bodies, parents before children; ``subtree`` and ``body`` give indices of it."""
        ...

    @property
    def inertias(self) -> Sequence[tuple[float, ...]]:
        """Inertia of each of ``bodies``: xx, yy, zz, xy, xz, yz [kg m^2] about its centre of mass, in its axes."""
        ...

    @property
    def mass(self) -> float:
        """Total mass [kg]."""
        ...

    @property
    def rotors(self) -> Vec:
        """Reflected rotor inertia of each tangent coordinate ``(nv,)`` [kg m^2, kg], on the diagonal of A."""
        ...

    @property
    def tree_joints(self) -> Sequence[TreeJoint] | None:
        """The joints for native forward kinematics, one for each of ``bodies`` but the world.

        None where one is of no kind of ``TreeJoint``: a screw.
        """
        ...

    @property
    def placed_frames(self) -> Sequence[Placed]:
        """Frames whose ``placement`` was used so far."""
        ...

    def body(self, frame: int) -> int:
        """Index of the body that a frame is fixed in."""
        ...

    def positions(self, columns: Index) -> list[int] | None:
        """Places in q of single-axis joints; a continuous one has its cosine there, its sine after it.

        None if one is of a joint of several axes.
        """
        ...

    def support(self, frame: int) -> Vec:
        """1 for each tangent coordinate that moves the frame, 0 elsewhere, ``(nv,)``."""
        ...

    @property
    def joint_twists(self) -> Mat:
        """Live view ``(6, nv)``: world twist (at the origin, linear first) of each tangent coordinate."""
        ...

    def log3(self, rotation: Mat) -> Vec:
        """Rotation vector ``(3,)`` of a rotation matrix [rad]."""
        ...

    def subtree(self, joint: str) -> int:
        """Index of the body that a joint carries, with all it carries in turn; raises JointNotFound."""
        ...

    def state(self, q: Vec | None = None, v: Vec | None = None, time: float | None = None) -> State:
        """Move the robot to (q, v), measured at ``time`` [s], and return that state; earlier states become stale."""
        ...

    def leave(self) -> None:
        """Something else writes placements and twists: no state is the current one."""
        ...

    def past(self, q: Vec, v: Vec | None = None) -> State:
        """The state (q, v), for its numbers: the robot stays where it is."""
        ...

    def integrate(self, q: Vec, v: Vec, dt: float) -> Vec:
        """The configuration after moving with velocity v for dt [s], ``(nq,)``."""
        ...

    def inverse_dynamics(self, q: Vec, v: Vec, a: Vec) -> Vec:
        """Generalised forces A a + b + g ``(nv,)`` for an acceleration ``(nv,)`` [N m, N]; no state becomes stale."""
        ...

    def configuration(self, angles: Vec | str) -> Vec:
        """The configuration ``(nq,)`` whose ``state.angles`` are these ``(nv,)``, free bodies as at home; or of a name.

        A name is one of ``configurations``, the keyframes of an MJCF or the states of an SRDF.
        """
        ...

    @property
    def spherical(self) -> Mapping[str, tuple[int, float]]:
        """Ball joints: first tangent coordinate, and the largest turn from the zero [rad], inf if unlimited."""
        ...

    def difference(self, q0: Vec, q1: Vec) -> Vec:
        """The tangent vector from q0 to q1, ``(nv,)``."""
        ...

    def copy(self) -> Robot:
        """Return a copy of the robot with its own data."""
        ...


class State(Protocol):
    """One (q, v) of a robot; quantities are computed once, on first access."""

    @property
    def robot(self) -> Robot: ...
    @property
    def q(self) -> Vec: ...
    @property
    def v(self) -> Vec: ...

    @property
    def commanded(self) -> Vec | None:
        """Velocity ``(nv,)`` that a session at velocity level sent last; None before the first, and at other levels."""
        ...

    @commanded.setter
    def commanded(self, x: Vec | None) -> None: ...

    loads: tuple[Load, ...]
    """Loads that the robot carries besides its model, from a torque controller: ``com`` and momenta see it."""

    out: frozenset[str]
    """Names of the elements that are out of the tick of this state, see ``Element.off``."""

    @property
    def time(self) -> float | None:
        """When it was measured [s], on the clock of the session; None if unknown."""
        ...

    @property
    def finite(self) -> bool:
        """True if q and v are finite."""
        ...

    @property
    def valid(self) -> bool:
        """True if q and v are finite and every quaternion has length one within 1e-3."""
        ...

    @property
    def fault(self) -> str:
        """Why the state is not valid, naming the joint or the base; "" where it is."""
        ...

    @property
    def square(self) -> float:
        """q'q + v'v: a bound on the magnitude of every number in it."""
        ...

    @property
    def angles(self) -> Vec:
        """Joint positions by tangent coordinate ``(nv,)`` [rad or m], zero for free bodies."""
        ...

    def difference(self, q: Vec) -> Vec:
        """Tangent vector from q to this state's configuration, ``(nv,)``."""
        ...

    def kinematics(self) -> None:
        """Make placements and joint_twists those of this state; raises StaleState if the robot moved on."""
        ...

    def is_placed(self) -> None:
        """Placements of bodies and joint_twists are those of this state: something else has written them."""
        ...

    def position(self, frame: str) -> Vec:
        """Origin of a frame in the world, ``(3,)`` [m]."""
        ...

    def rotation(self, frame: str) -> Mat:
        """Rotation of a frame in the world, ``(3, 3)``."""
        ...

    def pose(self, frame: str) -> Mat:
        """Homogeneous matrix ``(4, 4)`` of a frame in the world, origin in [m]."""
        ...

    def jacobian(self, frame: str) -> Mat:
        """Geometric Jacobian ``(6, nv)`` of a frame, linear first, world axes."""
        ...

    def velocity(self, frame: str) -> Vec:
        """Velocity ``(6,)`` of a frame's origin [m/s] and its rotation [rad/s], world axes."""
        ...

    def drift(self, frame: str) -> Vec:
        """dJ/dt v of a frame's geometric Jacobian, ``(6,)``."""
        ...

    def com(self, subtree: int = 0) -> Vec:
        """Centre of mass of the robot or a subtree, ``(3,)`` [m]."""
        ...

    def com_jacobian(self, subtree: int = 0) -> Mat:
        """Jacobian of the centre of mass, ``(3, nv)``: a live view where subtree is 0."""
        ...

    def com_velocity(self, subtree: int = 0) -> Vec:
        """Velocity of the centre of mass, ``(3,)`` [m/s]."""
        ...

    def com_drift(self, subtree: int = 0) -> Vec:
        """dJ/dt v of the centre of mass, ``(3,)``."""
        ...

    def dynamics(self) -> None:
        """Make kinematics, ``inertia`` and ``bias_force`` those of this state; raises StaleState."""
        ...

    def inertia(self) -> Mat:
        """Upper triangle of A, ``(nv, nv)``; entries below the diagonal are undefined."""
        ...

    def mass_matrix(self) -> Mat:
        """Joint-space inertia A, ``(nv, nv)``, symmetric."""
        ...

    def bias_force(self) -> Vec:
        """b + g: Coriolis, centrifugal and gravity forces, ``(nv,)``."""
        ...

    def gravity_force(self) -> Vec:
        """g: gravity forces, ``(nv,)``."""
        ...

    def inertia_rate(self) -> Mat:
        """dA/dt ``(nv, nv)``."""
        ...

    def momentum_map(self) -> tuple[Mat, Vec]:
        """Centroidal momentum matrix ``(6, nv)``, linear first, and its dJ/dt v ``(6,)``; world axes."""
        ...
