"""The counterparts of Mistry 2008, Figs. 6 to 9, without dynamics."""

from __future__ import annotations

from pathlib import Path

import matplotlib

matplotlib.use("Agg")

import matplotlib.pyplot as plt
import numpy as np

from benchmarks.mistry2008.equations.integration import GAIN, Experiments

DESIRED, ACTUAL, PRINTED = "tab:green", "tab:blue", "tab:red"

CM = 100.0


def experiments(runs: Experiments, robot: str, output: Path) -> list[tuple[str, Path]]:
    """Figs. 6 to 9 of one robot: captions and files."""
    output.mkdir(parents=True, exist_ok=True)
    made = [
        (_cog(runs), f"CoG side to side on {robot} (Fig. 6)", "fig6"),
        (_hand_in_time(runs), f"hand on a figure-8 on {robot} (Fig. 7)", "fig7"),
        (_hand_in_plane(runs), f"hand in the frontal plane on {robot} (Fig. 8)", "fig8"),
        (_cog_during_hand(runs), f"CoG during the figure-8 on {robot} (Fig. 9)", "fig9"),
    ]
    files = []
    for figure, caption, stem in made:
        path = output / f"{stem}_{robot}.png"
        figure.savefig(path, dpi=110)
        plt.close(figure)
        files.append((caption, path))
    return files


def _axes(rows: int, height: float = 5.0) -> tuple[plt.Figure, np.ndarray]:
    figure, axes = plt.subplots(rows, 1, figsize=(8.0, height), sharex=True, layout="constrained", squeeze=False)
    return figure, axes[:, 0]


def _legend(figure: plt.Figure, axis: plt.Axes) -> None:
    figure.legend(*axis.get_legend_handles_labels(), loc="outside upper center", ncols=3)


def _cog(runs: Experiments) -> plt.Figure:
    figure, (side, front) = _axes(2)
    start = runs.cog.com_target[0]
    for axis, column in ((side, 1), (front, 0)):
        axis.plot(runs.cog.t, CM * (runs.cog.com_target[:, column] - start[column]), color=DESIRED, label="desired")
        axis.plot(runs.cog.t, CM * (runs.cog.com[:, column] - start[column]), "--", color=ACTUAL, label="actual")
        lagging = runs.cog_lagging.com[:, column] - runs.cog_lagging.com_target[0, column]
        axis.plot(runs.cog_lagging.t, CM * lagging, ":", color=PRINTED, label="actual, no feedforward")
        axis.grid(alpha=0.3)
    side.set_ylabel("left-right [cm]")
    front.set(ylabel="front-back [cm]", xlabel="time [s]", ylim=(-2.0, 2.0))
    _legend(figure, side)
    return figure


def _hand_in_time(runs: Experiments) -> plt.Figure:
    figure, axes = _axes(2)
    start = runs.recursive.hand_target[0]
    for axis, column, text in zip(axes, (1, 2), ("left-right [cm]", "up-down [cm]"), strict=True):
        trace = runs.recursive
        axis.plot(trace.t, CM * (trace.hand_target[:, column] - start[column]), color=DESIRED, label="desired")
        axis.plot(
            trace.t, CM * (trace.hand[:, column] - start[column]), "--", color=ACTUAL, label="recursive projector"
        )
        axis.plot(runs.printed.t, CM * (runs.printed.hand[:, column] - start[column]), color=PRINTED, label="eq. (16)")
        axis.set_ylabel(text)
        axis.grid(alpha=0.3)
    axes[1].set_xlabel("time [s]")
    _legend(figure, axes[0])
    return figure


def _hand_in_plane(runs: Experiments) -> plt.Figure:
    figure, axis = plt.subplots(figsize=(7.0, 6.0), layout="constrained")
    start = runs.recursive.hand_target[0]
    trace = runs.recursive
    axis.plot(*(CM * (trace.hand_target - start)[:, 1:]).T, color=DESIRED, label="desired")
    text = f"recursive projector, {1e3 * trace.hand_rms:.3f} mm RMS"
    axis.plot(*(CM * (trace.hand - start)[:, 1:]).T, "--", color=ACTUAL, label=text)
    text = f"eq. (16) as printed, {1e3 * runs.printed.hand_rms:.0f} mm RMS"
    axis.plot(*(CM * (runs.printed.hand - start)[:, 1:]).T, color=PRINTED, label=text)
    axis.set(xlabel="left-right [cm]", ylabel="up-down [cm]", aspect="equal", title=f"gain {GAIN:g}/s, feedforward")
    axis.grid(alpha=0.3)
    axis.legend(loc="upper center", bbox_to_anchor=(0.5, -0.15))
    return figure


def _cog_during_hand(runs: Experiments) -> plt.Figure:
    figure, axes = _axes(2)
    for axis, column, text in zip(axes, (1, 0), ("left-right [um]", "front-back [um]"), strict=True):
        for trace, color, label in (
            (runs.recursive, ACTUAL, "recursive projector"),
            (runs.printed, PRINTED, "eq. (16)"),
        ):
            axis.plot(trace.t, 1e6 * (trace.com - trace.com_target)[:, column], color=color, label=label)
        axis.axhline(0.0, color=DESIRED, label="desired")
        axis.set_ylabel(text)
        axis.grid(alpha=0.3)
    axes[1].set_xlabel("time [s]")
    _legend(figure, axes[0])
    return figure
