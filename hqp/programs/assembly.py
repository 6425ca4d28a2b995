"""The rows of all motion elements of a stack in one block, refilled in place each tick."""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence, Set
from dataclasses import dataclass, field
from typing import TYPE_CHECKING, Any, Protocol

import numpy as np

from hqp.arrays import Index, Mat, Signs, Vec
from hqp.declare import plans
from hqp.declare.element import Element, has, plan_of, selection_of
from hqp.declare.law import DCM, PD, Gain, Law, P, pace
from hqp.declare.plans import Constant, Plan
from hqp.declare.readable import Readable, Views, ground_of
from hqp.declare.reference import Reference
from hqp.declare.robot import Robot, State
from hqp.errors import DeclarationError, StaleState

if TYPE_CHECKING:
    from hqp._assembly import Assembly as NativeAssembly
    from hqp._assembly import Kinematics

try:
    from hqp import _assembly as native
except ImportError:  # built without a compiler: the readable functions suffice
    native = None  # type: ignore[assignment]

LARGEST = 1e10
"""Largest number in rows and demands; larger ones are a fault of their element."""

OWN = "hqp.tasks"
"""Module prefix of elements that are not the user's: only a faulty model makes their rows faulty."""

PLAIN: dict[type, int] = {plans.Point: 1, plans.Com: 1, plans.Joints: 1, plans.Rotation: 2, plans.Pose: 3}
"""Plans whose targets are used unchanged, and the check of these: numbers, a rotation, a homogeneous matrix."""

EQUALITY, LIMITED, BOUNDED = 0, 1, 2
"""Ways from rows to bounds on J x: a law on the error, a law on the way left to a bound, bounds as they stand."""


class Constrained(Protocol):
    """Constraints J ``(m, nv)`` whose forces are eliminated; ``out``: names of the inactive ones."""

    m: int
    out: Signs

    @property
    def J(self) -> Mat: ...
    @property
    def Jbar_constr(self) -> Mat: ...
    @property
    def reactions(self) -> object: ...


@dataclass(eq=False)
class Member:
    """An element and its rows: ``part`` of the vectors, and of J unless its rows are a selection.

    write: its readable functions, None if a native operation replaces them.  target, normal: buffers of the
    reference for a native operation.  plain: check of a target that is used unchanged, see ``_assembly.Assembly.slot``.
    operation: number of the native one.  laws: numbers of its laws, one of which is active.
    """

    element: Element
    part: slice
    views: Views
    law: Law | None
    write: Callable[[State, Reference], None] | None = None
    target: Mat | None = None
    normal: Vec | None = None
    plain: int = 0
    operation: int | None = None
    laws: dict[Law, int] = field(default_factory=dict)

    def __post_init__(self) -> None:
        self.declared = self.law
        """Law at compile time; ``law`` is the one of the next fill, or the goal of a change of law."""


class Assembly:
    """J, lower and upper of a sequence of motion elements, after their laws.

    order 1: J x = rate - gain e.  order 2: J x = feedforward - kp e - kd (J v - rate) - dJ/dt v.  J ``(m, nv)`` holds
    the rows of ``dense`` elements; rows of ``selections`` follow in the vectors only, because each picks one
    coordinate.  Weights multiply rows and bounds.
    """

    def __init__(
        self, dense: Sequence[Element], selections: Sequence[Element], robot: Robot, dt: float, laws: Mapping[str, Law]
    ) -> None:
        self.order = next(iter(laws.values())).order if laws else 1
        self._dt = dt
        counts = [e.rows(robot) for e in (*dense, *selections)]
        starts = np.concatenate(([0], np.cumsum(counts))).astype(int).tolist()
        m, total = starts[len(dense)], starts[-1]
        self.J: Mat = np.zeros((m, robot.nv))
        self._flat = self.J.reshape(-1)
        self.error, self.rate, self.feedforward, self.drift = (np.zeros(total) for _ in range(4))
        self.bounds: Mat = np.empty((2, total))
        self.bounds[0], self.bounds[1] = -np.inf, np.inf
        self.lower, self.upper = self.bounds
        self.weight, self._demand = np.ones(total), np.zeros(total)
        self._kp, self._kd = np.zeros(total), np.zeros(total)
        self._kind: Signs = np.zeros(total, dtype=np.int8)
        self._out: Set[str] = frozenset()
        self._pick: Index = np.zeros(total - m, dtype=np.intp)
        self.native_rows: NativeAssembly | None = None
        self.moving: Kinematics | None = None
        """Native kinematics before the rows, None if the rows use the state's."""
        if native is not None:
            self.native_rows = native.Assembly(robot.joint_twists, robot.bodies, robot.nq, dt, self.order, Reference)
        self.members: dict[str, Member] = {}
        self.errors: dict[str, Exception] = {}
        self.parts: dict[str, Any] = {"dt": dt, "order": self.order, "nv": robot.nv, "operations": []}
        """Data of the native rows, also for a file (docs/plan_file.md)."""
        for i, element in enumerate((*dense, *selections)):
            part = slice(starts[i], starts[i + 1])
            J = self.J[part] if i < len(dense) else None
            views = Views(J, self.error[part], self.drift[part], self.lower[part], self.upper[part])
            member = Member(element, part, views, laws.get(element.name))
            if member.law is not None:
                member.law.fit(element.name, counts[i])
            self.members[element.name] = member
            self.weight[part], self._kind[part] = element.weight, _kind(element)
            self._bind(member, robot, dt)
        members = self.members.values()
        self.written = [m for m in members if m.write is not None]
        self._around = [m for m in self.written if has(m.element, "bounds_around")]
        checked = [m for m in members if m.write is not None or m.element.steered]  # a reference may be NaN
        self._own_bounds = [m.views for m in checked if not m.element.equality]
        self._targets = [(m.element.name, m.target, m) for m in members if m.target is not None and m.target.shape]
        if self.native_rows is not None:
            self._hand_over_laws(self.native_rows)
            self.native_rows.written(
                [(m.part.start, m.part.stop) for m in self.written if m.views.J is not None],
                [(m.part.start, m.part.stop) for m in self.written if not m.element.equality],
            )
            self.parts["slots"] = [self._slot(member) for member in members]
            for slot in self.parts["slots"]:
                self.native_rows.slot(slot)

    def _slot(self, member: Member) -> dict[str, Any]:
        """Buffer of an element's reference."""
        return {
            "name": member.element.name,
            "target": None if member.target is None else member.target.reshape(-1),
            "shape": () if member.target is None else member.target.shape,
            "normal": member.normal,
            "rate": self.rate[member.part],
            "feedforward": self.feedforward[member.part],
            "plain": member.plain,
            "operation": None if member.element.declares_hold else member.operation,
        }

    def move(self, robot: Robot) -> None:
        """Begin every fill with native kinematics if the rows need no others: frames are known by now."""
        if self.native_rows is None or (self.written and self.order == 2):
            return  # a drift in Python takes Pinocchio's kinematics anyway
        self.moving = kinematics(robot)
        if self.moving is not None:
            self.native_rows.move(self.moving)

    def _bind(self, member: Member, robot: Robot, dt: float) -> None:
        """Bind a native operation if there is one, else the readable functions."""
        element, views = member.element, member.views
        if element.grounded or element.on_ground:
            member.normal = ground_of(element)
        if views.J is None:
            index = selection_of(element, robot)
            assert index is not None  # only elements that select come here
            m = self.J.shape[0]
            self._pick[member.part.start - m : member.part.stop - m] = index
        plan = plan_of(element, robot)
        if self.native_rows is None or plan is None or isinstance(plan, Constant):
            member.write = Readable(element, views, self.order, dt)
            return
        self._hand_over(member, plan, self.native_rows)

    def _hand_over(self, member: Member, plan: Plan, assembly: NativeAssembly) -> None:
        views = member.views
        member.target = np.zeros(plan.shape)
        taken = getattr(type(member.element), "at", None)
        if taken is not None and taken.__module__.startswith(OWN):  # a user's element may transform its target
            member.plain = PLAIN.get(type(plan), 0)
        operation: dict[str, Any] = {
            "plan": plan,
            "J": views.J,
            "error": views.error,
            "drift": views.drift if self.order == 2 else None,
            "lower": views.lower,
            "upper": views.upper,
            "reference": member.target.reshape(-1),
            "normal": member.normal,
            "weight": float(member.element.weight),
            "rate": self.rate[member.part],
            "feedforward": self.feedforward[member.part],
        }
        assembly.add(operation)
        member.operation = len(self.parts["operations"])
        self.parts["operations"].append(operation)

    def _hand_over_laws(self, assembly: NativeAssembly) -> None:
        saturations = []
        for member in self.members.values():
            if member.law is not None and _kind(member.element) != BOUNDED:
                self._kp[member.part], self._kd[member.part] = gains(member.law)
            if member.law is not None and min(member.law.max_velocity, member.law.max_acceleration) < np.inf:
                saturations.append((member.part.start, member.part.stop, *holds(member.law)))
        laws: dict[str, Any] = {
            "J": self.J,
            "error": self.error,
            "rate": self.rate,
            "feedforward": self.feedforward,
            "drift": self.drift,
            "kp": self._kp,
            "kd": self._kd,
            "weight": self.weight,
            "pick": self._pick,
            "kind": self._kind,
            "demand": self._demand,
            "lower": self.lower,
            "upper": self.upper,
            "saturations": saturations,
        }
        assembly.laws(laws)
        self.parts["laws"] = laws

    def take_law(self, name: str, law: Law, *, at_once: bool) -> None:
        """Set an element's law, at once or gradually by ``go_on``; ``require_law`` checks it."""
        member = self.members[name]
        assert self.native_rows is not None
        assert member.declared is not None
        start, stop = member.part.start, member.part.stop
        for each in (member.declared, law):
            if each not in member.laws:
                member.laws[each] = self.native_rows.law(start, stop, rows_law(each, stop - start))
        member.law = law
        self.native_rows.aim(start, stop, member.laws[law], at_once)

    def go_on(self) -> None:
        """Advance changes of laws by one period."""
        if self.native_rows is not None:
            self.native_rows.go_on()

    def require_law(self, name: str, law: Law) -> None:
        """Raise DeclarationError for an element without a law, or with one that cannot become this one."""
        member = self.members.get(name)
        own = None if member is None or _kind(member.element) == BOUNDED else member.declared
        if member is None or own is None:
            raise DeclarationError(
                name, "has no law: its rows are bounds or act on forces", value=law, allowed="a task"
            )
        if not isinstance(own, (P, PD)):
            what = f"its {type(own).__name__} is part of its rows and cannot be replaced"
            raise DeclarationError(
                name, what, value=law, allowed="the same element under two names with different when"
            )
        if type(law) is not type(own):
            raise DeclarationError(name, f"needs a {type(own).__name__} here", value=law, allowed=repr(own))
        law.fit(name, member.part.stop - member.part.start)

    def go_without(self, out: Set[str]) -> None:
        """Free the rows of these elements from the next fill on, and restore those of all others."""
        self._out = out
        if self.native_rows is not None:
            for name, member in self.members.items():
                self.native_rows.out(name, member.part.start, member.part.stop, name in out)

    def fill(
        self,
        state: State,
        references: Mapping[str, Reference],
        given: Sequence[Reference],
        left_out: Sequence[str] = (),
    ) -> None:
        """Refill J, lower and upper; ``references`` has one for every element, ``given`` those with feedforward.

        left_out: elements whose rows are free in this tick.  An exception of a readable function is kept in ``errors``,
        and its element is ``unusable``.  Raises StaleState if the robot has moved on.
        """
        state.kinematics()
        self._copy_feedforward(given)
        if self.native_rows is not None:
            self._copy_targets(references)
            self.native_rows.run(state.q, state.v if state.commanded is None else state.commanded, state.v)
        self.write(state, references)
        if self.native_rows is not None:
            self.native_rows.demand(state.v)
        else:
            for member in self.written:
                self._apply_law(member, state.v)
        for name in left_out:
            self._leave_out(name)

    def limit(self, state: State, dynamics: Constrained) -> None:
        """Move bounds around a speed to the speed that constraints, the first rows, allow; see ``JointLimits``."""
        if self.native_rows is not None:
            self.native_rows.limit(state.v, dynamics.reactions)
        for member in self._around:
            element: Any = member.element
            m, k = dynamics.m, element.approach or np.inf
            off = dynamics.J @ state.v - self.weight[:m] * self.rate[:m]
            taken = np.where(dynamics.out, 0.0, np.minimum(1.0, self._kd[:m] / k) * off)
            if element.name not in self._out and np.isfinite(taken).all() and taken.any():
                left, braking = state.v - dynamics.Jbar_constr @ taken, dynamics.Jbar_constr @ (self._kd[:m] * taken)
                bounds, along = np.array(element.bounds_around(state, left, self._dt, 2)), self._along(member, braking)
                self.bounds[:, member.part] = element.weight * (bounds - along)

    def write(self, state: State, references: Mapping[str, Reference], names: Sequence[str] | None = None) -> None:
        """Write the rows of elements without a native operation, of all or of those by name."""
        if self.errors:
            self.errors.clear()
        for member in self.written:
            element, J = member.element, member.views.J
            if element.name in self._out or (names is not None and element.name not in names):
                continue
            try:
                member.write(state, references[element.name])  # type: ignore[misc]
            except StaleState:
                raise
            except (
                Exception
            ) as error:  # a user's element: a status reports it, and the tick continues without the element
                self.errors[element.name] = error
                continue
            if J is not None and element.weight != 1.0:
                np.multiply(J, element.weight, out=J)

    def _copy_feedforward(self, given: Sequence[Reference]) -> None:
        self.rate[:] = 0.0
        self.feedforward[:] = 0.0
        for reference in given:
            member = self.members[reference.name]
            if reference.velocity is not None:
                self.rate[member.part] = _fitting(member, "velocity", reference.velocity)
            if reference.acceleration is not None:
                self.feedforward[member.part] = _fitting(member, "acceleration", reference.acceleration)

    def _copy_targets(self, references: Mapping[str, Reference]) -> None:
        """Copy the targets into the buffers of native operations."""
        for name, target, member in self._targets:
            value, normal = references[name].value, references[name].normal
            if value is None or value.shape != target.shape:
                given = None if value is None else value.shape
                raise DeclarationError(name, f"value has shape {given}", allowed=f"shape {target.shape}")
            target[:] = value
            if member.normal is not None:
                member.normal[:] = ground_of(member.element) if normal is None else normal

    def _apply_law(self, member: Member, v: Vec) -> None:
        """Compute bounds of J x from errors or ways left, as the native ``demand`` does for all rows at once."""
        part, law, views, weight = member.part, member.law, member.views, member.element.weight
        kind = _kind(member.element)
        if member.element.name in self._out:
            self._demand[part], views.lower[:], views.upper[:] = 0.0, -np.inf, np.inf
            return
        if kind != BOUNDED and law is not None:
            around = self.rate[part], self.feedforward[part], self._along(member, v), self.drift[part]
            if kind == EQUALITY:
                self._demand[part] = law.demand(self.error[part], *around)
                views.lower[:] = views.upper[:] = self._demand[part]
            else:
                views.lower[:] = law.demand(-views.lower, *around, each=True)
                views.upper[:] = law.demand(-views.upper, *around, each=True)
        views.lower *= weight
        views.upper *= weight

    def _along(self, member: Member, v: Vec) -> Vec:
        """A motion ``(nv,)`` along the rows of an element, ``(m,)``."""
        J = member.views.J
        return v[self.picks(member.part)] if J is None else J @ v / member.element.weight

    def unusable(self) -> tuple[str, ...]:
        """Names of elements whose rows are not finite, too large or crossed."""
        demand, J = self._demand, self._flat
        with np.errstate(over="ignore", invalid="ignore"):
            fine = float(demand.dot(demand)) + float(J.dot(J)) < LARGEST**2
            for views in self._own_bounds:
                way = views.upper - views.lower  # NaN where both are +inf or both -inf
                fine &= bool(np.minimum.reduce(way, initial=0.0) >= 0.0)
        return () if fine and not self.errors else tuple(name for name in self.members if self.reason(name))

    def reason(self, name: str) -> str:
        """Reason that an element's rows are not usable, "" if they are."""
        if name in self.errors:
            error = self.errors[name]
            return f"it raised {type(error).__name__}: {error}"
        member = self.members.get(name)
        if member is None:
            return ""
        part, lower, upper = member.part, member.views.lower, member.views.upper
        for what, numbers in (("Jacobian", self.J[part]), ("demand", self._demand[part])):
            if not np.isfinite(numbers).all():
                return f"its {what} is not finite"
            if numbers.size and float(np.abs(numbers).max()) > LARGEST:
                return f"its {what} is too large ({float(np.abs(numbers).max()):.1e}, allowed {LARGEST:.0e})"
        fine = (lower <= upper) & (lower < np.inf) & (upper > -np.inf)
        if not fine.all():
            i = int(np.argmin(fine))
            return f"its bounds are NaN or lower > upper in row {i} ({lower[i]:g}, {upper[i]:g})"
        return ""

    def sound(self, name: str) -> bool:
        """Return true if an element's rows before their law are finite, without crossed bounds."""
        views = self.members[name].views
        with np.errstate(invalid="ignore"):
            numbers = [views.error, views.drift, np.zeros(0) if views.J is None else views.J.ravel()]
            return all(np.isfinite(part).all() for part in numbers) and bool((views.upper >= views.lower).all())

    def picks(self, part: slice) -> Index:
        """The coordinates that selection rows pick, ``(m,)``."""
        m = self.J.shape[0]
        return self._pick[part.start - m : part.stop - m]

    def _leave_out(self, name: str) -> None:
        """Free the rows of one element for this tick: (-inf, +inf), and finite numbers in J."""
        self.errors.pop(name, None)
        part = self.members[name].part
        J = self.J[part]
        with np.errstate(invalid="ignore"):
            J[~(np.abs(J) <= LARGEST)] = 0.0
        self._demand[part] = 0.0
        self.lower[part] = -np.inf
        self.upper[part] = np.inf


def kinematics(robot: Robot) -> Kinematics | None:
    """Native forward kinematics of the rows' frames; None for a joint type that it lacks."""
    joints = robot.tree_joints
    if native is None or joints is None:
        return None
    return native.Kinematics(robot.joint_twists, joints, robot.placed_frames)


def gains(law: Law) -> tuple[Gain, Gain]:
    """kp and kd, of each row or of all."""
    if isinstance(law, P):
        return law.gain, 0.0
    if isinstance(law, PD):
        return law.kp, law.kd
    return float(isinstance(law, DCM)), 0.0


def holds(law: Law) -> tuple[float, float, float]:
    """Bounds and largest kd."""
    return law.max_velocity, law.max_acceleration, float(np.max(law.kd)) if isinstance(law, PD) else 1.0


def rows_law(law: Law, rows: int) -> dict[str, Any]:
    """A P or a PD of ``rows`` rows, for native code and for files."""
    kp, kd = gains(law)
    by_row = {"kp": kp, "kd": kd, "pace": pace(law)}
    return {"held": holds(law), **{name: np.broadcast_to(x, rows).tolist() for name, x in by_row.items()}}


def _kind(element: Element) -> int:
    if has(element, "step_bounds"):
        return BOUNDED
    return EQUALITY if element.equality else LIMITED


def _fitting(member: Member, what: str, values: Vec) -> Vec:
    """The values, if as many as the member's rows; raises DeclarationError (a single one would be spread over all)."""
    m = member.part.stop - member.part.start
    if values.shape != (m,):
        raise DeclarationError(member.element.name, f"{what} has shape {values.shape}", allowed=f"shape ({m},)")
    return values
