"""Performance profile (Dolan and More 2002): the share of problems a solver finishes within a factor of the best."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from pathlib import Path

import matplotlib

matplotlib.use("Agg")
import matplotlib.pyplot as plt
import numpy as np

FEW = 100
"""Number of problems of which a drawn solver received at least half; less if all solvers received fewer."""


def _median(times: Mapping[str, float], common: Sequence[str]) -> float:
    return float(np.median([times[problem] for problem in common])) if common else 0.0


def performance(walls_us: Mapping[str, Mapping[str, float]], path: Path) -> Path:
    """Draw the profile over the problems that every solver received, so that all curves count equal problems.

    walls_us: time of each problem by solver.  The title names solvers that received too few problems and are omitted.
    """
    most = max(map(len, walls_us.values()), default=0)
    fewest = min((len(t) for t in walls_us.values() if 2 * len(t) >= min(most, FEW)), default=0)
    drawn = {name: times for name, times in walls_us.items() if len(times) >= fewest}
    common = sorted(set.intersection(*(set(times) for times in drawn.values()))) if drawn else []
    figure, axis = plt.subplots(figsize=(9.0, 4.4), layout="constrained")
    best = {problem: min(times[problem] for times in drawn.values()) for problem in common}
    for i, (solver, times) in enumerate(sorted(drawn.items(), key=lambda item: _median(item[1], common))):
        ratio = np.sort([times[problem] / best[problem] for problem in common])
        share = np.arange(1, ratio.size + 1) / max(ratio.size, 1)
        axis.step(ratio, share, where="post", label=solver, linewidth=3.0 if i == 0 else 1.6, zorder=10 - i)
    left = [name for name in walls_us if name not in drawn]
    without = f"; without {', '.join(left)}, which take too few of them" if left else ""
    axis.set_title(f"{len(common)} problems that all were given{without}", fontsize=9, loc="left")
    axis.set_xscale("log")
    axis.set_xlim(0.9, None)  # keeps the fastest solver's curve off the axis
    axis.set_ylim(0.0, 1.02)
    axis.set_xlabel("time over that of the fastest solver")
    axis.set_ylabel("share of the problems")
    axis.grid(alpha=0.3, which="both")
    figure.legend(fontsize=8, loc="outside right upper")
    figure.savefig(path, dpi=150)
    plt.close(figure)
    return path
