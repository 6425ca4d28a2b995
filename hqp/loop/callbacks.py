"""Parts of a native tick in Python: rows of a user's own elements, other solvers, laws that no file can hold."""

from __future__ import annotations

from collections.abc import Iterable, Mapping, Sequence
from typing import TYPE_CHECKING, Any

import numpy as np

from hqp.arrays import Signs, Vec
from hqp.declare.element import Element
from hqp.declare.reference import Reference, copied
from hqp.declare.robot import Robot, State
from hqp.errors import DeclarationError, DynamicsFailed
from hqp.explanation.notes import STATUSES
from hqp.problem import Solution, Status
from hqp.programs.assembly import OWN
from hqp.programs.rest import Holding
from hqp.solvers.base import turn

if TYPE_CHECKING:
    from hqp.loop.compiled import Compiled
    from hqp.loop.presence import Presence

REFUSED, BROKEN = STATUSES.index(Status.INVALID_REFERENCE), STATUSES.index(Status.INVALID_ELEMENT)
OUT, HELD = "left out of this tick", "its hold value is used instead"

Outcome = tuple[int, Vec, Vec, Signs, str, list[float] | None, int, int]
"""A solution: status, x, slacks and marks of all rows, detail, points of stages, iterations, factorisations."""


class Callbacks:
    """Functions that a native session calls in a tick, for the rows of one program (hqp/cpp/session/foreign.hpp).

    fills: true if Python fills all rows, writes: if it writes some elements' rows, judges: if it judges answers of the
    native solver that are no optimum.  solution: answer of a solver in Python, in this tick.  faults: status, text and
    true if it is left out, for elements with unusable rows.  holds: hold values of elements without native code;
    without: reasons why some of these have none.  here: elements that are held at their present place if they have no
    reference.
    """

    def __init__(self, compiled: Compiled, robot: Robot, presence: Presence, holds: Mapping[str, Reference]) -> None:
        program = compiled.program
        self._program, self._workspace, self._robot = program, compiled.workspace, robot
        self._presence, self._hard = presence, compiled.hard
        self._holding: Holding | None = compiled.holding
        self._compiled = compiled
        self.native_solver = compiled.native_solver
        self._written = {member.element.name: member for member in program.assembly.written}
        found = program.in_python()
        self.fills = found is not None and found[0] not in self._written
        self.writes = bool(self._written) and not self.fills
        self.judges = self.native_solver and compiled.limit is None
        self.reads = self.fills or self.writes or not self.native_solver
        self._targets = program.live_targets
        self.own = [e for e in compiled.stack if e.name not in self._targets]
        self.names = frozenset(e.name for e in self.own)
        self._forces = program.force_targets
        self._aimed = False
        self._mine: list[Reference] = []
        self.holds = {name: held for name, held in holds.items() if name in self.names}
        self.without: dict[str, str] = {}
        self.faults: dict[str, tuple[int, str, bool]] = {}
        self.solution: Solution | None = None
        self.here: frozenset[str] = frozenset()
        self.state: State | None = None
        self.last_good: State | None = None
        self.references: tuple[Reference, ...] = ()

    @property
    def attentive(self) -> bool:
        """True if every tick calls ``begin``."""
        return self.reads or self._program.kind == "torque" or not self._compiled.placed

    def begin(self, state: State | None, references: tuple[Reference, ...], commanded: Vec | None) -> bool:
        """Begin a tick with these references; return true if ``fill`` has to write all rows."""
        if self.here and state is not None and state.valid:
            here = self.here.difference(r.name for r in references)
            references = (*references, *(e.hold(state) for e in self.own if e.name in here))
        self.state, self.references, self.solution = state, references, None
        if state is not None and self.reads:
            state.commanded = commanded
        if self.faults:
            self.faults.clear()
        self._mine = mine = [r for r in references if r.name in self.names and r.value is not None]
        for reference in mine:
            held, value = self.holds.get(reference.name), reference.value
            assert value is not None
            if held is not None and held.value is not None and value.shape != held.value.shape:
                given = value.shape
                raise DeclarationError(reference.name, f"value has shape {given}", allowed=f"shape {held.value.shape}")
        return bool(self._forces) and not self.fills and self._aim(mine)

    def _aim(self, mine: Sequence[Reference]) -> bool:
        """Take targets of forces; return true if one is not finite or does not fit."""
        given = {r.name: r for r in mine if r.name in self._forces}
        if not given and not self._aimed:
            return False
        for name, reference in given.items():
            value = reference.value
            if np.shape(value) != (self._forces[name],) or not np.isfinite(value).all():  # type: ignore[arg-type]
                self._aimed = True
                return True
        self._aimed = bool(given)
        self._program.aim_forces({**{name: Reference(name) for name in self._forces}, **self.holds, **given})
        return False

    def supported(self, out: Sequence[str]) -> tuple[list[str], list[str], str] | None:
        """Return elements that may leave, contacts that must stay, and the reason; None if all may leave."""
        return self._presence.supported(frozenset(out))

    def go_without(self, out: Sequence[str]) -> None:
        """Leave these elements out from now on; elements that come back take fresh hold values."""
        before, now = self._program.out, frozenset(out)
        self._program.go_without(now)
        if not self.native_solver:  # a native solver resumes from its last end with that set
            turn(self._workspace, [element.name in now for element in self._compiled.stack])
        for name in before - now:
            self.holds.pop(name, None)
        if self._aimed:  # the program's targets are as declared again
            self._aim(self._mine)

    def _take_holds(self, state: State) -> None:
        """Hold values of elements that have none yet."""
        self.without.clear()
        for element in self.own:
            if element.name not in self.holds:
                self._take_hold(element, state)

    def _take_hold(self, element: Element, state: State) -> None:
        try:
            held: object = element.hold(state)
        except Exception as error:
            if type(element).__module__.startswith(OWN):
                raise
            self.without[element.name] = f"its hold value raised {type(error).__name__}: {error}"
            return
        if isinstance(held, Reference):
            self.holds[element.name] = copied(held)
        else:
            self.without[element.name] = f"its hold value must be a Reference, given {type(held).__name__}"

    def _current(self, refused: Iterable[str] = ()) -> tuple[dict[str, Reference], list[Reference]]:
        """A reference for every element, and those that were given."""
        current = {name: Reference(name, np.array(target)) for name, target in self._targets.items()}
        current |= {e.name: self.holds.get(e.name) or Reference(e.name) for e in self.own}
        given: list[Reference] = []
        for reference in self.references:
            name = reference.name
            if name in refused or name in self._program.out or (name in self._targets and not reference.finite):
                continue
            if reference.value is None:
                reference = reference.aiming_at(current[name].value)
            current[name] = reference
            given = [r for r in given if r.name != name] + [reference]
        return current, given

    @np.errstate(all="ignore")
    def fill(self, left_out: Sequence[str]) -> str | None:
        """Fill all rows, without those of elements whose numbers are not usable; why the dynamics fail, or None."""
        state, program = self.state, self._program
        assert state is not None
        try:
            program.prepare(state)
            self._take_holds(state)
            current, given = self._current(left_out)
            program.fill(state, current, given, left_out)
            broken = [name for name in self._unusable(current) if name not in left_out]
            if broken:
                self._repair(state, broken, left_out)
        except (DynamicsFailed, np.linalg.LinAlgError) as error:
            return str(error)
        return None

    def _unusable(self, current: Mapping[str, Reference]) -> tuple[str, ...]:
        lacking = [name for name in self.without if current[name].value is None]
        return tuple(dict.fromkeys((*self._program.unusable(), *lacking)))

    def _repair(self, state: State, broken: Sequence[str], left_out: Sequence[str]) -> None:
        """Refill without unusable parts: hold values for members of ``subject_to``, free rows for all others."""
        given = {reference.name: reference for reference in self.references}
        wrong = [name for name in broken if name in given and not given[name].finite]
        out = [name for name in broken if name not in wrong or name not in self._hard]
        self._refuse(broken, given)
        if wrong:
            current, others = self._current((*left_out, *wrong))
            self._program.fill(state, current, others, left_out)
            out = [*(name for name in wrong if name not in self._hard), *self._unusable(current)]
        for name in dict.fromkeys((*wrong, *out)):
            left = name in out
            if name in wrong:
                self.faults[name] = REFUSED, f"its reference is not finite: {OUT if left else HELD}", left
            else:
                reason = self.without.get(name) or self._program.reason(name)
                self.faults[name] = BROKEN, f"{reason}: {OUT}", True
        gone = list(dict.fromkeys((*left_out, *out)))
        if gone:
            current, others = self._current((*left_out, *wrong))
            self._program.fill(state, current, others, gone)

    def _refuse(self, broken: Iterable[str], given: Mapping[str, Reference]) -> None:
        """Raise for a reference of the wrong length, which only its element can detect."""
        for name in broken:
            error, held = self._program.errors.get(name), self.holds.get(name)
            if name in given and isinstance(error, DeclarationError) and (held is None or held.value is None):
                raise error

    @np.errstate(all="ignore")
    def write(self) -> None:
        """Write the rows of elements without a native operation."""
        state, rows = self.state, self._program.assembly
        assert state is not None
        state.is_placed()
        state.out = self._program.out
        self._take_holds(state)
        current = {e.name: self.holds.get(e.name) or Reference(e.name) for e in self.own}
        given = {}
        for reference in self.references:
            if reference.name in self._written and reference.name not in self._program.out:
                value = reference.value if reference.value is not None else current[reference.name].value
                given[reference.name] = current[reference.name] = reference.aiming_at(value)
        rows.write(state, current)
        wrong = [n for n, r in given.items() if not r.finite and (n in rows.errors or not rows.sound(n))]
        self._refuse(rows.errors, given)
        for name in wrong:
            rows.errors.pop(name, None)
            self.faults[name] = REFUSED, f"its reference is not finite: {OUT}", True
        if again := [name for name in wrong if name in self._hard]:
            kept = dict(rows.errors)
            rows.write(state, {**current, **{n: self.holds.get(n) or Reference(n) for n in again}}, again)
            for name in again:
                if name not in rows.errors and rows.sound(name):
                    self.faults[name] = REFUSED, f"its reference is not finite: {HELD}", False
                rows.errors.pop(name, None)
            rows.errors |= kept
        for name in rows.errors:
            self.faults[name] = BROKEN, f"{rows.reason(name)}: {OUT}", True
        for name, why in self.without.items():
            if current[name].value is None and name not in self._program.out:
                self.faults[name] = BROKEN, f"{why}: {OUT}", True

    @np.errstate(all="ignore")
    def solve(self) -> Outcome:
        """The answer of a solver that is written in Python."""
        return self._outcome(self._compiled.workspace.solve(self._program.problem))

    @np.errstate(all="ignore")
    def judge(self, counts: tuple[int, int, int, bool]) -> Outcome:
        """The answer if that of the native solver is no optimum."""
        workspace: Any = self._workspace
        return self._outcome(workspace.answer(self._program.problem, counts))

    def _outcome(self, solution: Solution) -> Outcome:
        self.solution = solution
        rows = sum(level.m for level in self._program.problem.levels)
        slacks = np.concatenate([np.zeros(0), *solution.residuals])
        if slacks.size != rows:
            slacks = np.concatenate([np.zeros(0), *self._program.problem.slacks(solution.x)])
        marks: Signs = np.concatenate([np.zeros(0, dtype=np.int8), *solution.active])
        if marks.size != rows:  # a solver that marks none
            marks = np.zeros(rows, dtype=np.int8)
        points = None if solution.stage_points is None else solution.stage_points.ravel().tolist()
        x = np.ascontiguousarray(solution.x, dtype=np.float64)
        stats = solution.stats
        status = solution.status.severity
        return status, x, slacks, marks, solution.detail, points, stats.iterations, stats.factorisations

    def limit(self, seconds: float) -> None:
        """Time for the solver [s]."""
        if self._compiled.limit is not None:
            self._compiled.limit(seconds)

    @np.errstate(all="ignore")
    def start(self, last: bool) -> tuple[Vec, Vec, Vec | None, Vec | None] | None:
        """Angles and v of this state or the last good one, where braking begins, and the holding torque."""
        state = self.last_good if last else self.state
        if state is None:
            return None
        holding = momentum = None
        if self._holding is not None:
            try:
                holding, momentum = self._holding(state)
            except Exception:  # an element of the user that broke the tick may break this as well
                holding = momentum = None
        return state.angles, state.v, holding, momentum
