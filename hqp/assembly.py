"""The rows of all motion elements of a stack in one block, refilled in place each tick."""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np

from hqp.arrays import Index, Mat, Vec
from hqp.demands import Demands, Saturation
from hqp.element import Block, Element, Plan, Writer
from hqp.errors import DeclarationError
from hqp.law import PD, Law, P
from hqp.reference import Reference
from hqp.robot import Robot, State

try:
    from hqp import _assembly as native
except ImportError:  # no compiler was there: the writers do it all
    native = None  # type: ignore[assignment]


_UP: Vec = np.array((0.0, 0.0, 1.0))


@dataclass(eq=False)
class Member:
    """An element bound to its rows: ``part`` of the vectors, and of J unless its rows are a selection.

    target, normal: buffers of the reference's where a native operation stands in for the writer; seen: whose they are.
    """

    element: Element
    part: slice
    block: Block
    write: Writer
    scaled: Mat | None = None
    target: Mat | None = None
    normal: Vec | None = None
    seen: Reference | None = None


class Assembly:
    """J, lower and upper of a sequence of motion elements, after their laws.

    order 1: J x = rate - gain e.  order 2: J x = feedforward - kp e - kd (J v - rate) - dJ/dt v.
    J ``(m, nv)`` holds the rows of ``dense`` elements; those of ``selections`` follow in the vectors only, for
    each picks one coordinate.  Weights multiply rows and bounds.
    """

    def __init__(
        self, dense: Sequence[Element], selections: Sequence[Element], robot: Robot, dt: float, laws: Mapping[str, Law]
    ) -> None:
        self._native = None if native is None else native.Assembly(robot.joint_twists, robot.bodies)
        order = next(iter(laws.values())).order if laws else 1
        counts = [e.rows(robot) for e in (*dense, *selections)]
        starts = np.concatenate(([0], np.cumsum(counts))).astype(int).tolist()
        m, total = starts[len(dense)], starts[-1]
        self.order = order
        self.J: Mat = np.zeros((m, robot.nv))
        self._flat = self.J.reshape(-1)
        self.error, self.rate, self.feedforward, self.drift = (np.zeros(total) for _ in range(4))
        self.bounds: Mat = np.empty((2, total))
        self.bounds[0], self.bounds[1] = -np.inf, np.inf
        self.lower, self.upper = self.bounds
        self.weight, self._kp, self._kd = np.ones(total), np.zeros(total), np.zeros(total)
        self._equality = np.ones(total, dtype=bool)
        self._pool, self._used = np.zeros((m, 6)), 0
        self._twists: Mat = robot.joint_twists
        self._pick = np.zeros(total - m, dtype=np.intp)
        self._demand = np.zeros(total)
        self._saturations: list[Saturation] = []
        self._fed = False
        self.members: dict[str, Member] = {}
        for i, element in enumerate((*dense, *selections)):
            part = slice(starts[i], starts[i + 1])
            self._bind(element, part, robot, dt, laws.get(element.name), i < len(dense))
        self._finish()

    def _bind(self, element: Element, part: slice, robot: Robot, dt: float, law: Law | None, dense: bool) -> None:
        weighted = element.weight != 1.0
        own = weighted or not dense
        used = self._used
        block = Block(
            J=np.zeros((part.stop - part.start, robot.nv)) if own else self.J[part],
            error=self.error[part],
            rate=self.rate[part],
            feedforward=self.feedforward[part],
            drift=self.drift[part],
            lower=self.lower[part],
            upper=self.upper[part],
            order=self.order,
            dt=dt,
            pool=self._take if dense else None,
        )
        member = Member(element, part, block, element.bind(robot, block))
        if self._native is not None and block.plan is not None:
            self._hand_over(member, block.plan, self.J[part] if dense else block.J)
            self._used, block.twist, block.support = used, None, None
        self.members[element.name] = member
        self.weight[part] = element.weight
        self._equality[part] = element.equality
        if isinstance(law, P):
            self._kp[part] = law.gain
        elif isinstance(law, PD):
            self._kp[part], self._kd[part] = law.kp, law.kd
        if law is not None and min(law.max_velocity, law.max_acceleration) < np.inf:
            kd = float(np.max(law.kd)) if isinstance(law, PD) else 1.0
            self._saturations.append((part.start, part.stop, law.max_velocity, law.max_acceleration, kd))
        if not dense:
            index = element.selection(robot)
            assert index is not None  # only elements that select come here
            m = self.J.shape[0]
            self._pick[part.start - m : part.stop - m] = index
        elif weighted and block.twist is None:
            member.scaled = self.J[part]
            if member.target is not None:  # constant rows are written once, by binding
                np.multiply(block.J, element.weight, out=member.scaled)

    def _hand_over(self, member: Member, plan: Plan, J: Mat) -> None:
        """Let a native operation do what the writer would."""
        operation = getattr(self._native, plan.kind)
        member.target = np.zeros(plan.shape)
        block = member.block
        if not member.element.equality:
            operation(lower=block.lower, upper=block.upper, **plan.data)
            return
        drift = block.drift if self.order == 2 else None
        rows = J, block.error, drift, member.target.reshape(-1), float(member.element.weight)
        if plan.ground:
            member.normal = _UP.copy()
            operation(rows=rows, normal=member.normal, **plan.data)
        else:
            operation(rows=rows, **plan.data)

    def _take(self, m: int) -> Mat:
        start, self._used = self._used, self._used + m
        return self._pool[start : self._used]

    def _finish(self) -> None:
        """Merge neighbouring twist rows into runs, so that few products fill them all."""
        self._pool = self._pool[: self._used]
        self._product = np.zeros((self._used, self.J.shape[1]))
        self._support = np.zeros_like(self._product)
        runs: list[tuple[int, int, int]] = []
        at = 0
        for member in self.members.values():
            if member.block.support is None or member.part.start >= self.J.shape[0]:
                continue
            m = member.part.stop - member.part.start
            self._support[at : at + m] = member.block.support * member.element.weight
            if runs and runs[-1][1] + runs[-1][2] == member.part.start:
                runs[-1] = (runs[-1][0], runs[-1][1], runs[-1][2] + m)
            else:
                runs.append((at, member.part.start, m))
            at += m
        self._runs = [
            (self._product[a : a + m], self._support[a : a + m], self.J[start : start + m]) for a, start, m in runs
        ]
        members = self.members.values()
        self._writers = [(m.write, m.element.name) for m in members if m.target is None]
        self._targets = [(m.element.name, m.target, m) for m in members if m.target is not None and m.target.shape]
        self._scaled = [m for m in members if m.scaled is not None and m.target is None]
        self._finish_laws()

    def _finish_laws(self) -> None:
        laws: dict[str, Any] = {
            "order": self.order,
            "J": self.J,
            "error": self.error,
            "rate": self.rate,
            "feedforward": self.feedforward,
            "drift": self.drift,
            "kp": self._kp,
            "kd": self._kd,
            "weight": self.weight,
            "pick": self._pick,
            "equality": self._equality,
            "demand": self._demand,
            "lower": self.lower,
            "upper": self.upper,
            "saturations": self._saturations,
        }
        self._apply_laws: Callable[[Vec], None]
        if self._native is None:
            self._apply_laws = Demands(**laws).run
        else:
            self._native.laws(**laws)
            self._apply_laws = self._native.demand

    def fill(self, state: State, references: Mapping[str, Reference], given: Sequence[Reference]) -> None:
        """Refill J, lower and upper; ``references`` has one for every element, ``given`` those with feedforward.

        Raises StaleState if the robot has moved on.
        """
        state.kinematics()
        if self._fed:
            self.rate[:] = 0.0
            self.feedforward[:] = 0.0
            self._fed = False
        for reference in given:
            member = self.members[reference.name]
            if reference.velocity is not None:
                self.rate[member.part] = _fitting(member, "velocity", reference.velocity)
                self._fed = True
            if reference.acceleration is not None:
                self.feedforward[member.part] = _fitting(member, "acceleration", reference.acceleration)
                self._fed = True
        if self._native is not None:
            self._feed(references)
            self._native.run(state.q, state.v)
        for write, name in self._writers:
            write(state, references[name])
        if self._runs:
            np.matmul(self._pool, self._twists, out=self._product)
            for product, support, J in self._runs:
                np.multiply(product, support, out=J)
        for member in self._scaled:
            np.multiply(member.block.J, member.element.weight, out=member.scaled)
        self._apply_laws(state.v)

    def _feed(self, references: Mapping[str, Reference]) -> None:
        """Put what native operations read where they read it."""
        for name, target, member in self._targets:
            reference = references[name]
            if reference is member.seen:
                continue
            value = reference.value
            if value is None or value.shape != target.shape:
                given = None if value is None else value.shape
                raise DeclarationError(name, f"value has shape {given}", allowed=f"shape {target.shape}")
            target[:] = value
            if member.normal is not None:
                member.normal[:] = _UP if reference.normal is None else reference.normal
            member.seen = reference

    def unfit(self) -> tuple[str, ...]:
        """Names of elements whose demand or rows are not finite; () nearly always, told by two products."""
        demand, J = self._demand, self._flat
        if float(demand @ demand) + float(J @ J) < np.inf:
            return ()
        return tuple(
            name
            for name, m in self.members.items()
            if not (np.isfinite(demand[m.part]).all() and np.isfinite(self.J[m.part]).all())
        )

    def picks(self, part: slice) -> Index:
        """The coordinates that selection rows pick, ``(m,)``."""
        m = self.J.shape[0]
        return self._pick[part.start - m : part.stop - m]

    def leave_out(self, name: str) -> None:
        """Free the rows of one element for this tick: (-inf, +inf), and no NaN in J."""
        part = self.members[name].part
        self.J[part][~np.isfinite(self.J[part])] = 0.0
        self.lower[part] = -np.inf
        self.upper[part] = np.inf


def _fitting(member: Member, what: str, values: Vec) -> Vec:
    """The values, if as many as the member's rows; raises DeclarationError (a single one would be spread over all)."""
    m = member.part.stop - member.part.start
    if values.shape != (m,):
        raise DeclarationError(member.element.name, f"{what} has shape {values.shape}", allowed=f"shape ({m},)")
    return values
