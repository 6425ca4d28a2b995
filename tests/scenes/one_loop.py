"""A session of Python, one of a file and worlds of a batch on one loop."""

from __future__ import annotations

from typing import Any

import numpy as np

import hqp
from hqp import Stack
from hqp.export.batch import BatchTick
from hqp.export.loaded import LoadedSession, LoadedTick
from hqp.loop.file import text

DT = 0.002


class Loop:
    """Give all of them the same states, references and events."""

    changed = (0, 2)
    """Worlds of the batch; the one between them stays as it was."""

    def __init__(self, robot: Any, stacks: dict[str, Stack], formulation: Any, **more: Any) -> None:
        self.robot, self.stacks = robot, stacks
        self.run = hqp.Controller(stacks[""], formulation, deadline=np.inf, **more).session(robot, DT)
        others = {name: stack for name, stack in stacks.items() if name}
        self.file = LoadedSession(text(self.run, stacks=others))
        self.batch = hqp.Batch(self.run.controller, robot, 3, DT, threads=2, stacks=others)
        self.q, self.v = robot.home.copy(), np.zeros(robot.nv)
        self.deepest, self.ticks, self.measured = 0, 0, False

    def change(self, name: str, over: float) -> None:
        self.run.change(self.stacks[name], over)
        self.file.change(name, over)
        self.batch.change(name, over, list(self.changed))

    def stop(self) -> None:
        self.run.stop("drawn")
        self.file.stop("drawn")
        self.batch.stop(list(self.changed), "drawn")

    def resume(self) -> None:
        self.run.resume()
        self.file.resume()
        self.batch.resume(list(self.changed))

    def answers(self, *references: hqp.Reference, bad: bool = False) -> tuple[hqp.Tick, LoadedTick, BatchTick | None]:
        """Ticks of session, file and batch, None for the batch after a measured load: worlds take no loads."""
        q = np.full_like(self.q, np.nan) if bad else self.q
        known = [reference for reference in references if reference.name in self.run]
        tick = self.run.step(self.robot.state(q, self.v), *known)
        for reference in known:
            if reference.load is not None:
                self.file.load(reference.name, reference.load)
        targets = {r.name: r.value for r in known if r.value is not None}
        found = self.file.step(q, self.v, targets)
        self.measured = self.measured or any(reference.load is not None for reference in known)
        if self.measured:
            return tick, found, None
        repeated = {name: np.tile(value, (3, *([1] * value.ndim))) for name, value in targets.items()}
        return tick, found, self.batch.step(np.tile(q, (3, 1)), np.tile(self.v, (3, 1)), repeated)

    def advance(self, tick: hqp.Tick, *, bad: bool) -> None:
        """Move the robot by the command, unless its state was bad."""
        line = self.run.line
        self.deepest = max(self.deepest, 0 if line.transition is None else line.transition.depth)
        self.ticks += 1
        if not bad:
            self.q, self.v = tick.advance()
