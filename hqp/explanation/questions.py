"""Questions to a session about its latest tick: shares of elements, constraints in conflict."""

from __future__ import annotations

from collections.abc import Container
from dataclasses import replace
from typing import TYPE_CHECKING, Any, Protocol

from hqp.arrays import Vec
from hqp.declare.element import Inequality, has
from hqp.declare.reference import Reference
from hqp.declare.robot import Robot, State
from hqp.declare.stack import Stack
from hqp.errors import HqpError
from hqp.explanation.account import MOST, Accountant, TickAccount, of_explanation, too_fast, unit_of
from hqp.explanation.multipliers import explain
from hqp.explanation.notes import Note
from hqp.explanation.words import Explanation
from hqp.problem import Solution, Status
from hqp.programs.formulation import Program
from hqp.solvers.base import Workspace

if TYPE_CHECKING:
    from hqp.explanation.conflict import Conflict

UNITS = {
    "motion": {"velocity": "(rad, m)/s", "acceleration": "(rad, m)/s^2", "torque": "(rad, m)/s^2"},
    "force": dict.fromkeys(("velocity", "acceleration", "torque"), "(N, N m)"),
    "effort": dict.fromkeys(("velocity", "acceleration", "torque"), "N m"),
}
"""Units of rows by their quantity and the meaning of x."""

DULL = ("joint_limits", "torque_limits")
"""Elements whose rows need only the joint's name."""


class HeldBackNotes:
    """Notes on elements that are short of their request, made when they are read.

    values: numbers of the account.  w: slacks of all rows.  references: those of the tick, or names of its targets.
    """

    __slots__ = ("_references", "_teller", "_values", "_w")

    def __init__(self, teller: Teller, values: Vec, w: Vec, references: tuple[Reference | str, ...]) -> None:
        self._teller, self._values, self._w, self._references = teller, values, w, references

    def __call__(self) -> tuple[Note, ...]:
        names = {each if isinstance(each, str) else each.name for each in self._references}
        return self._teller.held_back_notes(self._values, self._w, names)


class Answered(Protocol):
    """Interface of a tick."""

    @property
    def count(self) -> int: ...
    @property
    def state(self) -> State: ...
    @property
    def before(self) -> Vec: ...
    @property
    def solution(self) -> Solution | None: ...
    def solved(self) -> tuple[Vec, Vec, Any] | None: ...


class Teller:
    """Explains the latest tick of one compiled stack; helpers are made on first use."""

    __slots__ = ("_accountant", "_dt", "_made_of", "_program", "_robot", "_stack")

    def __init__(self, stack: Stack, program: Program, workspace: Workspace, robot: Robot, dt: float) -> None:
        self._stack, self._program, self._robot, self._dt = stack, program, robot, dt
        self._made_of = program, workspace, robot
        self._accountant: Accountant | None = None

    @property
    def _accounts(self) -> Accountant:
        if self._accountant is None:
            self._accountant = Accountant(*self._made_of)
        return self._accountant

    def held_back(self, w: Vec, x: Vec) -> Vec | None:
        """Take the numbers of the account now; ``HeldBackNotes`` makes the texts. None without multipliers."""
        return self._accounts.values(w, x)

    def held_back_notes(self, values: Vec, w: Vec, names: Container[str]) -> tuple[Note, ...]:
        """Make the notes on elements that are short of their request: named elements, and those held mainly by their
        price."""
        accounts = self._accounts
        account = accounts.of(0, values)
        return tuple(
            Note(held.element, Status.OPTIMAL, held.note(account.losses(held.element), account.cause(held.element)))
            for held in accounts.held_back(account, w)
            if held.share > MOST or held.element in names
        )

    def explain(self, count: int, tick: Answered) -> Explanation:
        """Explain the residual and the losses of each element."""
        solution = self._latest("explain", count, tick)
        program, v = self._program, tick.state.v
        row_names = {element.name: element.row_names(self._robot) for element in self._stack}
        units = {element.name: unit_of(element, program.kind) for element in self._stack}
        fast = set()
        for name, place in program.places.items():
            w = solution.residuals[place.level][place.part] / place.element.weight
            if too_fast(program, name, w, v):
                fast.add(name)
        account = self._account(count, tick)
        shares = None if account is None else account.shares
        around = tick.before if program.kind == "velocity" else v
        kinds = {
            element.name: element.bound_kinds(tick.state, around, self._dt)
            for element in self._stack
            if isinstance(element, Inequality) and has(element, "bound_kinds")
        }
        found = explain(
            program.problem, solution, program.places, row_names, fast=fast, units=units, shares=shares, kinds=kinds
        )
        accounts = tuple(replace(a, cause="off") if a.element in program.out else a for a in found.accounts)
        return replace(found, accounts=accounts, remarks=program.remarks(tick.state))

    def account(self, count: int, tick: Answered) -> TickAccount:
        """Shares of each element."""
        found = self._account(count, tick)
        return of_explanation(self._accounts.layout, count, self.explain(count, tick)) if found is None else found

    def conflict(self, count: int, tick: Answered) -> Conflict:
        """Find rows of ``subject_to`` that exclude each other."""
        self._latest("conflict", count, tick)
        from hqp.explanation.conflict import conflict

        program, problem = self._program, self._program.problem
        names = [[("", "")] * rows.m for rows in problem.levels]
        for name, place in program.places.items():
            rows = place.element.row_names(self._robot)
            unit = UNITS[place.element.quantity][program.kind]
            for i in range(place.part.stop - place.part.start):
                row = rows[i] if i < len(rows) else f"row {i}"
                title = row if name in DULL else f"{name}: {row}"
                names[place.level][place.part.start + i] = (title, unit)
        return conflict(problem, names)

    def _account(self, count: int, tick: Answered) -> TickAccount | None:
        solved = tick.solved() if tick.count == count else None
        if solved is None:
            raise _too_late("account")
        w, x, _ = solved
        return self._accounts.account(count, w, x, tick.state.v)

    @staticmethod
    def _latest(what: str, count: int, tick: Answered) -> Solution:
        if tick.count != count or tick.solution is None:
            raise _too_late(what)
        return tick.solution


def _too_late(what: str) -> HqpError:
    return HqpError(f"{what}() explains only the latest step, and only with a solution: call it before the next step")
