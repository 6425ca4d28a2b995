"""Joint commands of one scene, exact beside priced."""

from __future__ import annotations

from collections.abc import Mapping
from pathlib import Path

import matplotlib

matplotlib.use("Agg")

import matplotlib.pyplot as plt
import numpy as np

from tests.scenes.calm.loop import Run
from tests.scenes.calm.scenes import DT

UNITS = {
    "velocity": ("joint velocity", "rad/s"),
    "acceleration": ("joint acceleration", "rad/s²"),
    "torque": ("torque", "N m"),
}
COLOURS = ("#0072b2", "#e69f00", "#000000", "#d55e00", "#56b4e9", "#cc79a7")
"""Apart for every kind of eye (Okabe and Ito 2008)."""


def commands(runs: Mapping[str, Run], path: Path) -> Path:
    """One panel a variant, on one scale; the six joints that move most are named."""
    scene = next(iter(runs.values())).scene
    names, (quantity, unit) = scene.subject.robot.joint_names, UNITS[scene.formulation]
    figure, axes = plt.subplots(
        1, len(runs), figsize=(5.2 * len(runs), 3.6), sharex=True, sharey=True, layout="constrained", squeeze=False
    )
    last = list(runs.values())[-1].commands
    busiest = np.argsort(-np.abs(last - last.mean(axis=0)).max(axis=0))[:6]
    for axis, (label, run) in zip(axes[0], runs.items(), strict=True):
        t = DT * np.arange(run.commands.shape[0])
        others = np.setdiff1d(np.arange(run.commands.shape[1]), busiest)
        axis.plot(t, run.commands[:, others], color="0.8", linewidth=0.5)
        for j, colour in zip(busiest, COLOURS, strict=False):
            axis.plot(t, run.commands[:, j], color=colour, linewidth=0.9, label=names[j])
        jump = np.abs(np.diff(run.commands, axis=0)).max()
        axis.set(title=f"{label}: largest change in a tick {jump:.2g} {unit}", xlabel="time [s]")
        axis.grid(alpha=0.3)
    axes[0, 0].set_ylabel(f"{quantity} [{unit}]")
    figure.suptitle(f"{scene.subject.robot.name}, hand's target: {scene.name}")
    handles, labels = axes[0, -1].get_legend_handles_labels()
    figure.legend(handles, labels, loc="outside lower center", ncols=3, fontsize="small")
    path.parent.mkdir(parents=True, exist_ok=True)
    figure.savefig(path, dpi=100)
    plt.close(figure)
    return path
