"""The moving pictures of the README: G1 after a target that leaves its reach, Dreamer pulled up a slope."""

from __future__ import annotations

import math
import subprocess
import sys
import tempfile
from collections.abc import Iterator
from pathlib import Path
from typing import Any

import numpy as np
from PIL import Image

import hqp
from hqp import Level, P, Stack
from hqp.arrays import Mat
from hqp.robots.soles import sole_points
from hqp.tasks import Com, FixedContact, JointLimits, Orientation, Position, Posture
from hqp.viewer.meshes import hull

from .studio import BLUE, GREEN, ORANGE, Studio, caption

FIGURES = Path(__file__).parents[1] / "figures"
SIZE, FPS, DT = (560, 560), 12, 0.002
LOOK = np.array([0.15, 0.0, 0.81])
FEWEST = 1_900_000
"""Largest size of a moving picture [bytes]."""


def g1(path: Path = FIGURES / "g1.webp") -> Path:
    """The right hand follows a ball out of reach and back; feet and balance hold."""
    robot = hqp.robots.load("g1")
    feet = [FixedContact(frame=sole) for sole in robot.landmarks["soles"]]
    hand = Position(frame="right_wrist_yaw_link", law=P(8.0), name="hand")
    stack = Stack(
        Level(*feet, Com(axes="xy", law=P(2.0)), name="balance"),
        Level(hand, name="hand"),
        Level(Orientation(frame="pelvis", law=P(2.0)), name="pelvis"),
        Level(Posture(law=P(1.0)), name="posture"),
        subject_to=[JointLimits()],
    )
    session = hqp.Controller(stack, deadline=math.inf).session(robot, DT)
    studio = Studio(
        robot, SIZE, look=LOOK, distance=1.9, azimuth=128.0, elevation=-16.0
    )
    q, v = robot.home.copy(), np.zeros(robot.nv)
    state = robot.state(q)
    start = state.position(hand.frame)
    soles = np.vstack([_sole(state, frame) for frame in robot.landmarks["soles"]])
    support = np.insert(hull(soles[:, :2]), 2, 0.005, axis=1)
    frames = []
    for k in range(round(9.0 / DT)):
        goal = start + _way(k * DT)
        state = robot.state(q, v)
        tick = session.step(state, hand.at(goal))
        if k % round(1.0 / (FPS * DT)) == 0:
            here = state.position(hand.frame)
            off = float(np.linalg.norm(goal - here))
            far = off > 0.06
            studio.ball(goal, ORANGE if far else GREEN)
            studio.line(here, goal, ORANGE)
            studio.outline(support, GREEN)
            com = state.com()
            studio.ball(np.array([com[0], com[1], 0.005]), BLUE, 0.025)
            title = f"hand: {100.0 * off:.0f} cm from its target"
            text = (
                "feet, balance and limits hold; the hand gives way"
                if far
                else "every level above it holds"
            )
            frames.append(
                caption(studio.shoot(q), title, text, ORANGE if far else GREEN)
            )
        q, v = tick.advance()
    return save(frames, path)


def _sole(state: Any, frame: str) -> Mat:
    """Corners of a sole ``(n, 3)`` [m]."""
    corners = np.array(sole_points(state.robot, frame))
    return corners @ state.rotation(frame).T + state.position(frame)


def _way(t: float) -> np.ndarray:
    """A loop within reach, 55 cm ahead and back, within 9 s."""
    out = 0.5 - 0.5 * math.cos(2.0 * math.pi * min(max((t - 3.0) / 5.5, 0.0), 1.0))
    loop = 0.1 * np.array(
        [
            0.4,
            math.sin(2.0 * math.pi * t / 3.0),
            1.2 - 1.2 * math.cos(2.0 * math.pi * t / 3.0),
        ]
    )
    return (
        loop * (1.0 - out) + out * np.array([0.55, -0.1, 0.35])
        if t < 8.5
        else loop * 0.0
    )


def dreamer(path: Path = FIGURES / "dreamer.webp") -> Path:
    """The experiment of docs/results/dreamer.md, filmed by the benchmarks."""
    with tempfile.TemporaryDirectory() as folder:
        command = [sys.executable, "-m", "benchmarks", "experiments", "dreamer-slope"]
        command += ["--quick", "--video", "--output", folder]
        subprocess.run(command, check=True, cwd=Path(__file__).parents[2])
        return save(list(_film(Path(folder))), path)


def _film(folder: Path) -> Iterator[Image.Image]:
    """Every third frame, with the CoM error at its time."""
    import imageio_ffmpeg

    log = np.load(folder / "dreamer-slope_own_map.npz")
    frames = imageio_ffmpeg.read_frames(str(folder / "dreamer-slope.mp4"))
    about = next(frames)
    width, height = about["size"]
    for k, frame in enumerate(frames):
        if k % 3 == 0:
            picture = Image.frombytes("RGB", (width, height), frame)
            picture = picture.resize((round(width * SIZE[1] / height), SIZE[1]))
            row = min(np.searchsorted(log["t"], k / about["fps"]), len(log["t"]) - 1)
            off = 1e3 * float(np.linalg.norm(log["com"][row]))
            title = f"centre of mass: {off:.1f} mm off"
            yield caption(picture, title, "7 degrees, by IMU and odometry", GREEN)


def save(frames: list[Image.Image], path: Path) -> Path:
    """An animated WebP under FEWEST bytes; raises ValueError if no quality is small enough."""
    for quality in (70, 55, 40, 25):
        frames[0].save(path, save_all=True, append_images=frames[1:], duration=round(1000 / FPS), loop=0,
                       quality=quality, method=4)  # fmt: skip
        if path.stat().st_size < FEWEST:
            return path
    raise ValueError(f"{path}: {path.stat().st_size} bytes")


if __name__ == "__main__":
    for made in (g1(), dreamer()):
        print(made, made.stat().st_size)
