"""Options of experiments: length, solver, written files, pictures."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any

from benchmarks.lab.outcome import Figure, Outcome
from benchmarks.lab.recorder import Recorder
from hqp.solvers.base import Solver


@dataclass(frozen=True, kw_only=True)
class Setting:
    """Options common to all experiments.

    full: the full version, not the short one.  output: folder of logs and figures, or None.  pictures, video:
    render the scene.  show: called after every period with the run, for a viewer.  advance: callback of progress.
    jobs: processes for sweeps.
    """

    solver: str | Solver = "lexicographic"
    full: bool = False
    output: Path | None = None
    pictures: bool = True
    video: bool = False
    jobs: int = 1
    show: Callable[[Any], None] | None = field(default=None, compare=False)
    advance: Callable[[], None] = field(default=lambda: None, compare=False)

    def log(self, outcome: Outcome, stem: str, recorder: Recorder) -> None:
        """Write a run's log as npz if there is a folder."""
        if self.output is not None:
            path = recorder.save(self.output / f"{outcome.name}_{stem}.npz", outcome.parameters)
            outcome.files.append((f"log, {stem}", path))

    def plot(self, outcome: Outcome, plot: str, *runs: Any) -> None:
        """Draw a figure of ``benchmarks.lab.plots`` by name if there are a folder and matplotlib."""
        if self.output is None:
            return
        try:
            from benchmarks.lab import plots
        except ImportError as missing:
            outcome.notes.append(f"No plots: {missing}.")
            return
        for caption, path in getattr(plots, plot)(self.output, *runs):
            outcome.files.append((caption, path))

    def speed(self, factors: tuple[float, float], wanted: float) -> tuple[Figure, Figure]:
        """Real-time factors by CPU time, with a limit, and by wall time, which includes other programs."""
        return (
            Figure("real-time factor, processor time", factors[0], low=wanted, binding=False),
            Figure("real-time factor, wall time", factors[1], binding=False),
        )
