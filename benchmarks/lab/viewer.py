"""MuJoCo's interactive viewer on a run, at the speed of a clock."""

from __future__ import annotations

import time
from typing import Any

import mujoco.viewer

from benchmarks.lab import overlay


class Viewer:
    """Window for each new run; call it after every period.  Raises RuntimeError without a screen."""

    def __init__(self) -> None:
        self._run: Any = None
        self._window: Any = None
        self._began = 0.0

    def __call__(self, run: Any) -> None:
        """Show the present state at its time."""
        if run is not self._run:
            if self._window is not None:
                self._window.close()
            self._run, self._began = run, time.perf_counter() - run.t
            self._window = mujoco.viewer.launch_passive(run.plant.model, run.plant.data)
        if not self._window.is_running():
            return
        if hasattr(run, "pull"):
            overlay.place_hand(run)
        self._window.sync()
        ahead = run.t - (time.perf_counter() - self._began)
        if ahead > 0.0:
            time.sleep(ahead)
