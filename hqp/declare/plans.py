"""Arguments of native operations: one typed class an operation, read by name in cpp/rows.

An element's ``plan(robot)`` returns one of these, with names resolved and live arrays in place.  The operation writes
the rows that the element's readable functions give; tests compare the two.
"""

from __future__ import annotations

from dataclasses import dataclass, field, replace
from typing import ClassVar, TypeAlias

import numpy as np
from numpy.typing import NDArray

from hqp.arrays import Index, Mat, Vec
from hqp.declare.robot import Robot


class _Counted:
    """Its reference has a number for each of the ``counted``."""

    counted: ClassVar[str]

    @property
    def shape(self) -> tuple[int, ...]:
        """Shape of the reference's value."""
        return (len(getattr(self, self.counted)),)


@dataclass(frozen=True, eq=False)
class Frame:
    """A frame: live position ``(3,)`` and rotation ``(3, 3)``, its body and the coordinates that move it."""

    position: Vec
    rotation: Mat
    body: int
    columns: tuple[int, ...]


@dataclass(frozen=True, eq=False)
class RelativeFrame:
    """A frame whose axes and origin others are seen in; heading: only its yaw turns the axes.

    upright: least horizontal length of its x axis with which the rate of a heading is computed.
    """

    frame: Frame
    heading: bool
    upright: float


@dataclass(frozen=True, eq=False)
class Point(_Counted):
    """Position of the point ``offset`` of a frame along ``axes``; reference ``(k,)``."""

    counted = "axes"
    frame: Frame
    relative_to: RelativeFrame | None
    axes: tuple[int, ...]
    offset: tuple[float, float, float] = (0.0, 0.0, 0.0)


@dataclass(frozen=True, eq=False)
class Pose:
    """Position and rotation of a frame; reference ``(4, 4)``."""

    frame: Frame
    relative_to: RelativeFrame | None
    shape: tuple[int, ...] = field(default=(4, 4), init=False)


@dataclass(frozen=True, eq=False)
class Rotation:
    """Rotation of a frame; reference ``(3, 3)``."""

    frame: Frame
    relative_to: RelativeFrame | None
    shape: tuple[int, ...] = field(default=(3, 3), init=False)


@dataclass(frozen=True, eq=False)
class Angles(_Counted):
    """Some of roll, pitch, yaw (0, 1, 2) of a frame; gimbal: least |cos pitch| of their rates; reference ``(k,)``."""

    counted = "picked"
    frame: Frame
    relative_to: RelativeFrame | None
    picked: tuple[int, ...]
    gimbal: float


@dataclass(frozen=True, eq=False)
class Edge:
    """An edge along ``axis`` of a frame, ``first`` and ``other`` its orthonormal complement; reference ``(6,)``."""

    frame: Frame
    axis: tuple[float, float, float]
    first: tuple[float, float, float]
    other: tuple[float, float, float]
    shape: tuple[int, ...] = field(default=(6,), init=False)


@dataclass(frozen=True, eq=False)
class Hinge:
    """A frame's origin and an axis of ``relative_to``, with ``first`` and ``other`` across it; reference ``(6,)``."""

    frame: Frame
    relative_to: RelativeFrame | None
    axis: tuple[float, float, float]
    first: tuple[float, float, float]
    other: tuple[float, float, float]
    shape: tuple[int, ...] = field(default=(6,), init=False)


@dataclass(frozen=True, eq=False)
class Wheel:
    """Some of rolling, lateral, normal (0, 1, 2) of a wheel; aligned: sine below which its axle is along the normal.

    The reference is ``(3,)``, with the ground's normal.
    """

    frame: Frame
    radius: float
    axle: tuple[float, float, float]
    picked: tuple[int, ...]
    aligned: float
    shape: tuple[int, ...] = field(default=(3,), init=False)


@dataclass(frozen=True, eq=False)
class Com(_Counted):
    """Centre of mass of the subtree of body ``part`` along ``axes``; reference ``(k,)``."""

    counted = "axes"
    relative_to: RelativeFrame | None
    part: int
    axes: tuple[int, ...]


@dataclass(frozen=True, eq=False)
class Joints(_Counted):
    """Single-axis joints: tangent coordinates and places in q; ``continuous`` ones have cosine and sine there.

    Errors of continuous joints are wrapped.  Reference ``(k,)``.
    """

    counted = "columns"
    columns: tuple[int, ...]
    positions: tuple[int, ...]
    continuous: tuple[bool, ...]

    @classmethod
    def of(cls, robot: Robot, columns: Index, needed: NDArray[np.bool_] | None = None) -> Joints | None:
        """The joints of these tangent coordinates, None if one is of a joint of several axes.

        needed: coordinates whose place in q counts, all by default; the others have place 0.
        """
        needed = np.full(columns.size, True) if needed is None else needed
        found = robot.positions(columns[needed])
        if found is None:
            return None
        positions = np.zeros(columns.size, dtype=np.intp)
        positions[needed] = found
        continuous = np.isin(columns, robot.continuous) & needed
        return cls(tuple(columns.tolist()), tuple(positions.tolist()), tuple(continuous.tolist()))


@dataclass(frozen=True, eq=False)
class Coupling:
    """sum c_j q_j of joints; reference ``(1,)``."""

    joints: Joints
    coefficients: tuple[float, ...]
    shape: tuple[int, ...] = field(default=(1,), init=False)


@dataclass(frozen=True, eq=False)
class JointBox:
    """Bounds of joints for JointLimits, infinite if unlimited; no reference."""

    joints: Joints
    low: tuple[float, ...]
    high: tuple[float, ...]
    speed: tuple[float, ...]
    acceleration: tuple[float, ...]
    braking: tuple[float, ...]
    approach: float
    return_velocity: float
    noise: float = 0.0
    shape: tuple[int, ...] = field(default=(), init=False)


@dataclass(frozen=True, eq=False)
class Constant:
    """Bounds ``(m,)`` that never change; no reference."""

    lower: Vec
    upper: Vec
    shape: tuple[int, ...] = field(default=(), init=False)


@dataclass(frozen=True, eq=False)
class Collision:
    """Capsules of links (body, ends in its axes, radius), hulls of some of them (number, radius that rounds it, corners
    in the axes of its body, triangles), shapes of the world (kind 0 capsule, 1 box, 2 half-space, and size), their
    names, the columns that move each body, pairs of shapes with clearances, and live slots.  soft, curvature: see
    ``CollisionAvoidance.curve``.

    reference ``(n, 6, 4)``: a shape's pose ``(4, 4)``, velocity and angular velocity, three numbers and a zero each.
    """

    links: tuple[tuple[int, tuple[float, ...], float], ...]
    hulls: tuple[tuple[int, float, tuple[float, ...], tuple[int, ...]], ...]
    world: tuple[tuple[int, tuple[float, ...]], ...]
    names: tuple[str, ...]
    chains: tuple[tuple[int, ...], ...]
    pairs: tuple[tuple[int, int], ...]
    clearances: tuple[float, ...]
    slots: NDArray[np.int32]
    influence: float
    soft: float
    curvature: float
    rate: float
    braking: float
    recovery: float
    outset: float
    approach: float
    foresight: float
    step: float
    shape: tuple[int, ...]


@dataclass(frozen=True, eq=False)
class Still(_Counted):
    """Coordinates whose velocity is wanted for itself; the reference's value, zero, is not read."""

    counted = "columns"
    columns: tuple[int, ...]


@dataclass(frozen=True, eq=False)
class Steady:
    """Coordinates that go on with the velocity they had; no reference."""

    columns: tuple[int, ...]
    shape: tuple[int, ...] = field(default=(), init=False)


@dataclass(frozen=True, eq=False)
class Prescribed(_Counted):
    """Coordinates with the measured velocity and a reference acceleration; the reference's value, zero, is not read."""

    counted = "columns"
    columns: tuple[int, ...]


@dataclass(frozen=True, eq=False)
class Frozen:
    """Joints that stay at the reference ``(k,)``, or come to rest there."""

    joints: Joints
    rate: float
    acceleration: float

    @property
    def shape(self) -> tuple[int, ...]:
        """Shape of the reference's value."""
        return self.joints.shape


@dataclass(frozen=True, eq=False)
class Pointing:
    """An axis of a frame along a direction, or towards a point; first and other across it; reference ``(3,)``."""

    frame: Frame
    axis: tuple[float, ...]
    first: tuple[float, ...]
    other: tuple[float, ...]
    point: bool
    shape: tuple[int, ...] = field(default=(3,), init=False)


@dataclass(frozen=True, eq=False)
class Apart:
    """Distance of a frame from the origin of another; reference ``(1,)``."""

    frame: Frame
    relative_to: RelativeFrame | None
    shape: tuple[int, ...] = field(default=(1,), init=False)


@dataclass(frozen=True, eq=False)
class Manipulability:
    """Manipulability of the ``picked`` rows of a frame's Jacobian in the coordinates ``joints``; reference ``(1,)``."""

    frame: Frame
    picked: tuple[int, ...]
    joints: tuple[int, ...]
    shape: tuple[int, ...] = field(default=(1,), init=False)


@dataclass(frozen=True, eq=False)
class HoldingTorque(_Counted):
    """Holding torque of the joints ``columns``, over their limits; reference ``(k,)``.  gravity: ``(3,)`` [m/s^2]."""

    counted = "columns"
    columns: tuple[int, ...]
    limits: tuple[float, ...]
    gravity: tuple[float, ...]


@dataclass(frozen=True, eq=False)
class Cone:
    """Pointing with bounds on the angle; reference ``(3, 3)`` with its velocity and acceleration."""

    frame: Frame
    axis: tuple[float, ...]
    first: tuple[float, ...]
    other: tuple[float, ...]
    point: bool
    angle: float
    rate: float
    recovery: float
    outset: float
    shape: tuple[int, ...] = field(default=(3, 3), init=False)


@dataclass(frozen=True, eq=False)
class Within:
    """Bounds ``(m,)`` on the value of a task, on its rate where ``rates``; reference as of the task.

    turn: first of three rows that are a rotation vector, -1 without such rows.
    """

    task: Plan
    lower: tuple[float, ...]
    upper: tuple[float, ...]
    rate: float
    recovery: float
    outset: float
    rates: bool
    turn: int

    @property
    def shape(self) -> tuple[int, ...]:
        """Shape of the reference's value."""
        return self.task.shape if self.turn >= 0 else (len(self.lower),)


@dataclass(frozen=True, eq=False)
class SupportPolygon:
    """Points of frames, or corners ``(x, y)`` in the world, that the centre of mass stays between.

    The reference is ``(m, 2)``, other corners of the tick; none for points of frames.  of: the contact of each point,
    ``()`` for none.
    """

    points: tuple[tuple[Frame, tuple[float, ...]], ...]
    polygon: tuple[tuple[float, ...], ...]
    margin: float
    rate: float
    recovery: float
    outset: float
    of: tuple[str, ...]

    @property
    def shape(self) -> tuple[int, ...]:
        """Shape of the reference's value."""
        return (len(self.polygon), 2) if self.polygon else ()


@dataclass(frozen=True, eq=False)
class Balance:
    """Points of frames that the ZMP stays between, gain k, height of the pendulum (0: the height in the state).

    The reference is ZMP and DCM ``(4,)``.  of: see SupportPolygon.
    """

    points: tuple[tuple[Frame, tuple[float, ...]], ...]
    k: float
    height: float
    gravity: float
    of: tuple[str, ...]
    shape: tuple[int, ...] = field(default=(4,), init=False)


@dataclass(frozen=True, eq=False)
class Momentum(_Counted):
    """Some of linear x, y, z and angular x, y, z (0 to 5) of the centroidal momentum; the reference, zero, is not read.

    inertias: xx, yy, zz, xy, xz, yz of each body about its centre of mass, in its axes.
    """

    counted = "picked"
    picked: tuple[int, ...]
    inertias: tuple[tuple[float, ...], ...]


@dataclass(frozen=True, eq=False)
class FrameSpeed:
    """Bounds on a frame's velocity and angular velocity along unit vectors in its axes, infinite for none.

    rate: see FrameVelocityLimits.  No reference.
    """

    frame: Frame
    normals: tuple[tuple[float, ...], ...]
    linear: float
    angular: float
    rate: float
    shape: tuple[int, ...] = field(default=(), init=False)


@dataclass(frozen=True, eq=False)
class Payload:
    """A point mass on a frame; value: mass and where in the frame's axes ``(4,)``."""

    frame: Frame
    shape: tuple[int, ...] = field(default=(4,), init=False)


@dataclass(frozen=True, eq=False)
class ExternalWrench:
    """Force and moment on a frame ``(6,)``, in its axes with local; resisted: true if the robot compensates it."""

    frame: Frame
    local: bool
    resisted: bool
    shape: tuple[int, ...] = field(default=(6,), init=False)


@dataclass(frozen=True, eq=False)
class JointLoad(_Counted):
    """A torque ``(k,)``, the value, and an inertia for each of these coordinates."""

    counted = "columns"
    columns: tuple[int, ...]
    inertia: tuple[float, ...]


@dataclass(frozen=True, eq=False)
class NominalTorque:
    """A torque of each motor, the value."""

    shape: tuple[int, ...]


@dataclass(frozen=True, eq=False)
class KineticEnergy(_Counted):
    """L^T of the joint-space inertia L L^T ``(nv, nv)``; the reference, zero, is not read.

    inertias: see Momentum.  rotors: reflected rotor inertia of each tangent coordinate.
    """

    counted = "rotors"
    inertias: tuple[tuple[float, ...], ...]
    rotors: tuple[float, ...]


Plan: TypeAlias = (
    Point | Pose | Rotation | Angles | Edge | Hinge | Wheel | Com | Joints | Coupling | JointBox | Constant | Collision
    | Still | Steady | Prescribed | Frozen | Pointing | Apart | Manipulability | Cone | Within | SupportPolygon
    | Balance | HoldingTorque | Momentum | KineticEnergy | FrameSpeed | Payload | ExternalWrench | JointLoad
    | NominalTorque
)  # fmt: skip


def frame(robot: Robot, name: str) -> Frame:
    """The frame of that name; raises FrameNotFound."""
    index = robot.frame(name)
    columns = np.flatnonzero(robot.support(index)).tolist()
    return Frame(*robot.placement(index), robot.body(index), tuple(columns))


def relative_frame(robot: Robot, name: str | None, heading: bool, upright: float) -> RelativeFrame | None:
    """The relative frame of that name, None for the world; raises FrameNotFound."""
    return None if name is None else RelativeFrame(frame(robot, name), heading, upright)


def apart(own: Frame, other: RelativeFrame | None) -> tuple[Frame, RelativeFrame | None]:
    """Both frames without the coordinates that carry both: they move nothing relative, unless only a heading turns."""
    if other is None or other.heading:
        return own, other
    shared = {*own.columns} & {*other.frame.columns}
    first, second = (replace(f, columns=tuple(c for c in f.columns if c not in shared)) for f in (own, other.frame))
    return first, replace(other, frame=second)
