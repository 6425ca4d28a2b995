"""Torque control: x = tau, with the constraint forces eliminated exactly (Sentis, Petersen, Philippsen 2012)."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field
from typing import Any, ClassVar

import numpy as np

from hqp.arrays import Index, Mat, Vec
from hqp.declare.element import Element, selection_of
from hqp.declare.law import PD, Law
from hqp.declare.plans import NominalTorque
from hqp.declare.price import LevelPrices, Price, is_exact, level_prices
from hqp.declare.reference import Reference
from hqp.declare.robot import Robot, State
from hqp.declare.stack import Stack
from hqp.errors import DeclarationError, DynamicsFailed, StaleState
from hqp.numbers import set_numbers
from hqp.problem import Hierarchy, Motion, Rows, Shape, Stacked
from hqp.programs.assembly import Assembly
from hqp.programs.formulation import Formulation, Place, Program
from hqp.programs.layout import Group, lay_out
from hqp.programs.loads import Loads, loads_of
from hqp.programs.rest import Holding
from hqp.torque.dynamics import ConstrainedDynamics, coordinate_parents
from hqp.torque.forces import Efforts, Forces
from hqp.torque.gravity import Gravity, holding_torque
from hqp.torque.holding import within_holding
from hqp.torque.motors import within_motors
from hqp.torque.reactions import Supports, reactions, require_actuation
from hqp.torque.rest import Held
from hqp.torque.rows import TorqueRows
from hqp.torque.self_motion import SelfMotions
from hqp.torque.shared import GroundAxes, blocks
from hqp.torque.soles import with_soles
from hqp.torque.terms import Terms


@dataclass(frozen=True, kw_only=True)
class Torque(Formulation):
    """x is the torque of the actuated joints ``(n_actuated,)`` [N m]; rows J X tau = a - dJ/dt v - J c, metric phi*.

    Contacts and couplings in ``subject_to`` have reaction forces: J_constr qdd + dJ/dt qd = 0 holds exactly and is no
    row (eqs. 4, 21), qdd = X tau + c.  In a level they are motion tasks.  Torque limits are bounds on x, contact force
    limits rows on lambda(tau) (eq. 3).  With levels of equalities the answer is the prioritised law of eqs. (48) to
    (53) with every coupling compensated; Gauss' principle, min tau^T phi* tau, and then least tau resolve the remaining
    freedom.

    law: for elements without one.  contact_law: feedback in J qdd = -dJ/dt v - kp e - kd J v of contacts; none by
    default, for ground does not move on request.  loop_law: feedback of constraints between joints or frames of the
    robot (``JointCoupling``, ``Weld``), whose error its own joints correct.  gravity_compensation: min |tau - tau_g|
    in phi* resolves the remaining freedom instead (eq. 27), tau_g the torque that holds the robot: it floats rather
    than falls; wheels then hold a robot on a slope whose goals all move with it.  effort_limits: a stack that bounds
    no torque in ``subject_to`` gets ``TorqueLimits(scale=3)`` before all else, unless it is exact (price=0) or its
    solver takes no inequalities: a default bound, because a leg near its straight pose would else need 1e7 N m and
    more. Motors for which that could not hold the robot at home are left out.  holding: share of the torque limits
    in ``subject_to`` that it may come to take to hold a joint against gravity, ``Within(HoldingTorque(...))``, for
    joints that no contact helps to hold: with all of its torque used up for that, a robot can but fall. None for no
    such bound; none for exact stacks and solvers without inequalities.
    """

    order: ClassVar[int] = 2
    quantities: ClassVar[frozenset[str]] = frozenset({"motion", "force", "effort", "load"})
    law: Law = field(default=PD(100.0, 20.0))
    contact_law: Law = field(default=PD(0.0, 0.0))
    loop_law: Law = field(default=PD(400.0, 40.0))
    gravity_compensation: bool = False
    effort_limits: bool = True
    holding: float | None = 0.8

    def __post_init__(self) -> None:
        if self.holding is not None:
            set_numbers(self, "Torque", ("holding",), 0.0, strict=True, most=1.0)

    def completed(self, stack: Stack) -> Stack:
        """The stack whose friction cones know their soles."""
        return with_soles(stack)

    def bounded(self, stack: Stack, robot: Robot) -> tuple[Stack, str]:
        """The stack within a few times the limits of the robot's motors, where it bounds no torque itself.

        One that does so is kept where its motors can hold the robot.
        """
        note = weak = ""
        if self.effort_limits:
            stack, note = within_motors(stack, robot)
        if self.holding is not None:
            stack, weak = within_holding(stack, robot, self.holding)
        return stack, "; ".join(filter(None, (note, weak)))

    def laws(self, stack: Stack) -> dict[str, Law]:
        """The law of each element; reaction constraints take contact_law or loop_law, contacts in a level take law."""
        held = {
            e.name: self.contact_law if e.is_contact and getattr(e, "relative_to", None) is None else self.loop_law
            for e in reactions(stack)
        }
        given = {e.name: e.law or held.get(e.name, self.law) for e in stack}
        for name, law in given.items():
            if law.order != self.order:
                raise DeclarationError(
                    name, "Torque needs laws of order 2", value=law, allowed="PD(kp [1/s^2], kd [1/s])"
                )
        return given

    def compile(self, stack: Stack, robot: Robot, dt: float, price: Price | None = None) -> Program:
        """Resolve names, allocate, bind.

        Raises DeclarationError or ModelError for a misfit, and DeclarationError if the constraints leave rank
        [J_constr; U] short, so that the actuators do not determine the motion (after eq. 12).
        """
        return TorqueProgram(self, stack, robot, dt, price)


class TorqueProgram(Program):
    """A stack whose x is the torque; ``dynamics`` and ``assembly`` are those of the latest fill."""

    kind = "torque"

    def __init__(self, formulation: Torque, stack: Stack, robot: Robot, dt: float, price: Price | None = None) -> None:
        formulation.check(stack)
        laws = formulation.laws(stack)
        held = reactions(stack)
        self.dt, self._laws = dt, laws
        loads = loads_of(stack)
        self.actuation = require_actuation(held, robot, dt, laws, any(getattr(load, "base", False) for load in loads))
        exact = is_exact(price)
        groups = lay_out(stack, robot, held=(*held, *loads), torque=True, contacts_first=not exact)
        motion = [e for group in groups for e in group.elements if e.quantity == "motion"]
        picked = [e for e in motion if selection_of(e, robot) is not None]
        dense = [*held, *(e for e in motion if selection_of(e, robot) is None)]
        self.assembly = Assembly(dense, picked, robot, dt, laws)
        self.loads = Loads(loads, robot, self.assembly.native_rows)
        self._terms = Terms(robot, self.assembly.native_rows, self.loads)
        self.held = held
        self.assembly.move(robot)
        self._supports = Supports(held, robot, dt, laws)
        self._m = sum(self.assembly.members[e.name].part.stop - self.assembly.members[e.name].part.start for e in held)
        terms = self._terms.A, self._terms.bias, self.assembly.J[: self._m], self.assembly.lower[: self._m]
        self.dynamics = ConstrainedDynamics(robot.nv, self._m, robot.actuation, coordinate_parents(robot), terms)
        self._efforts = Efforts([e for e in stack if e.quantity == "effort"], robot)
        self._forces = Forces([e for e in stack if e.quantity == "force"], held, self.assembly, robot)
        self._ground = {
            c.name: self._forces.ground.get(c.name) or GroundAxes.of(c, self.assembly, robot)
            for c in held
            if blocks(c, c.rows(robot))
        }
        self._rows = TorqueRows(self.dynamics.map)
        self._compensated = formulation.gravity_compensation
        nominal = self._nominal(loads, robot, exact)
        self._origin = np.zeros(robot.actuated.size) if self._compensated else nominal
        self._lay_out(groups, robot, level_prices(groups, robot, laws, formulation.order, dt, price))
        self.dynamics.follow(self._rows.parts, self._forces.parts)
        self._self_motions = SelfMotions(stack, groups, held, robot, dt, laws, self.assembly)
        self._gravity = Gravity(held, robot, dt, self.dynamics)
        self._state: State | None = None
        self._robot = robot
        self._held_names = frozenset(e.name for e in held)
        self.efforts_changed = False
        """True if the latest ``go_without`` changed the elements on torques that are out."""
        self._unusable: tuple[str, ...] = ()
        self._targets = [
            (name, self.problem.levels[place.level].lower[place.part])
            for name, place in self.places.items()
            if place.element.quantity != "motion" and place.element.equality
        ]

    def _nominal(self, loads: Sequence[Element], robot: Robot, exact: bool) -> Vec | None:
        """The live torque to which free directions are nearest; raises DeclarationError where none can be."""
        found = [e for e in loads if isinstance(e.plan(robot), NominalTorque)]
        if not found:
            return None
        if self._compensated or not exact or len(found) > 1:
            given = "gravity_compensation" if self._compensated else "a price" if not exact else [e.name for e in found]
            allowed = "one NominalTorque, without gravity_compensation, in a controller with price=0"
            raise DeclarationError(found[0].name, "nominal torque beside", value=given, allowed=allowed)
        return self.loads.live[found[0].name]

    def _lay_out(self, groups: Sequence[Group], robot: Robot, paid: LevelPrices | None) -> None:
        """Assign the rows of every element: levels that only bound tau are selections, the others slices of one
        block."""
        n, members = robot.actuated.size, self.assembly.members
        sizes = [sum(self._size(e) for e in group.elements) for group in groups]
        total = sum(size for size, group in zip(sizes, groups, strict=True) if not group.selection)
        self.A: Mat = np.zeros((total, n))
        self.bounds: Mat = np.empty((2, total))
        self.bounds[0], self.bounds[1] = -np.inf, np.inf
        self.lower, self.upper = self.bounds
        self.places: dict[str, Place] = {}
        runs: list[list[int]] = []
        levels: list[Rows] = []
        slices: list[slice | None] = []
        at = 0
        for k, (group, size) in enumerate(zip(groups, sizes, strict=True)):
            start = 0
            for element in group.elements:
                count = self._size(element)
                self.places[element.name] = Place(element, k, slice(start, start + count), group.name)
                if not group.selection:
                    here = slice(at + start, at + start + count)
                    if element.quantity == "motion":
                        self._place(members[element.name].part, here, runs)
                    else:
                        owner = self._efforts if element.quantity == "effort" else self._forces
                        owner.place(element.name, here, self.A, self.bounds)
                start += count
            if group.selection:
                levels.append(self._efforts.bounds([e.name for e in group.elements]))
                slices.append(None)
            else:
                part = slice(at, at + size)
                levels.append(Rows(self.A[part], self.lower[part], self.upper[part]))
                slices.append(part)
                at += size
        J, demand = self.assembly.J, self.assembly.bounds
        for i, j, k, m in runs:
            self._rows.product(J[i:j], self.A[k:m], demand[:, i:j], self.bounds[:, k:m])
        stacked = Stacked(self.A, self.lower, self.upper, tuple(slices)) if total else None
        motion = None
        if paid is not None:
            motion = Motion(np.zeros((robot.nv, n)), np.zeros(robot.nv))
            self._rows.motion(paid.scale, paid.rest, motion)
        self.problem = Hierarchy(
            tuple(levels),
            constraints=sum(group.constraint for group in groups),
            metric=self.dynamics.phi,
            origin=self._origin,
            n=n,
            stacked=stacked,
            prices=None if paid is None else paid.values,
            motion=motion,
            turning=None if paid is None else paid.turning,
        )
        inequalities = any(not e.equality for group in groups for e in group.elements)
        selections = tuple(group.selection for group in groups)
        self.shape = Shape(
            n, tuple(sizes), selections, inequalities, True, self._origin is not None, self.problem.priced
        )

    @property
    def copies(self) -> list[tuple[Mat, Mat, Index, Vec]]:
        """Rows that pick coordinates of qdd, the motion and the metric: multiples of rows of X."""
        if (columns := self.dynamics.columns) is None:
            return self._rows.copies
        return [*self._rows.copies, (self.dynamics.phi, self.dynamics.map, columns, np.ones(columns.size))]

    @property
    def symmetric(self) -> list[tuple[Mat, Index]]:
        """The map, whose rows of actuated coordinates begin with a symmetric block, without tendons."""
        return [] if (columns := self.dynamics.columns) is None else [(self.dynamics.map, columns)]

    def _size(self, element: Element) -> int:
        if element.quantity == "motion":
            part = self.assembly.members[element.name].part
            return int(part.stop - part.start)
        owner = self._efforts if element.quantity == "effort" else self._forces
        return owner.rows(element.name)

    def _place(self, part: slice, here: slice, runs: list[list[int]]) -> None:
        """Plan for one motion element: a product with J, merged with the one before, or rows of X."""
        rows = self.assembly
        if part.start >= rows.J.shape[0]:
            demand, bounds = rows.bounds[:, part], self.bounds[:, here]
            self._rows.pick(rows.picks(part), rows.weight[part], self.A[here], demand, bounds)
            return
        last = runs[-1] if runs else None
        if last and last[1] == part.start and last[3] == here.start:
            last[1], last[3] = part.stop, here.stop
        else:
            runs.append([part.start, part.stop, here.start, here.stop])

    def go_without(self, out: frozenset[str]) -> None:
        """The rows of these elements are free from the next fill on; contacts among them have no force."""
        self.efforts_changed = not self._efforts.names.isdisjoint(self.out ^ out)
        super().go_without(out)
        for element in self.held:
            self.dynamics.out[self.assembly.members[element.name].part] = element.name in out
        self._forces.go_without(out)
        self._self_motions.go_without(out)
        self._efforts.out = out

    def refuses(self, out: frozenset[str]) -> str:
        """Why these elements may not be out together: the remaining constraints do not determine the motion."""
        if out.isdisjoint(self._held_names):
            return ""
        gone = [e.name for e in self.held if e.name in out]
        left = [e for e in self.held if e.name not in out]
        if not gone or self._supports.determined(frozenset(gone)):
            return ""
        names = ", ".join(e.name for e in left) or "no contact or coupling"
        return (
            f"without {', '.join(gone)} constraints and actuators do not determine the motion of {self._robot.name}: "
            f"{names} {'are' if len(left) > 1 else 'is'} left"
        )

    def prepare(self, state: State) -> None:
        """Compute the quantities of the state for the rows and the equation of motion."""
        state.out = self.out
        self._terms.prepare(state)
        self._begin(state)
        if self.loads.elements:
            self.loads.begin(state)

    def _begin(self, state: State) -> None:
        self._state = state
        self.dynamics.forget()

    def fill(
        self,
        state: State,
        references: Mapping[str, Reference],
        given: Sequence[Reference],
        left_out: Sequence[str] = (),
    ) -> None:
        """Refill the hierarchy for a state and one reference an element; ``given`` may hold feedforward.

        Raises DynamicsFailed where the inertia is not positive definite or the elimination is not finite.
        """
        rows, dynamics = self.assembly, self.dynamics
        lost = self.loads.take(state, references)
        mine = [r for r in given if r.name in rows.members] if given else given
        rows.fill(state, references, mine, [name for name in left_out if name in rows.members])
        for name in left_out:
            self._rest_in_place(name)
        self._unusable = rows.unusable() + lost
        if self._unusable:
            return  # no elimination with constraints that are no numbers
        if self._self_motions:
            self._self_motions.add(state, references)
        self._terms.take(state)
        dynamics.refresh()
        c = dynamics.c
        if not float(c.dot(c)) < np.inf:
            raise DynamicsFailed("the constrained dynamics are not finite")
        rows.limit(state, dynamics)
        shift = elsewhere = None
        other_normals = bool(given) and self._gravity.takes_normals(given)
        if other_normals or self._compensated:
            weight = self.loads.gravity(state)
            holding = self._gravity.torque(weight, dynamics.J)
            if other_normals:
                there = self._gravity.other(state, weight, references)
                shift, holding = there - holding, there
                elsewhere = c - dynamics.X @ shift  # the model of the rows meets tau - shift
            if self._compensated and self._origin is not None:
                np.copyto(self._origin, holding)
        dynamics.native.write(state.v, elsewhere)
        if self._efforts:
            self._efforts.fill(state, references)
        if self._forces:
            self._forces.target(references)
            dynamics.native.force(shift)
        for name in left_out:
            self._free(name)

    def unusable(self) -> tuple[str, ...]:
        """Names of elements whose rows of the latest fill are not usable."""
        targets = [(name, target) for name, target in self._targets if name not in self.out]
        lost = tuple(name for name, target in targets if not np.isfinite(target).all())
        return self._unusable + lost

    def reason(self, name: str) -> str:
        """Why an element's rows are not usable."""
        return self.assembly.reason(name) or "its target is not finite"

    @property
    def live_targets(self) -> dict[str, Mat]:
        """Buffers of targets that native code reads, by element name."""
        return {**super().live_targets, **self.loads.live}

    @property
    def targets_in_file(self) -> dict[str, Vec]:
        """Shares of loads: Python writes them in its sessions, native code in those of a file."""
        return self._forces.shares

    def took(self, state: State | None, references: Sequence[Reference]) -> None:
        """A native tick has filled the rows, for a state and with these references."""
        self._state = state
        self.dynamics.forget()
        if self.loads.elements:
            self.loads.took(state, references)

    def parts(self) -> dict[str, Any]:
        """Data of a tick before the solver, for a file (docs/plan_file.md)."""
        mine = {"dynamics": self._terms.parts, "loads": self.loads.parts, "torque": self.dynamics.parts}
        return {**super().parts(), **mine}

    def in_python(self) -> tuple[str, str] | None:
        """First element that needs Python, with the reason."""
        if self._self_motions:
            return "SelfMotion", "its demand is written in Python"
        if not self._efforts.fixed:
            return self._efforts.moving, "its bounds on torques change"
        if self.loads.readable:
            return self.loads.readable[0], "it has no native code"
        return super().in_python()

    def begin_direct(self, state: State, references: Mapping[str, Reference]) -> None:
        """Native ticks follow: the bounds that they leave as they are."""
        if self._efforts:
            self._efforts.fill(state, references)
        if self._forces:
            self._forces.target(references)

    @property
    def force_targets(self) -> dict[str, int]:
        """Sizes of the targets of forces and efforts, by name; ``aim_forces`` sets these targets."""
        return {**self._forces.sizes, **self._efforts.sizes}

    def aim_forces(self, references: Mapping[str, Reference]) -> None:
        """Targets of forces and of efforts for the next native tick, those of all."""
        if self._forces:
            self._forces.target(references)
        self._efforts.aim(references)

    def holding(self, robot: Robot) -> Holding:
        """The torques that hold the robot up, and its momentum."""
        return Held(self.held, robot, self.dt, self._laws, self.loads, self.dynamics.out)

    def remarks(self, state: State) -> tuple[str, ...]:
        """Motor torques that hold each load, in words."""
        if not self.loads:
            return ()
        J, U = self.dynamics.J, state.robot.actuation
        twin = state.robot.copy().state(state.q, state.v)  # the robot may have moved on
        found = []
        for name, change in self.loads.change(twin).items():
            tau = holding_torque(J, change, U)
            i = int(np.argmax(np.abs(tau)))
            joint = state.robot.joint_names[i]
            most = f", up to {tau[i]:.3g} N m of {joint}" if tau[i] else ""
            found.append(f"{name}: {self.loads.values[name].round(3).tolist()}{most}")
        return tuple(found)

    def _rest_in_place(self, name: str) -> None:
        """Keep the finite rows of a reaction constraint, with zero acceleration: J qdd = 0."""
        if name in self._held_names:
            part = self.assembly.members[name].part
            self.assembly.lower[part] = self.assembly.upper[part] = 0.0

    def _free(self, name: str) -> None:
        """Free the rows of one element for this tick."""
        place = self.places.get(name)
        if place is not None:
            rows = self.problem.levels[place.level]
            rows.lower[place.part] = -np.inf
            rows.upper[place.part] = np.inf

    def command(self, x: Vec) -> Vec:
        """The torques ``(n_actuated,)`` [N m]."""
        return x.copy()

    def acceleration(self, x: Vec) -> Vec:
        """qdd ``(nv,)`` that the torques cause at the latest state (eq. 4)."""
        return self.dynamics.acceleration(x)

    def contact_forces(self, x: Vec, world: bool = False) -> dict[str, Vec]:
        """Force of each reaction constraint on the robot at the latest state [N, N m], -lambda in the sign of eq. (2).

        A contact's force ``(3,)`` or wrench ``(6,)`` is in its axes on the ground, those of ``FrictionCone``: z along
        the normal, x that of the contact's frame projected on the ground; in the world's axes if world.  The two
        moments of an edge ``(5,)`` are in the axes of its rows.  The force of a constraint between two frames is in the
        axes of ``relative_to``.
        """
        force = -self.dynamics.forces(x) * self.assembly.weight[: self._m]
        for name, axes in ({} if world else self.contact_axes()).items():
            part = force[self.assembly.members[name].part]
            for block in range(0, part.size - 2, 3):  # two moments have axes of their own
                part[block : block + 3] = part[block : block + 3] @ axes
        return {e.name: force[self.assembly.members[e.name].part] for e in self.held}

    def contact_axes(self) -> dict[str, Mat]:
        """Axes of each contact on the ground at the latest state ``(3, 3)``: columns x, y, z in the world."""
        return {name: ground.now for name, ground in self._ground.items()}

    def advance(self, state: State, x: Vec) -> tuple[Vec, Vec]:
        """v+ = v + dt qdd(tau), q+ = q + dt v+; raises StaleState for another state than the latest."""
        if state is not self._state:
            raise StaleState("advance() uses the latest step, and only with a solution: call it before the next step")
        v = state.v + self.dt * self.dynamics.acceleration(x)
        return state.robot.integrate(state.q, v, self.dt), v
