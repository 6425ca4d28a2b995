"""One stack in closed loop through several solvers."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from pathlib import Path
from typing import Any

from hqp.commands.manifest import manifest
from hqp.commands.threads import one_thread
from hqp.declare.stack import Stack
from hqp.errors import HqpError, SolverNotInstalled, UnsupportedProblem
from hqp.numbers import number, whole
from hqp.programs.formulation import Formulation, Velocity
from hqp.solvers import load, select
from hqp.solvers.base import Solver

from .measures import Summary, refused, summarise
from .result import Bench
from .run import Run, run
from .trajectory import Motion, Trajectory


def bench(
    stack: Stack,
    robot: Any,
    *,
    trajectory: str | Path | Motion = "circle",
    solvers: str | Sequence[str | Solver] = "",
    formulation: Formulation | None = None,
    dt: float = 0.002,
    seconds: float = 2.0,
    plant: str = "integrator",
    certify_every: int = 10,
    progress: Callable[[str, float], None] | None = None,
) -> Bench:
    """Run a stack in closed loop with each solver and measure time, accuracy and calm.

    trajectory: see Trajectory.  solvers: names, Solver values, "all" that are available, or "" for the one that a
    Controller takes.  plant: ``integrator`` or ``mujoco``.  certify_every: every how many ticks the answer is judged by
    the certificate, outside the timed step.  progress: called with a solver's name and the share of its loop that is
    done.  BLAS takes one thread meanwhile: matrices are too small for more.  A solver that refuses the stack, or is not
    installed, has a line with the reason.  Raises DeclarationError for a bad trajectory, plant or number.
    """
    for name, value in (("dt", dt), ("seconds", seconds)):
        number("bench", name, value, 0.0, strict=True)
    certify_every = whole("bench", "certify_every", certify_every, 1)
    formulation = formulation or Velocity()
    chosen = select(solvers)
    ticks = max(2, round(seconds / dt))
    motion = Trajectory(trajectory, stack, robot, seconds)
    lines: list[Summary] = []
    runs: list[Run] = []
    for item in chosen:
        name = item if isinstance(item, str) else item.name
        try:
            solver = load(item) if isinstance(item, str) else item
        except SolverNotInstalled as error:
            lines.append(refused(name, True, str(error)))
            continue

        def report(done: int, name: str = name) -> None:
            if progress is not None:
                progress(name, done / ticks)

        try:
            with one_thread():
                one = run(
                    stack, robot, solver, name, formulation, motion,
                    dt=dt, ticks=ticks, plant=plant, certify_every=certify_every, progress=report,
                )  # fmt: skip
        except UnsupportedProblem as error:
            lines.append(refused(name, solver.strict, str(error)))
            report(ticks)
            continue
        runs.append(one)
        lines.append(summarise(one))
    if not lines:
        raise HqpError("no solver to run")
    with one_thread():  # setting of the loops
        about = manifest(
            stack=str(stack),
            robot=robot.name,
            formulation=type(formulation).__name__,
            trajectory=motion.name,
            plant=plant,
            dt=dt,
            ticks=ticks,
            seed=0,
        )
    return Bench(about, tuple(lines), tuple(runs))
