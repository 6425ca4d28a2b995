"""Performance profile (Dolan and More 2002): the share of problems a solver finishes within a factor of the best."""

from __future__ import annotations

from collections.abc import Mapping
from pathlib import Path

import matplotlib

matplotlib.use("Agg")
import matplotlib.pyplot as plt
import numpy as np


def performance(walls_us: Mapping[str, Mapping[str, float]], path: Path) -> Path:
    """walls_us: per solver the time of each problem; problems that a solver was not given do not count for it."""
    best: dict[str, float] = {}
    for times in walls_us.values():
        for problem, time in times.items():
            best[problem] = min(time, best.get(problem, np.inf))
    figure, axis = plt.subplots(figsize=(7.0, 4.0), layout="constrained")
    for solver, times in walls_us.items():
        ratio = np.sort([time / best[problem] for problem, time in times.items()])
        axis.step(ratio, np.arange(1, ratio.size + 1) / ratio.size, where="post", label=f"{solver} ({ratio.size})")
    axis.set_xscale("log")
    axis.set_xlim(1.0, None)
    axis.set_ylim(0.0, 1.02)
    axis.set_xlabel("time over that of the fastest solver")
    axis.set_ylabel("share of the problems given")
    axis.legend(fontsize=7, loc="lower right")
    figure.savefig(path, dpi=150)
    plt.close(figure)
    return path
