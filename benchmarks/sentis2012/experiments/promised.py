"""Every figure that Dreamer's nominal runs promise, not the CoM error alone, as a distribution over runs."""

from __future__ import annotations

import math
from collections.abc import Mapping, Sequence
from dataclasses import replace

from benchmarks.lab.distribution import Asked
from benchmarks.lab.outcome import Table, table

PRIVILEGED = (
    Asked("com_up", "CoM error, way up [mm]", high=6.0),
    Asked("com_back", "CoM error, way back [mm]", high=6.0),
    Asked("com_first", "CoM error, first half second [mm]"),
    Asked("travel", "travel [m]", low=0.9),
    Asked("speed", "speed, median of the pull [m/s]", low=0.30, high=0.40),
    Asked("pull", "pull, max [N]", high=50.0),
    Asked("hand_pulled", "hand error under pull [mm]", high=40.0),
    Asked("hand_rest", "hand error at rest [mm]", high=1.0),
    Asked("posture", "posture error, max [deg]", high=32.0),
    Asked("coupling", "biarticular coupling [deg]", high=0.02),
    Asked("unloaded", "a wheel unloaded [ms]", high=0.0, scale=1e3),
    Asked("load_quantile", "wheel load, 0.5 % quantile [N]", low=60.0, smaller_is_worse=True),
    Asked("wheel_torque", "wheel torque, max [N m]", high=10.0),
)
"""The limits of a single run in ``slope.acceptance``."""

SENSED = {"com_up": 10.0, "com_back": 10.0, "pull": 60.0}
"""Upper limits on the robot's own sensing; the lower limit of travel holds as well."""


def asked(privileged: bool) -> tuple[Asked, ...]:
    """The figures with their limits."""
    if privileged:
        return PRIVILEGED
    found = []
    for figure in PRIVILEGED:
        low = figure.low if figure.key == "travel" else -math.inf
        found.append(replace(figure, low=low, high=SENSED.get(figure.key, math.inf)))
    return tuple(found)


def compared(cells: Mapping[str, Sequence[Mapping[str, float]]]) -> Table:
    """A row per figure, a column per cell: median / 99th percentile / worst, and the limit, if any."""
    columns = [[figure.cell(runs) for figure in asked(name == "nominal")] for name, runs in cells.items()]
    rows = [(figure.words, *row) for figure, row in zip(PRIVILEGED, zip(*columns, strict=True), strict=True)]
    header = ("figure", *(f"{name} ({len(runs)} runs)" for name, runs in cells.items()))
    return table("What is promised: median / 99th percentile / worst", header, rows)
