"""Robots on Pinocchio: the model, its names and limits, live views for the hot path."""

from __future__ import annotations

from collections.abc import Callable, Iterable, Iterator, Mapping, Sequence
from contextlib import contextmanager
from dataclasses import dataclass
from pathlib import Path
from typing import TYPE_CHECKING, Any, Literal

import numpy as np
import pinocchio as pin
from numpy.typing import ArrayLike

from hqp.arrays import Index, Mat, Vec
from hqp.errors import ConfigurationNotFound, DeclarationError, FrameNotFound, ModelError
from hqp.shapes import LinkCapsule

from . import coupled, expanded, frame_names, kinematic_tree
from .checks import losses, measure, unit_parts
from .joints import Joints, actuation, matrix
from .obstacles import Obstacles
from .placement import se3
from .state import State

if TYPE_CHECKING:
    from hqp.declare.robot import Placed, TreeJoint
    from hqp.tasks import Ball, JointCoupling, Weld

    from .contacts import Contacts
    from .description import Description


@dataclass(frozen=True)
class Wheel:
    """A wheel's radius [m] and its axle, a unit vector in the wheel's frame."""

    radius: float
    axle: tuple[float, float, float]


_DECIMALS = 1e-5
"""Configurations of files are rounded to five decimals [rad, m]."""

LIVE = ("_read", "data", "current", "_measure", "_views", "_bodies", "_tree")
"""Live parts of a robot: views into its data, made anew in a copy."""

_new = object.__new__


class Robot:
    """A Pinocchio model with one Data; see hqp.declare.robot.Robot for the properties.

    model: a pinocchio.Model, floating if its first joint is a free flyer; composite, Euler-angle and universal joints
    become chains NAME_0, NAME_1, ... and a group NAME, q and v stay as they were.  actuated: names of the actuated
    joints, all single-axis joints by default.  groups: joint groups by name.  home: ``(nq,)``, moved into the joint
    limits.  configurations: by name, the keyframes of an MJCF (``key_0``, ... without a name) or the states of an SRDF.
    wheels: by frame.  landmarks: frames by role, such as ``soles``, ``palms``, ``base``.  description: further data of
    the robot's file.  geometry, visual: pinocchio.GeometryModel of a model that comes from no file.  Raises ModelError
    where joints share a coordinate (mimic joints of Pinocchio), DeclarationError for home.
    """

    log3 = staticmethod(pin.log3)

    def __init__(
        self,
        model: Any,
        *,
        name: str | None = None,
        actuated: Sequence[str] | None = None,
        groups: Mapping[str, Sequence[str]] | None = None,
        home: Vec | None = None,
        wheels: Mapping[str, Wheel] | None = None,
        landmarks: Mapping[str, Sequence[str]] | None = None,
        description: Description | None = None,
        geometry: Any = None,
        visual: Any = None,
    ) -> None:
        model, places, chains = expanded.plain(model)
        self.model = model
        self._geometry, self._visual = (expanded.shapes(shapes, places) for shapes in (geometry, visual))
        self._capsules: list[tuple[LinkCapsule, ...]] = []  # at most one entry, shared with copies
        self.name: str = name or model.name
        self.nq, self.nv = int(model.nq), int(model.nv)
        self._joints = joints = Joints(model, self.name)
        self.floating, self.continuous = joints.floating, joints.continuous
        self.description = description
        self.source: Path | None = description.source if description else None
        self.groups = chains | {key: tuple(value) for key, value in (groups or {}).items()}
        self.wheels = dict(wheels or {})
        self.landmarks = {key: tuple(value) for key, value in (landmarks or {}).items()}
        if actuated is None and description is not None:
            actuated = description.actuated
        single = (n for n, (_, count) in joints.columns.items() if count == 1)
        self.joint_names: tuple[str, ...] = tuple(single if actuated is None else actuated)
        self.actuated: Index = np.array([self._column(n) for n in self.joint_names], dtype=np.intp)
        self.actuation: Mat = actuation(self.actuated, self.nv, self._tendons())
        self.lower, self.upper, self.velocity_limit, self.effort_limit = joints.limits(model)
        self.frame_names: tuple[str, ...] = tuple(f.name for f in model.frames)
        self._frames = frame_names.frames(model)
        self.notes: tuple[str, ...] = (*description.warnings, *description.notes) if description else ()
        if description is not None:
            self.notes += tuple(coupled.lost_ranges(description.couplings, joints, self.lower, self.upper))
        self.notes += losses(model)
        if shared := frame_names.clashes(model, self._frames):
            self.notes += (
                f"joints and links elsewhere with one name, which as a frame is the link: {', '.join(shared)}",
            )
        self.cones: dict[str, float] = dict(description.cones) if description else {}
        self.disabled_pairs = description.disabled_pairs if description else frozenset()
        self.configurations: dict[str, Vec] = dict(description.configurations) if description else {}
        if home is None:
            home = description.home if description and description.home is not None else pin.neutral(model)
        self.set_home(home)
        self.configurations = {key: self._coupled(q) for key, q in self.configurations.items()}
        outside = {key: self._inside(q, _DECIMALS)[1] for key, q in self.configurations.items()}
        if clashes := "; ".join(f"{key}: {', '.join(names)}" for key, names in outside.items() if names):
            self.notes += (f"configurations outside the limits of joints: {clashes}",)
        self._units = unit_parts(model)
        self._begin()

    def _begin(self) -> None:
        """Data of its own, with nothing read of it yet."""
        self.data: Any = pin.Data(self.model)
        self._spare: Any = None
        self._measure: Callable[[Vec, Vec], tuple[float, bool] | None] = measure(self._units, self.nq, self.nv)
        self._views: dict[int, tuple[Vec, Mat]] = {}
        self._bodies: tuple[Any, ...] = ()
        self._tree: Sequence[TreeJoint] | Literal[False] | None = False
        self.current: State | None = None
        self._read: dict[str, Any] | None = None

    def set_home(self, q: ArrayLike) -> None:
        """Make q ``(nq,)`` the standing configuration, its joints moved into their limits; raises DeclarationError."""
        try:
            q = np.array(q, dtype=np.float64)
        except (TypeError, ValueError):
            raise DeclarationError(self.name, "home", value=q, allowed=f"numbers ({self.nq},)") from None
        if q.shape != (self.nq,):
            hint = (
                "; robot.configuration(angles) makes a configuration from joint angles" if q.shape == (self.nv,) else ""
            )
            raise DeclarationError(self.name, f"home has shape {q.shape}", allowed=f"({self.nq},){hint}")
        if not np.isfinite(q).all():
            raise DeclarationError(self.name, "home", value=q, allowed="finite numbers")
        self.home, moved = self._inside(q)
        self.home = self._coupled(self.home)
        if moved:
            self.notes += (f"home was moved into the limits of {', '.join(moved)}",)

    def _inside(self, q: Vec, slack: float = 0.0) -> tuple[Vec, list[str]]:
        """q with its joints moved into their limits, and the names of those outside by more than a slack [rad, m]."""
        cones = {name: most + slack for name, most in self.cones.items()}
        return self._joints.inside(self.model, q, self.lower - slack, self.upper + slack, cones)

    def _coupled(self, q: Vec) -> Vec:
        """q with each follower of the file's couplings where its leaders put it; followers may lead others."""
        couplings = self.description.couplings if self.description else ()
        return coupled.followed(couplings, q, self._joints, lambda q: self._joints.angles(self.model, q))

    def _tendons(self) -> dict[int, dict[int, float]]:
        """Coefficients of the joints that a motor pulls, by coordinate."""
        tendons = self.description.tendons if self.description else {}
        return {self._column(motor): {self._column(j): c for j, c in row.items()} for motor, row in tendons.items()}

    def _column(self, joint: str) -> int:
        columns = self._joints.find(joint, self.groups)
        if len(columns) != 1:
            raise DeclarationError(self.name, f"joint {joint!r} has {len(columns)} axes", allowed="a joint of one axis")
        return columns[0]

    @property
    def mass(self) -> float:
        """Total mass [kg]."""
        return float(pin.computeTotalMass(self.model))

    @property
    def gravity(self) -> Vec:
        """Acceleration of free fall, world axes, ``(3,)`` [m/s^2]."""
        return np.array(self.model.gravity.linear)

    def frame(self, name: str) -> int:
        """Index of a frame; raises FrameNotFound with the closest names."""
        try:
            return self._frames[name]
        except (KeyError, TypeError):
            raise FrameNotFound(str(name), self.frame_names, self.name) from None

    def joints(self, names: str | Sequence[str] | None = None) -> Index:
        """Tangent coordinates of joints or groups, of all joints but free ones for None; raises JointNotFound."""
        if names is None:
            return np.array(self._joints.bodies_columns(), dtype=np.intp)
        found: list[int] = []
        for name in names if isinstance(names, Iterable) and not isinstance(names, str) else (names,):
            for member in self.groups.get(name, (name,)) if isinstance(name, str) else (name,):
                found += self._joints.find(member, self.groups)
        return np.array(found, dtype=np.intp)

    def joint_name(self, column: int) -> str:
        """Name of the joint of a tangent coordinate, 'base' for the free base."""
        return self._joints.name(column)

    def placement(self, frame: int) -> tuple[Vec, Mat]:
        """Live views of a frame's position and rotation in the world, as of the current state."""
        if frame not in self._views:
            placement = self.data.oMf[frame]
            self._views[frame] = (placement.translation, placement.rotation)
        return self._views[frame]

    @property
    def bodies(self) -> tuple[Any, ...]:
        """One for each of the model's joints; shapes fixed in the world do not count."""
        if not self._bodies:
            model, found = self.model, []
            for i, placement in enumerate(self.data.oMi):
                joint, inertia = model.joints[i], model.inertias[i]
                first, count, mass = (joint.idx_v, joint.nv, inertia.mass) if i else (0, 0, 0.0)
                views = placement.translation, placement.rotation
                centre = tuple(inertia.lever.tolist())
                found.append((int(model.parents[i]), int(first), int(count), float(mass), centre, views))
            self._bodies = tuple(found)
        return self._bodies

    @property
    def inertias(self) -> tuple[tuple[float, ...], ...]:
        """Inertia of each of ``bodies``: xx, yy, zz, xy, xz, yz about its centre of mass, in its axes; zero of the
        world."""
        every = [np.asarray(inertia.inertia) for inertia in self.model.inertias]
        places = (0, 0), (1, 1), (2, 2), (0, 1), (0, 2), (1, 2)
        return ((0.0,) * 6, *(tuple(float(own[at]) for at in places) for own in every[1:]))

    @property
    def rotors(self) -> Vec:
        """Reflected rotor inertia of each tangent coordinate ``(nv,)`` [kg m^2, kg], on the diagonal of A."""
        return np.array(self.model.armature)

    @property
    def tree_joints(self) -> Sequence[TreeJoint] | None:
        """The joints for native forward kinematics, None where one is a screw."""
        if self._tree is False:
            self._tree = kinematic_tree.joints(self.model, self.bodies)
        return self._tree

    @property
    def placed_frames(self) -> Sequence[Placed]:
        """Frames whose ``placement`` was used so far."""
        return kinematic_tree.frames(self.model, self._views)

    def body(self, frame: int) -> int:
        """Index of the body that a frame is fixed in."""
        return int(self.model.frames[frame].parentJoint)

    def positions(self, columns: Index) -> list[int] | None:
        """Places in q of single-axis joints, a continuous one's cosine; None if one is neither (balls)."""
        return self._joints.places(columns)

    @property
    def couplings(self) -> tuple[JointCoupling | Ball | Weld, ...]:
        """Couplings of joints and closures of loops of the file; a session adds those that its stack lacks."""
        from hqp.tasks import Ball, JointCoupling, Weld

        if self.description is None:
            return ()
        found: list[JointCoupling | Ball | Weld] = []
        for k, (terms, offset) in enumerate(self.description.couplings):
            again = sum(set(terms) == set(before) for before, _ in self.description.couplings[:k])
            name = f"{'_'.join(terms)}_{again + 1}" if again else ""
            found.append(JointCoupling(terms, offset=offset, name=name))
        for closure in self.description.closures:
            kind = Ball if closure.kind == "Ball" else Weld
            found.append(kind(frame=closure.frame, relative_to=closure.relative_to, closed=True, name=closure.name))
        return tuple(found)

    @property
    def spherical(self) -> dict[str, tuple[int, float]]:
        """Joints of three axes: first tangent coordinate, and the largest turn from the zero [rad], inf for none."""
        found = {n: v for n, (_, nq, v, nv) in self._joints.several.items() if (nq, nv) == (4, 3) and self._ball(n)}
        return {n: (v, self.cones.get(n, np.inf)) for n, v in found.items()}

    def _ball(self, name: str) -> bool:
        joint = self.model.joints[self.model.getJointId(name)]
        return bool(joint.shortname() == "JointModelSpherical")

    @property
    def geometry(self) -> Any:
        """Collision shapes, a pinocchio.GeometryModel, read on first use; raises ModelError without any."""
        if self._geometry is None:
            self._geometry = self.read_shapes("collision")
        return self._geometry

    @property
    def obstacles(self) -> Obstacles:
        """Bodies that the file moves and that are not the robot, as shapes for ``CollisionAvoidance(world=...)``."""
        return self.description.obstacles if self.description is not None else Obstacles()

    @property
    def visual(self) -> Any:
        """Shapes to be drawn, a pinocchio.GeometryModel; raises ModelError without any."""
        if self._visual is None:
            self._visual = self.read_shapes("visual")
        return self._visual

    @property
    def capsules(self) -> tuple[LinkCapsule, ...]:
        """Capsules around the links: from ``with_capsules``, or shipped or fitted ones around ``geometry``.

        Links with the surface of a shipped fit get its capsules, for any name of the file.  Fitting takes
        seconds, minutes for many meshes: it warns (ModelWarning), and the result is kept in the user's cache
        (docs/collision.md).  Raises ModelError without shapes.
        """
        if not self._capsules:
            from . import capsule_cache

            self._capsules.append(capsule_cache.around(self))
        return self._capsules[0]

    def with_capsules(self, capsules: str | Path | Sequence[LinkCapsule]) -> Robot:
        """Return a copy with capsules of a file of `hqp capsules`, or given ones; raises ModelError for a misfit."""
        clone = self.copy()
        if isinstance(capsules, (str, Path)):
            from . import capsule_files

            capsules = capsule_files.read(self.copy(), Path(capsules))
        given = tuple(capsules) if isinstance(capsules, Iterable) else (capsules,)
        if strangers := [one for one in given if not isinstance(one, LinkCapsule)]:
            raise DeclarationError(self.name, "capsules", value=strangers[0], allowed="a path, or LinkCapsule(...)")
        clone._capsules = [given]
        return clone

    def read_shapes(self, kind: Literal["collision", "visual"]) -> Any:
        """``geometry`` or ``visual``; shapes that are read for it are not kept, meshes are large."""
        from .geometry import read

        own = self._geometry if kind == "collision" else self._visual
        kept = self._read.get(kind) if own is None and self._read is not None else own
        if kept is not None:
            return kept
        if self.description is None:
            raise ModelError(f"{self.name} has no file and no {kind} shapes: pass Robot(..., geometry=...)")
        found = read(self.description, self.model, kind)
        if self._read is not None:
            self._read[kind] = found
        return found

    @contextmanager
    def keep_shapes(self) -> Iterator[None]:
        """Read the shapes of each kind at most once within this context, which may lie within another."""
        before = self._read
        self._read = {} if before is None else before
        try:
            yield
        finally:
            self._read = before

    def contacts(self) -> Contacts:
        """The collision shapes, read for ``touch`` of two bodies; raises ModelError without shapes."""
        from . import contacts

        kept = {} if self._read is None else self._read
        if "contacts" not in kept:
            kept["contacts"] = contacts.Contacts(self.read_shapes("collision"))
        found: Contacts = kept["contacts"]
        return found

    def with_frame(self, name: str, parent: str, placement: Any = None) -> Robot:
        """Return a copy with one more frame, fixed in that of ``parent``.

        placement: pose of the new frame in its parent, a pinocchio.SE3, a matrix ``(4, 4)`` or a position ``(3,)`` [m].
        Raises FrameNotFound for the parent, DeclarationError for a duplicate name or an invalid placement.
        """
        if name in self._frames:
            raise DeclarationError(self.name, "duplicate frame name", value=name, allowed="another name")
        host = self.model.frames[self.frame(parent)]
        model = self.model.copy()
        at = host.placement * se3(name, placement)
        model.addFrame(pin.Frame(name, host.parentJoint, self.frame(parent), at, pin.FrameType.OP_FRAME))
        clone = self.copy()
        clone.model, clone.data = model, pin.Data(model)
        clone.frame_names = (*self.frame_names, name)
        clone._frames = {**self._frames, name: len(self.frame_names)}
        return clone

    def support(self, frame: int) -> Vec:
        """1 for each tangent coordinate that moves the frame, 0 elsewhere, ``(nv,)``."""
        mask = np.zeros(self.nv)
        joint = self.model.frames[frame].parentJoint
        while joint > 0:
            model = self.model.joints[joint]
            mask[model.idx_v : model.idx_v + model.nv] = 1.0
            joint = self.model.parents[joint]
        return mask

    @property
    def joint_twists(self) -> Mat:
        """Live view ``(6, nv)``: world twist at the origin of each tangent coordinate, linear first."""
        return matrix(self.data.J)

    def subtree(self, joint: str) -> int:
        """Index of the body that a joint carries; raises JointNotFound."""
        self._joints.find(joint, self.groups)
        return int(self.model.getJointId(joint))

    def state(self, q: Vec | None = None, v: Vec | None = None, time: float | None = None) -> State:
        """Move the robot to (q, v), home at rest by default; earlier states become stale.

        time [s]: when it was measured, on the clock of the session (``Session(max_age=...)``).
        Raises ModelError for wrong shapes; NaN and quaternions that are not unit are taken and show as
        ``state.valid`` and ``state.fault``.
        """
        state = _new(State)
        state.__init__(self, self.home if q is None else q, v, time)  # type: ignore[misc]  # State() costs more
        self.current = state
        return state

    def leave(self) -> None:
        """Something else writes placements and twists: no state is the current one."""
        self.current = None

    def past(self, q: Vec, v: Vec | None = None) -> State:
        """The state (q, v), for its numbers: the robot stays where it is."""
        return State(self, q, v)

    @property
    def spare(self) -> Any:
        """Pinocchio's data for results that do not belong to the current state."""
        if self._spare is None:
            self._spare = pin.Data(self.model)
        return self._spare

    def integrate(self, q: Vec, v: Vec, dt: float) -> Vec:
        """The configuration after moving with velocity v for dt [s]."""
        return pin.integrate(self.model, q, v * dt)  # type: ignore[no-any-return]

    def inverse_dynamics(self, q: Vec, v: Vec, a: Vec) -> Vec:
        """Generalised forces A a + b + g ``(nv,)`` for an acceleration ``(nv,)`` [N m, N]; no state becomes stale."""
        return np.array(pin.rnea(self.model, self.spare, q, v, a), dtype=np.float64)

    def configuration(self, angles: ArrayLike | str) -> Vec:
        """The configuration ``(nq,)`` whose ``state.angles`` are these ``(nv,)``, free bodies as at home; or of a name.

        A name is one of ``configurations``.  Raises ConfigurationNotFound, with the closest names, or DeclarationError
        for angles of another shape.
        """
        if isinstance(angles, str):
            if angles not in self.configurations:
                raise ConfigurationNotFound(angles, self.configurations, self.name)
            return self.configurations[angles].copy()
        try:
            angles = np.array(angles, dtype=np.float64)
        except (TypeError, ValueError):
            raise DeclarationError(self.name, "no angles", value=angles, allowed="numbers (nv,), or a name") from None
        if angles.shape != (self.nv,):
            raise DeclarationError(self.name, f"angles have shape {angles.shape}", allowed=f"({self.nv},), or a name")
        return self._joints.placed(self.model, self.home, angles)

    def difference(self, q0: Vec, q1: Vec) -> Vec:
        """The tangent vector from q0 to q1."""
        return pin.difference(self.model, q0, q1)  # type: ignore[no-any-return]

    def random_configuration(self, rng: np.random.Generator, spread: float = 1.0) -> Vec:
        """Home plus a random tangent step: joints within limits, the base within ``spread`` [m, rad]."""
        step = rng.uniform(-spread, spread, self.nv)
        q = self.integrate(self.home, step, 1.0)
        for v, i in zip(self._joints.single_v, self._joints.single_q, strict=True):
            low, high = max(self.lower[v], -np.pi), min(self.upper[v], np.pi)
            middle, half = 0.5 * (low + high), 0.5 * (high - low)
            q[i] = middle + 0.95 * half * rng.uniform(-1.0, 1.0) * min(spread, 1.0)
        return q

    def copy(self) -> Robot:
        """Return a copy of the robot with its own data; the model is shared, shapes that a file has are read from it
        again."""
        clone = _new(type(self))
        clone.__dict__.update(self.__getstate__())
        clone._begin()
        clone.home = self.home.copy()
        return clone

    def __getstate__(self) -> dict[str, Any]:
        """All but live data; shapes that a file has are read from it again."""
        left = {*LIVE, *(("_geometry", "_visual") if self.description is not None else ())}
        return {name: None if name in left else value for name, value in self.__dict__.items()}

    def __setstate__(self, kept: dict[str, Any]) -> None:
        self.__dict__.update(kept)
        self._begin()

    def __repr__(self) -> str:
        base = "floating" if self.floating else "fixed"
        return f"<Robot {self.name}: {base} base, nv = {self.nv}, {len(self.joint_names)} actuated>"

    def __str__(self) -> str:
        lines = [repr(self)[1:-1]]
        if self.source is not None:
            lines.append(f"from {self.source}")
        lines += [f"coupled by the file: {c.name}" for c in self.couplings]
        lines += [f"configurations: {', '.join(self.configurations)}"] if self.configurations else []
        return "\n  ".join([*lines, *self.notes])
