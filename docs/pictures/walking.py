"""Talos walks and is pushed: a film, a strip of stills, and curves of the same run."""

from __future__ import annotations

import math
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any

import numpy as np
from PIL import Image, ImageDraw

import hqp
from hqp.robots.on_mujoco import Plane
from hqp.walking import Walker
from hqp.walking.course import Course

from .moving import FPS, save
from .studio import BLUE, FONTS, GREEN, INK, ORANGE, Studio, caption, font

FIGURES = Path(__file__).parents[1] / "figures"
SIZE, DT = (420, 420), 0.002
BAND = 46
"""Height of a frame's caption [px]."""
START, PUSH, STOP, END = 0.5, 3.1, 6.0, 8.5
"""Times of the start, the push, the stop, and the end of the film [s]."""
IMPULSE, BLOW = 0.2, 0.1
"""Impulse over mass, to the left [m/s], and its duration [s]."""


@dataclass
class Run:
    """Data of a walk's pictures."""

    robot: Any
    walker: Walker
    frames: list[tuple[Any, ...]] = field(default_factory=list)
    rows: list[tuple[float, ...]] = field(default_factory=list)


def walked(name: str = "talos", speed: float = 0.2) -> Run:
    """The run, on estimated states."""
    robot = hqp.robots.load(name, rotors=True)
    course = Course(
        Walker(robot, dt=DT, deadline=math.inf), terrain=Plane(friction=0.5)
    )
    run, plant, walker = Run(robot, course.walker), course.plant, course.walker
    force = [0.0, IMPULSE * robot.mass / BLOW, 0.0]
    for k in range(round(END / DT)):
        t = k * DT
        if k == round(START / DT):
            walker.go(speed)
        if k == round(STOP / DT):
            walker.stop()
        pushed = PUSH <= t < PUSH + BLOW
        course.step(force if pushed else None)
        if course.fallen:
            raise RuntimeError(f"{name} fell at {t:.2f} s")
        zmp, dcm = walker._dcm.at(walker._since)
        loads = plant.contacts().load
        com, xi = plant.com(), walker.capture_point
        run.rows.append((t, *com[:2], *xi, *zmp, *dcm, *loads))
        if k % round(1.0 / (FPS * DT)) == 0:
            run.frames.append(
                (t, plant.state()[0], xi.copy(), zmp.copy(), walker.phase, pushed)
            )
    return run


def pictures(run: Run) -> list[Image.Image]:
    """Each frame with the capture point, the planned ZMP and the push."""
    studio, shown = Studio(run.robot, SIZE, azimuth=140.0, elevation=-14.0), []
    height = float(studio.camera.lookat[2])
    for t, q, xi, zmp, phase, pushed in run.frames:
        studio.camera.lookat = np.array([q[0], 0.0, height])
        studio.ball(np.array([*xi, 0.01]), BLUE, 0.025)
        studio.ball(np.array([*zmp, 0.01]), GREEN, 0.02)
        if pushed or PUSH <= t < PUSH + 0.3:
            studio.arrow(q[:3] - [0.0, 0.6, 0.0], q[:3] - [0.0, 0.15, 0.0], ORANGE)
        away = PUSH <= t < PUSH + 1.5
        title = "pushed: 0.2 m/s of its mass" if away else f"Talos, {phase}"
        text = (
            "the next foot lands further out"
            if away
            else "capture point blue, ZMP green"
        )
        shown.append(caption(studio.shoot(q), title, text, ORANGE if away else GREEN))
    return shown


def strip(shown: list[Image.Image], run: Run, path: Path) -> Path:
    """Stills side by side, from shortly before the push."""
    times = [frame[0] for frame in run.frames]
    chosen = [
        (after, shown[int(np.searchsorted(times, PUSH + after))])
        for after in (-0.4, 0.1, 0.5, 0.9, 1.5)
    ]
    width, height = SIZE[0] // 2, SIZE[1] // 2
    sheet = Image.new("RGB", (width * len(chosen), height), "white")
    draw = ImageDraw.Draw(sheet)
    for k, (after, image) in enumerate(chosen):
        below = image.crop(
            (0, BAND, *SIZE)
        )  # without the film's caption, too small here
        sheet.paste(below.resize((width, height - BAND // 2)), (k * width, BAND // 2))
        said = "push" if 0.0 <= after <= BLOW else f"{after:+.1f} s"
        draw.text((k * width + 8, 2), said, font=font(FONTS[0], 15), fill=INK)
    sheet.convert("P", palette=Image.Palette.ADAPTIVE).save(path)
    return path


def curves(run: Run, path: Path) -> Path:
    """Sideways and ahead: CoM, capture point, planned ZMP and DCM; below the loads of the feet."""
    from matplotlib.figure import Figure

    rows = np.array(run.rows)
    figure = Figure(figsize=(8.0, 7.0), layout="constrained")
    axes = figure.subplots(3, 1, sharex=True)
    for axis, k, name in ((axes[0], 2, "sideways [m]"), (axes[1], 1, "ahead [m]")):
        for column, label, style in ((k, "CoM", "-"), (k + 2, "capture point", "-"), (k + 4, "ZMP planned", "--"),
                                     (k + 6, "DCM planned", ":")):  # fmt: skip
            axis.plot(rows[:, 0], rows[:, column], style, label=label, linewidth=1.0)
        axis.set_ylabel(name)
        axis.axvspan(PUSH, PUSH + BLOW, color="tab:orange", alpha=0.3)
    axes[0].legend(loc="upper right", ncols=4, fontsize=8)
    axes[2].plot(rows[:, 0], rows[:, 9:], linewidth=0.8, label=("left", "right"))
    axes[2].set_ylabel("load of a foot [N]")
    axes[2].set_xlabel("time [s]")
    axes[2].legend(loc="upper right", fontsize=8)
    figure.savefig(path, dpi=90)
    return path


def made() -> list[Path]:
    """Film, strip and curves in docs/figures."""
    run = walked()
    paths = [curves(run, FIGURES / "walk_talos.png")]
    shown = pictures(run)
    return [
        *paths,
        save(shown, FIGURES / "walk_talos.webp"),
        strip(shown, run, FIGURES / "walk_talos_strip.png"),
    ]


if __name__ == "__main__":
    for one in made():
        print(one, one.stat().st_size)
