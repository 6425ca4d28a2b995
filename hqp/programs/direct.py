"""Ordinary ticks in one native call: references in, rows, laws and solver, a record out."""

from __future__ import annotations

from collections.abc import Callable, Iterable, Mapping, Sequence
from functools import partial
from itertools import pairwise
from math import inf
from typing import TYPE_CHECKING, Protocol, TypeAlias

import numpy as np

from hqp.arrays import FLOAT, Index, Mat, Signs, Vec
from hqp.declare.reference import Reference
from hqp.declare.robot import State
from hqp.problem import Hierarchy, Solution, Stats, Status
from hqp.programs.assembly import LARGEST, Assembly

if TYPE_CHECKING:
    from hqp._assembly import Assembly as NativeAssembly
    from hqp._assembly import Kinematics

Counts: TypeAlias = tuple[int, int, int, bool]
"""Outcome (0: an optimum), iterations, factorisations of a kernel's solve, and whether its answer was judged."""

Kernel: TypeAlias = tuple[Callable[[], Counts], Vec, Signs, object]
"""A bound kernel: its solve, live views of (x, slack) and of the marks, and the solve as native modules call it."""


ROUNDING = 1e-12
"""A quaternion whose squared length is this near to one is taken as it is."""


class Rewriting(Protocol):
    """Interface of native code that rewrites rows before a solve, if ``before`` returns a capsule."""

    def before(self, solve: object) -> object | None: ...
    def __call__(self) -> None: ...


class Begun(Protocol):
    """Inputs of a program beside the native loop: the first tick, and targets of forces."""

    def begin_direct(self, state: State, holds: Mapping[str, Reference], /) -> None: ...

    efforts_changed: bool

    @property
    def force_targets(self) -> dict[str, int]: ...
    def aim_forces(self, references: Mapping[str, Reference], /) -> None: ...


class Direct:
    """The native loop of a session whose rows go straight to a kernel.

    It handles ordinary ticks and returns None for others, which take the general path of a session: a reference that is
    not finite or does not fit, rows that are too large.  A record holds the results of a tick; see ``solution``.
    """

    def __init__(
        self,
        assembly: Assembly,
        native: NativeAssembly,
        workspace: object,
        kernel: Kernel,
        problem: Hierarchy,
        command: Index,
        program: Begun | None,
        chain: Callable[[object], object] | None,
        prepare: Callable[[State], None] | None,
        moving: Kinematics | None,
    ) -> None:
        self.prepare = prepare
        """Computations on the state before the native call, None for nothing."""
        self.after_writing: Callable[[], None] | None = None
        """Step between rows that are written in Python and the solver."""
        self._assembly, self._native, self.workspace = assembly, native, workspace
        self._written, self._places = bool(assembly.written), moving is not None
        self._nq, self._nv = 0 if moving is None else moving.size, assembly.J.shape[1]
        self._names = frozenset(member.element.name for member in assembly.written)
        self._holds: Mapping[str, Reference] = {}
        self._unmeasured: dict[tuple[str, ...], tuple[str, ...]] = {}
        self._renewed: set[str] = set()
        self._begins = False
        self.fresh = True
        self._program, self._chain = program, chain
        self._forces = {} if program is None else program.force_targets
        self._aims = False
        self.takes_arrays = moving is not None and not assembly.written and prepare is None and program is None
        """True if ``tick`` is available."""
        self._kernel, self._picks = kernel, command.tolist()
        self._velocity = assembly.order == 1
        self.before_solving(None)
        n, rows = problem.n, [level.m for level in problem.levels]
        self._x = slice(command.size, command.size + n)
        ends = np.concatenate(([0], np.cumsum(rows))).astype(int).tolist()
        self._rows = [slice(a, b) for a, b in pairwise(ends)]
        self._slack = slice(self._x.stop, self._x.stop + ends[-1])
        self._count = self._slack.stop + 5
        self.width = int(command.size)
        """Numbers of the command, the first of a record."""
        self.marks = 8 * self._count
        """Offset of the marks of all rows in a record, whose last byte is odd if they changed."""

    def hold(self, holds: Mapping[str, Reference]) -> None:
        """Take the hold values of all elements, live; the next tick takes references as the first does."""
        self.fresh = True
        for name in self._assembly.members:
            self._take(name, holds[name])
        self._holds = holds

    def _take(self, name: str, held: Reference) -> None:
        value = held.value
        self._native.hold(name, None if value is None else np.array(value, dtype=np.float64).reshape(-1))

    def others(self, back: tuple[str, ...]) -> tuple[str, ...]:
        """Names of returning elements whose hold values native code does not take."""
        if back not in self._unmeasured:
            native = self._assembly.members.keys() - self._names
            self._unmeasured[back] = tuple(name for name in back if name not in native)
        return self._unmeasured[back]

    def renew(self, back: tuple[str, ...], others: tuple[str, ...]) -> None:
        """Elements come back with the next tick, which is native: it takes their hold values, but not of ``others``."""
        if self._program is not None:
            self._aims, self._begins = bool(self._forces), self._program.efforts_changed
        for name in others:
            if name in self._assembly.members:
                self._take(name, self._holds[name])
        self._renewed.update(back)
        self._native.renew(back)

    def renewed(self) -> list[Reference]:
        """Hold values that native ticks took since the last call."""
        found = []
        for name in self._renewed:
            member = self._assembly.members.get(name)
            target = None if member is None else member.target
            if target is not None and target.shape:
                value = np.empty(target.shape)
                self._native.held(name, value.reshape(-1))
                found.append(Reference(name, value))
        self._renewed.clear()
        return found

    def before_solving(self, ease: Rewriting | None) -> None:
        """Ease rows ahead of every solve from now on, None for no more."""
        solve, values, marks, call = self._kernel
        self._ease, asked = ease, solve  # kept alive: the capsule runs it
        if ease is not None and (eased := ease.before(call)) is not None:
            call = eased
        elif ease is not None:

            def asked() -> Counts:
                ease()
                return solve()

            call = None
        if self._chain is not None:
            call = self._chain(call)
        self._native.answers(asked, call, values, marks, self._picks, LARGEST)

    def leave(self) -> None:
        """The general path takes over: nothing of the last ordinary tick must stay."""
        self.fresh = True

    @property
    def writes(self) -> bool:
        """True if some rows are written in Python."""
        return self._written

    def step(
        self, state: State, references: tuple[Reference, ...], before: bytearray | Vec
    ) -> bytearray | Counts | None:
        """Return a record of an optimum, the counts of another outcome, None for an extraordinary tick.

        before: the latest record, or the x to start from.
        """
        fresh = self.fresh
        if (fresh or self._begins) and self._program is not None:
            self._program.begin_direct(state, self._holds)
        self.fresh = self._begins = False
        if self._forces:
            rest = self._aim(references)
            if rest is None:
                self._native.look(state.q, state.v)
                return None
            references = rest
        v: Vec | None = state.v
        if self._velocity:
            v = None
            if isinstance(before, np.ndarray):
                v = state.commanded = before
            elif self._written:
                state.command_later(partial(self.x, before))
        if not self._written:
            return self._native.step(state.q, v, references, fresh, None)
        self._now = state, references
        return self._native.step(state.q, v, references, fresh, self._write)

    def _aim(self, references: tuple[Reference, ...]) -> tuple[Reference, ...] | None:
        """Take the targets of forces; the other references, None where one does not fit."""
        mine = {name: r for r in references if (name := getattr(r, "name", None)) in self._forces}
        if not mine and not self._aims:
            return references
        for name, reference in mine.items():
            value = reference.value
            if value is not None and (np.shape(value) != (self._forces[name],) or not float(value @ value) < inf):
                return None
        assert self._program is not None
        self._aims = bool(mine)
        self._program.aim_forces({**self._holds, **mine})
        return tuple([r for r in references if getattr(r, "name", None) not in mine])

    def tick(
        self, q: Vec, v: Vec | None, targets: dict[str, Vec | Mat], before: bytearray | Vec, largest: float
    ) -> bytearray | Counts | None:
        """``step`` for arrays alone, if nothing is left to Python; ``None`` for an extraordinary tick.

        largest: the squares of a state sum up to less.
        """
        fresh, self.fresh = self.fresh, False
        start = before if self._velocity and isinstance(before, np.ndarray) else None
        return self._native.tick(q, v, targets, fresh, start, largest, ROUNDING)

    def state(self, record: bytearray) -> tuple[Vec, Vec]:
        """q and v of a tick of arrays."""
        numbers = self._state(record)
        return numbers[: self._nq].copy(), numbers[self._nq : self._nq + self._nv].copy()

    def moved(self, record: bytearray) -> tuple[Vec, Vec] | None:
        """q and v one period later, of a tick of arrays at velocity level."""
        if not self._velocity:
            return None
        q = np.frombuffer(record, FLOAT, self._nq, len(record) - 1 - 8 * self._nq)
        return q.copy(), np.frombuffer(record, FLOAT, self._nv, 8 * self._x.start).copy()

    def _state(self, record: bytearray) -> Vec:
        count = self._nq + self._nv + (self._nq if self._velocity else 0)
        return np.frombuffer(record, FLOAT, count, len(record) - 1 - 8 * count)

    def targets(self, names: Iterable[str]) -> tuple[Reference, ...]:
        """Targets of the latest tick, as references."""
        members = self._assembly.members
        return tuple(Reference(name, np.array(members[name].target)) for name in names)

    def _write(self) -> bool:
        """Rows of elements without a native operation; return true if all were written."""
        state, references = self._now
        if self._places:
            state.is_placed()
        given: Mapping[str, Reference] = self._holds
        for reference in references:
            if reference.name in self._names:
                given = {**given, reference.name: self._whole(reference)}
        self._assembly.write(state, given)
        if self.after_writing is not None:
            self.after_writing()
        return not self._assembly.errors

    def _whole(self, reference: Reference) -> Reference:
        """The reference, with the hold value where it gives none."""
        if reference.value is not None:
            return reference
        return Reference(reference.name, self._holds[reference.name].value, normal=reference.normal)

    def x(self, record: bytearray) -> Vec:
        """x ``(n,)``, read-only."""
        x = np.frombuffer(record, FLOAT, self._x.stop)[self._x]
        x.setflags(write=False)
        return x

    def seconds(self, record: bytearray) -> tuple[float, float, float]:
        """When the call began, on the clock of ``perf_counter``, and the time for rows and for the solver [s]."""
        begin, rows, solve, *_ = np.frombuffer(record, FLOAT, 5, 8 * self._slack.stop).tolist()
        return begin, rows, solve

    def slacks(self, record: bytearray) -> Vec:
        """Slacks of all rows."""
        return np.frombuffer(record, FLOAT, self._slack.stop)[self._slack]

    @staticmethod
    def staged(record: bytearray) -> bool:
        """Return true if the solution comes from stages."""
        return record[-1] > 1

    def solution(self, record: bytearray) -> Solution:
        """Solution of the solver."""
        numbers = np.frombuffer(record, FLOAT, self._count)
        marks = np.frombuffer(record, np.int8, self._rows[-1].stop, self.marks)
        points = None
        if self.staged(record):
            count, n = len(self._rows), self._x.stop - self._x.start
            points = np.frombuffer(record, FLOAT, count * n, self.marks + marks.size).reshape(count, n).copy()
        numbers.setflags(write=False)  # start of a slow-down of the session
        slack = numbers[self._slack]
        _, _, solve, iterations, factorisations = numbers[self._slack.stop :].tolist()
        return Solution(
            numbers[self._x],
            Status.OPTIMAL,
            tuple(slack[part] for part in self._rows),
            tuple(marks[part] for part in self._rows),
            Stats(int(iterations), int(factorisations), 0.0, solve),
            stage_points=points,
        )


def direct(
    assembly: Assembly,
    problem: Hierarchy,
    workspace: object,
    command: Sequence[int] | Index,
    program: Begun | None = None,
    chain: Callable[[object], object] | None = None,
    *,
    prepare: Callable[[State], None] | None = None,
    moving: Kinematics | None = None,
) -> Direct | None:
    """The native loop, None where rows or solver are not native, or the solver has more to do than to solve.

    program, chain: for torques, the native steps between the rows on the acceleration and the solver: it goes ahead of
    a solve, by capsules.  moving: the native kinematics that the rows begin with, where ``prepare`` does not see to
    them.
    """
    bind: Callable[[Hierarchy], Kernel | None] | None = getattr(workspace, "kernel", None)
    native = assembly.native_rows
    if bind is None or native is None or (kernel := bind(problem)) is None:
        return None
    picks = np.asarray(command, dtype=np.intp)
    return Direct(assembly, native, workspace, kernel, problem, picks, program, chain, prepare, moving)
