"""Reference tick in Python over elements, programs and solvers, for comparison with the native tick.

    a state, references in place of hold values  ->  rows  ->  a solver  ->  x, unchanged or towards rest

It guards against references and rows that are not finite, and against speeds beyond the model's limits at velocity
level, and nothing else.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np

import hqp
from hqp.arrays import Vec
from hqp.declare.reference import Reference, copied
from hqp.declare.stack import coupled
from hqp.errors import DynamicsFailed
from hqp.problem import Solution, Status
from hqp.solvers.base import Solver


@dataclass
class ReadableTick:
    """Result of a tick; x of the solver, None without a usable answer."""

    status: Status
    x: Vec | None
    solution: Solution | None
    blamed: tuple[str, ...]
    """Elements without usable rows or with an unusable reference."""


class ReadableSession:
    """A controller on a robot without rates, transitions, phases and time."""

    def __init__(self, controller: hqp.Controller, robot: Any, dt: float) -> None:
        assert isinstance(controller.solver, Solver)
        stack = coupled(controller.stack, robot)
        formulation = controller.formulation
        if controller.solver.inequalities and controller.price is None:
            stack, _ = formulation.bounded(stack, robot)
        self.robot, self.stack, self.controller = robot, stack, controller
        self.program = formulation.compile(stack, robot, dt, controller.price)  # type: ignore[arg-type]
        self.workspace = controller.solver.workspace(self.program.shape)
        if limit := getattr(self.workspace, "limit", None):
            limit(np.inf)
        self.hard = {element.name for element in stack.subject_to}
        self.holds: dict[str, Reference] = {}
        self.out: frozenset[str] = frozenset()
        self.x: Vec | None = None

    def step(self, q: Vec, v: Vec, *references: Reference) -> ReadableTick:
        """One tick for a state; references apply to this tick alone."""
        state = self.robot.state(q, v)
        if not state.valid:
            return ReadableTick(Status.INVALID_STATE, None, None, ())
        self._attend(frozenset(r.name for r in references if r.on is False))
        given = {r.name: r for r in references if r.name not in self.out}
        try:
            self.program.prepare(state)
            self._take_holds(state)
            state.commanded = self.x if self.program.kind == "velocity" else None
            blamed, refused = self._fill(state, given)
        except (DynamicsFailed, np.linalg.LinAlgError):
            return ReadableTick(Status.DYNAMICS_FAILED, None, None, ())
        solution = self.workspace.solve(self.program.problem)
        status = solution.status
        if blamed:
            status = Status.worst(status, Status.INVALID_REFERENCE if refused else Status.INVALID_ELEMENT)
        if not solution.status.usable:
            return ReadableTick(status, None, solution, blamed)
        self.x = self._within_speeds(solution.x, v if self.x is None else self.x)
        return ReadableTick(status, self.x, solution, blamed)

    def _within_speeds(self, x: Vec, before: Vec) -> Vec:
        """x scaled down to the speed limits of the motors; motors beyond their limit do not speed up."""
        if self.program.kind != "velocity":
            return x.copy()
        motors = self.robot.actuated
        most = np.maximum(self.robot.velocity_limit[motors], np.abs(before[motors]))
        over = np.max(np.abs(x[motors]) / most)
        return x / over if over > 1.0 + 1e-6 else x.copy()

    def _attend(self, told: frozenset[str]) -> None:
        """Leave out these elements and their followers; returning elements take fresh hold values."""
        out = told | {element.name for element in self.stack if element.goes_with(told)}
        for name in self.out - out:
            self.holds.pop(name, None)
        self.program.go_without(out)
        self.out = out

    def _take_holds(self, state: Any) -> None:
        for element in self.stack:
            if element.name not in self.holds:
                self.holds[element.name] = copied(element.hold(state))

    def _fill(self, state: Any, given: dict[str, Reference]) -> tuple[tuple[str, ...], bool]:
        """Rows of all elements; names of elements with unusable numbers, and true if a reference is the cause."""
        current, told = self._current(given)
        self.program.fill(state, current, told)
        broken = self.program.unusable()
        if not broken:
            return (), False
        wrong = [name for name in broken if name in given and not given[name].finite]
        current, told = self._current({name: r for name, r in given.items() if name not in wrong})
        out = [name for name in broken if name not in wrong or name not in self.hard]
        self.program.fill(state, current, told, out)
        return tuple(broken), bool(wrong)

    def _current(self, given: dict[str, Reference]) -> tuple[dict[str, Reference], Sequence[Reference]]:
        whole = {name: r if r.value is not None else r.aiming_at(self.holds[name].value) for name, r in given.items()}
        return {**self.holds, **whole}, list(whole.values())
