"""The viewer on the shipped example, each picture by its target; needs the extra ``browser`` and Chromium.

The loop ends before the browser starts, which renders in software, so that other work of the machine delays none of
the last ticks, which the picture shows.
"""

from __future__ import annotations

import io
import math
import os
import shutil
import time
from contextlib import suppress
from dataclasses import astuple
from pathlib import Path
from typing import Any

import numpy as np
from PIL import Image

import hqp
from hqp import Level, Stack, serial
from hqp.tasks import CollisionAvoidance
from hqp.viewer import View

FIGURES = Path(__file__).parents[1] / "figures"
EXAMPLE = Path(__file__).parents[2] / "examples" / "g1.toml"
DT = 0.002
TICKS, CURVES = 15_000, 5_500
"""Ticks until the hand is at rest; ticks of the page's curves."""
HIDDEN = "[class*=Notification] { display: none }"
"""Style that hides viser's note on a browser that renders in software."""
SIZE = {"width": 1500, "height": 900}
SCENE = {"x": 0, "y": 330, "width": 1050, "height": 560}
FLAGS = (
    "--no-sandbox",
    "--use-angle=swiftshader",
    "--use-gl=angle",
    "--enable-unsafe-swiftshader",
)

PICTURES: dict[str, tuple[tuple[float, float, float], bool]] = {
    "reached": ((0.12, 0.05, 0.15), False),
    "out_of_reach": ((0.1, -0.7, 0.5), False),
    "at_a_limit": ((-0.5, 0.0, 0.2), False),
    "in_collision": ((-0.05, 0.2, -0.05), True),
}
"""Target of the hand from its place at home [m]; true for collision avoidance in a level above it."""


def show(way: tuple[float, float, float], apart: bool) -> View:
    """The example's page after a loop with a target."""
    stack, robot = serial.load(EXAMPLE), hqp.robots.load("g1")
    if apart:
        first, *others = stack.levels
        stack = Stack(
            first,
            Level(CollisionAvoidance(), name="safety"),
            *others,
            subject_to=stack.subject_to,
        )
    hand = stack.find("right_hand")
    q, v = robot.home.copy(), np.zeros(robot.nv)
    goal = hand.at(hand.value(robot.state()) + np.array(way))  # type: ignore[attr-defined]
    session = hqp.Controller(stack, deadline=math.inf).session(robot, DT)
    view = hqp.view(session, control=True)
    own = os.getpriority(os.PRIO_PROCESS, 0)
    with suppress(PermissionError):
        os.nice(-15)
    due, ticks, in_time = time.perf_counter(), 0, 0
    while ticks < TICKS or in_time < CURVES:
        tick = view.step(robot.state(q, v), goal)
        q, v = tick.advance()
        ticks += 1
        in_time = in_time + 1 if sum(astuple(tick.times)) < DT else 0
        due = max(due + DT, time.perf_counter())
        time.sleep(max(0.0, due - time.perf_counter()))
    os.setpriority(os.PRIO_PROCESS, 0, own)
    return view


def settle(tab: Any) -> None:
    """Wait until the scene has faded in: with a software renderer, a minute or more."""
    before, same = np.zeros(0), 0
    for _ in range(60):
        tab.wait_for_timeout(2_000)
        shot = tab.screenshot(clip=SCENE, timeout=120_000)
        now = np.asarray(Image.open(io.BytesIO(shot)).convert("L"), dtype=float)
        still = before.shape == now.shape and np.mean(abs(now - before) > 2.0) < 1e-3
        before, same = now, same + 1 if still else 0
        if same == 3:
            return


def shoot(playwright: Any, name: str) -> Path:
    """One picture of the hand at rest."""
    path = FIGURES / f"view_{name}.png"
    chromium = (
        os.environ.get("HQP_CHROMIUM")
        or shutil.which("chromium")
        or shutil.which("google-chrome")
    )
    with show(*PICTURES[name]) as view:
        browser = playwright.chromium.launch(executable_path=chromium, args=list(FLAGS))
        tab = browser.new_page(viewport=SIZE)
        tab.goto(view.url)
        tab.wait_for_selector("text=Time of a tick", timeout=300_000)
        tab.add_style_tag(content=HIDDEN)
        settle(tab)
        tab.screenshot(path=str(path), timeout=120_000)
        browser.close()
    return path


def save(names: set[str]) -> list[Path]:
    """Make pictures by name, all if there is no name; return their files."""
    from playwright.sync_api import sync_playwright

    with sync_playwright() as playwright:
        return [
            shoot(playwright, name) for name in PICTURES if not names or name in names
        ]


if __name__ == "__main__":
    import sys

    print(*save(set(sys.argv[1:])), sep="\n")
