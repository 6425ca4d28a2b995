"""Distribution of tick times as a figure."""

from __future__ import annotations

from collections.abc import Mapping
from pathlib import Path

import matplotlib

matplotlib.use("Agg")

import matplotlib.pyplot as plt
import numpy as np

from hqp.arrays import Vec


def tick_times(wall_us: Mapping[str, Vec], budget_us: float, title: str, path: Path) -> Path:
    """ECDF of tick times ``(T,)`` [us] of each solver with the budget as a line."""
    figure, axis = plt.subplots(figsize=(10.0, 5.0), layout="constrained")
    for name, times in wall_us.items():
        axis.ecdf(times, label=f"{name}, median {np.median(times):.0f} us")
    axis.axvline(budget_us, color="black", linestyle="--", label=f"{budget_us / 1e3:g} ms")
    axis.set(xscale="log", xlabel="tick, state to command [us]", ylabel="share of ticks", title=title)
    axis.grid(alpha=0.3, which="both")
    figure.legend(loc="outside right upper", fontsize="small")  # beside the curves, not over the line
    path.parent.mkdir(parents=True, exist_ok=True)
    figure.savefig(path, dpi=110)
    plt.close(figure)
    return path
