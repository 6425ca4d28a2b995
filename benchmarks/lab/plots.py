"""Curves of the experiments: the counterparts of Mistry 2008, Figs. 6 to 9, and Sentis 2012, Figs. 3 and 5."""

from __future__ import annotations

import math
from pathlib import Path
from typing import TYPE_CHECKING, Any

import matplotlib

matplotlib.use("Agg")

import matplotlib.pyplot as plt
import numpy as np

if TYPE_CHECKING:
    from benchmarks.mistry2008.experiments.balance import Balance
    from benchmarks.sentis2012.experiments.dreamer_run import Outing

GOAL, ACTUAL, OTHER = "0.7", "#0072b2", "#d55e00"
"""Colours that differ in grey and for colour-blind readers; the reference is a wide band under the measured curve."""
BAND: dict[str, Any] = {"color": GOAL, "linewidth": 5.0, "solid_capstyle": "round"}
DASHED = (0, (4, 1.5))
CM, MM = 100.0, 1000.0

Files = list[tuple[str, Path]]


def _save(figure: plt.Figure, output: Path, stem: str, caption: str, dpi: float = 100.0) -> Files:
    output.mkdir(parents=True, exist_ok=True)
    path = output / f"{stem}.png"
    figure.savefig(path, dpi=dpi)
    plt.close(figure)
    return [(caption, path)]


def _axes(rows: int, height: float, width: float = 8.0) -> tuple[plt.Figure, np.ndarray]:
    figure, axes = plt.subplots(rows, 1, figsize=(width, height), sharex=True, layout="constrained", squeeze=False)
    for axis in axes[:, 0]:
        axis.grid(alpha=0.3)
    return figure, axes[:, 0]


def _legend_below(figure: plt.Figure, axis: plt.Axes) -> None:
    """One legend for all axes, below them."""
    figure.legend(*axis.get_legend_handles_labels(), loc="outside lower center", ncols=3, fontsize="small")


def cog_in_time(output: Path, steady: Balance, lagging: Balance) -> Files:
    """Fig. 6: CoG left-right and front-back, desired, with feedforward and without, the last 15 s."""
    figure, (side, front) = _axes(2, 5.0)
    for axis, column, middle in ((side, 1, steady.goal[1]), (front, 0, steady.goal[0])):
        last = steady.log["t"] > steady.log["t"][-1] - 15.0
        t = steady.log["t"][last]
        axis.plot(t, CM * (steady.log["com_goal"][last, column] - middle), **BAND, label="desired")
        axis.plot(t, CM * (steady.log["com"][last, column] - middle), color=ACTUAL, label="actual")
        last = lagging.log["t"] > lagging.log["t"][-1] - 15.0
        other = CM * (lagging.log["com"][last, column] - middle)
        axis.plot(lagging.log["t"][last], other, linestyle=DASHED, color=OTHER, label="actual, no feedforward")
    side.set(ylabel="left-right [cm]", title="CoG of CBi in simulation (compare Mistry 2008, Fig. 6)")
    front.set(ylabel="front-back [cm]", xlabel="time [s]", ylim=(-2.0, 2.0))
    _legend_below(figure, side)
    return _save(figure, output, "cbi_cog", "CoG from side to side (Fig. 6)")


def hand_in_time(output: Path, strict: Balance, printed: Balance) -> Files:
    """Fig. 7: the hand's coordinates over time."""
    figure, axes = _axes(2, 5.0)
    middle = strict.log["hand_goal"][0]
    for axis, column, text in zip(axes, (1, 2), ("left-right [cm]", "up-down [cm]"), strict=True):
        axis.plot(strict.log["t"], CM * (strict.log["hand_goal"] - middle)[:, column], **BAND, label="desired")
        axis.plot(strict.log["t"], CM * (strict.log["hand"] - middle)[:, column], color=ACTUAL, label="strict")
        hand = CM * (printed.log["hand"] - middle)[:, column]
        axis.plot(printed.log["t"], hand, linestyle=DASHED, color=OTHER, label="eq. (16) as printed")
        axis.set_ylabel(text)
    axes[0].set_title("Right hand on a figure-8 (compare Mistry 2008, Fig. 7)")
    axes[1].set_xlabel("time [s]")
    _legend_below(figure, axes[0])
    return _save(figure, output, "cbi_hand_in_time", "right hand over time (Fig. 7)")


def hand_in_plane(output: Path, strict: Balance, printed: Balance) -> Files:
    """Fig. 8: the hand in the frontal plane."""
    figure, axis = plt.subplots(figsize=(7.0, 4.6), layout="constrained")
    axis.grid(alpha=0.3)
    middle = strict.log["hand_goal"][0]
    for log, key, style, text in (
        (strict.log, "hand_goal", BAND, "desired"),
        (strict.log, "hand", {"color": ACTUAL}, "strict priority"),
        (printed.log, "hand", {"color": OTHER, "linestyle": DASHED}, "eq. (16) as printed, k = 2/s"),
    ):
        axis.plot(*(CM * (log[key] - middle)[:, 1:]).T, **style, label=text)
    axis.set(xlabel="left-right [cm]", ylabel="up-down [cm]", aspect="equal")
    axis.set_title("Right hand in the frontal plane (compare Mistry 2008, Fig. 8)")
    axis.legend(loc="upper center", bbox_to_anchor=(0.5, -0.13), ncols=3, fontsize="small")
    return _save(figure, output, "cbi_hand_in_plane", "right hand in the plane (Fig. 8)")


def cog_during_hand(output: Path, strict: Balance, printed: Balance) -> Files:
    """Fig. 9: the CoG while the hand draws."""
    figure, axes = _axes(2, 4.6)
    for axis, column, text in zip(axes, (1, 0), ("left-right [mm]", "front-back [mm]"), strict=True):
        axis.axhline(0.0, **BAND, label="desired")
        for run, color, style, label in (
            (strict, ACTUAL, "-", "strict"), (printed, OTHER, DASHED, "eq. (16) as printed")
        ):  # fmt: skip
            error = MM * (run.log["com"][:, :2] - run.log["com_goal"])[:, column]
            axis.plot(run.log["t"], error, color=color, linestyle=style, label=label)
        axis.set(ylabel=text, ylim=(-0.6, 0.6))
    axes[0].set_title("CoG during the figure-8 (compare Mistry 2008, Fig. 9)")
    axes[1].set_xlabel("time [s]")
    _legend_below(figure, axes[0])
    return _save(figure, output, "cbi_cog_during_hand", "CoG during the figure-8 (Fig. 9)")


def switch(output: Path, run: Balance) -> Files:
    """Contact switching: CoG, lifted foot, loads, commanded joint velocities."""
    log, (com, foot, load, rate) = run.log, (*_axes(4, 8.0)[1],)
    t = log["t"]
    for column, text, color in ((1, "left-right", ACTUAL), (0, "front-back", OTHER)):
        com.plot(t, MM * (log["com"][:, column] - log["com_goal"][:, column]), color=color, label=text)
    com.set(ylabel="CoG error [mm]", title="Right foot lifted for 5 s: the stack changes at the dashed lines")
    foot.plot(t, MM * log["lift_goal"], **BAND, label="desired")
    foot.plot(t, MM * log["lift"], color=ACTUAL, label="actual")
    foot.set_ylabel("right foot [mm]")
    for k, (text, color, style) in enumerate((("left", ACTUAL, "-"), ("right", OTHER, DASHED))):
        load.plot(t, log["load"][:, k], color=color, linestyle=style, label=text)
    load.set_ylabel("load [N]")
    rate.plot(t, np.abs(log["command"]).max(axis=1), color=ACTUAL)
    rate.set(ylabel="fastest joint [rad/s]", xlabel="time [s]")
    for axis in (com, foot, load):
        axis.legend(loc="best", ncols=2, fontsize="small")
    for k in np.flatnonzero(np.diff(log["aloft"])):
        for axis in (com, foot, load, rate):
            axis.axvline(t[k + 1], color="0.4", linestyle="--", linewidth=0.8)
    return _save(com.figure, output, "cbi_switch", "switching contacts")


def slope_panels(output: Path, run: Outing) -> Files:
    """Fig. 5 (D) to (G) for the run on rollers, on the robot's own sensing."""
    title = "Dreamer on rollers, by IMU and odometry, 7 degrees (compare Sentis 2012, Fig. 5)"
    return _panels(run, output, "dreamer_slope", title)


def staged_panels(output: Path, run: Outing) -> Files:
    """Fig. 5 with the paper's timeline and its instants in words."""
    return _panels(
        run, output, "dreamer_staged", "The paper's timeline, privileged normals (compare Sentis 2012, Fig. 5)"
    )


def tilt_panels(output: Path, run: Outing) -> Files:
    """Fig. 3: tilt, CoM error and hip while the base is tilted by hand."""
    figure, (tilt, com, hip) = _axes(3, 5.6)
    log = run.log
    tilt.plot(log["t"], np.degrees(log["base"][:, 4]), color=ACTUAL)
    tilt.set(ylabel="base tilt [deg]", title="Base tilted by hand (compare Sentis 2012, Fig. 3)")
    com.plot(log["t"], MM * np.linalg.norm(log["com"], axis=1), color=ACTUAL)
    com.set_ylabel("CoM error [mm]")
    for k, joint, color, style in ((1, "hip", ACTUAL, "-"), (5, "elbow", OTHER, DASHED)):
        hip.plot(log["t"], np.degrees(log["posture"][:, k]), color=color, linestyle=style, label=joint)
    hip.set(ylabel="from posture [deg]", xlabel="time [s]")
    hip.legend(fontsize="small")
    return _save(figure, output, "dreamer_tilt", "base tilted by hand (Fig. 3)")


def _panels(run: Outing, output: Path, stem: str, title: str) -> Files:
    figure, (com, hand, posture, base, speed, pull, load) = _axes(7, 9.0, 6.0)  # few inches: its many labels stay large
    log, scene = run.log, run.scene
    t = log["t"]
    com.plot(t, MM * np.linalg.norm(log["com"], axis=1), color=ACTUAL)
    com.axhline(10.0, color="0.3", linestyle=":", label="the paper's 1 cm")
    com.set(ylabel="CoM error [mm]", title=title.replace(" (", "\n("), ylim=(0.0, None))
    hand.plot(t, MM * np.linalg.norm(log["hand"], axis=1), color=ACTUAL)
    hand.set_ylabel("hand error [mm]")
    posture.plot(t, np.degrees(np.linalg.norm(log["posture"], axis=1)), color=ACTUAL)
    posture.set_ylabel("posture error,\nnorm [deg]")
    base.plot(t, np.degrees(log["base"][:, 4]), color=ACTUAL)
    base.set_ylabel("tilt of the\nbase [deg]")
    speed.plot(t, log["velocity"][:, 0], color=ACTUAL)
    speed.set_ylabel("speed of the\nbase [m/s]")
    pull.plot(t, log["pull"][:, 0], color=ACTUAL)
    pull.set_ylabel("pull of the\nhuman [N]")
    load.plot(t, log["load"].min(axis=1), color=ACTUAL)
    load.set(ylabel="least wheel\nload [N]", xlabel="time [s]")
    com.legend(loc="upper right", fontsize="small")
    instants = [*scene.enable] if scene.enable[1] > 0.0 else []
    on_ramp = np.flatnonzero((log["base"][:, 4] > math.radians(0.3)) & (t > scene.walk.start))
    marks = [*instants, *([t[on_ramp[0]]] if on_ramp.size else [])]
    words = ("upper body on", "base on", "onto the ramp")
    for axis in (com, hand, posture, base, speed, pull, load):
        for k, (text, when) in enumerate(zip(words[0 if instants else 2 :], marks, strict=False)):
            axis.axvline(when, color="0.3", linestyle="--", linewidth=0.8)
            if axis is com:
                place = (when, 0.8 - 0.2 * k)  # one below the other: two instants may be close
                axis.annotate(f" {text}", place, xycoords=("data", "axes fraction"))
    return _save(figure, output, stem, title, dpi=135.0)
