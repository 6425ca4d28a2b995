"""A page in headless Chromium, as for a visitor."""

from __future__ import annotations

import io
import os
import shutil
from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from PIL import Image

CHROMIUM = os.environ.get("HQP_CHROMIUM") or shutil.which("chromium") or shutil.which("google-chrome")
FLAGS = ("--no-sandbox", "--use-angle=swiftshader", "--use-gl=angle", "--enable-unsafe-swiftshader")
SHOTS = Path(os.environ.get("HQP_SHOTS", "build/screenshots"))
WIDTH, HEIGHT = 1500, 900
SCENE = (slice(310, HEIGHT), slice(0, 1100))
"""Rows and columns of the picture between the cards and the panel."""

UP = np.array([54, 142, 226])
"""Colour of a handle's arrow along z in viser."""


@contextmanager
def tab_at(url: str, text: str = "Time of a tick", still: bool = True) -> Iterator[Any]:
    """Yield the page once it shows the text and, if it stands still, the scene is drawn."""
    api = pytest.importorskip("playwright.sync_api")
    if CHROMIUM is None:
        pytest.skip("no Chromium: apt-get install --no-install-recommends chromium, or set HQP_CHROMIUM")
    with api.sync_playwright() as playwright:
        browser = playwright.chromium.launch(executable_path=CHROMIUM, args=list(FLAGS))
        tab = browser.new_page(viewport={"width": WIDTH, "height": HEIGHT})
        tab.goto(url)
        tab.wait_for_selector(f"text={text}", timeout=90_000)
        if still:
            settle(tab)
        yield tab
        browser.close()


def settle(tab: Any) -> None:
    """Wait until the scene is drawn by the software renderer and stands still."""
    before, same = picture(tab)[SCENE], 0
    for _ in range(40):
        tab.wait_for_timeout(1_500)
        now = picture(tab)[SCENE]
        same = same + 1 if np.mean(abs(now - before).sum(axis=2) > 60) < 1e-4 else 0
        before = now
        if same == 3:
            return


def picture(tab: Any) -> Any:
    """Pixels ``(rows, columns, 3)`` of the page as it is."""
    return np.asarray(Image.open(io.BytesIO(tab.screenshot(timeout=120_000))).convert("RGB")).astype(int)


def shoot(tab: Any, name: str) -> None:
    """Keep a screenshot."""
    SHOTS.mkdir(parents=True, exist_ok=True)
    tab.screenshot(path=str(SHOTS / f"{name}.png"), timeout=120_000)


def wait_for(tab: Any, text: str) -> None:
    """Wait until the page shows a text."""
    tab.wait_for_selector(f"text={text}", timeout=60_000)


def arrow(tab: Any, still: bool = True) -> tuple[int, int]:
    """Column and row of a pixel near the tip of the highest arrow along z; still: once the scene stands still."""
    if still:
        settle(tab)
    scene = picture(tab)[SCENE]
    rows, columns = np.nonzero(abs(scene - UP).sum(axis=2) < 40)
    assert rows.size > 20, "no handle to be seen"
    top = rows.min()
    return int(np.median(columns[rows < top + 14])), int(top) + SCENE[0].start + 10


def drag(tab: Any, x: int, y: int, right: int, down: int) -> None:
    """Drag the object at a pixel."""
    tab.mouse.move(x, y)
    tab.mouse.down()
    for k in range(1, 12):
        tab.mouse.move(x + right * k / 11, y + down * k / 11)
        tab.wait_for_timeout(80)
    tab.mouse.up()
