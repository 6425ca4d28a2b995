"""A contact sheet: pictures side by side, with the CoM over its support from above in a corner."""

from __future__ import annotations

from collections.abc import Sequence
from pathlib import Path
from typing import Any

import matplotlib

matplotlib.use("Agg")

import matplotlib.pyplot as plt
import numpy as np

from benchmarks.lab.overlay import Support


def compose(images: Sequence[tuple[str, Any, Support]], columns: int, path: Path) -> Path:
    """Lay out captioned images ``(h, w, 3)`` with their supports from above."""
    rows = -(-len(images) // columns)
    height, width = images[0][1].shape[:2]
    figure, axes = plt.subplots(
        rows, columns, figsize=(3.4 * columns, 3.4 * rows * height / width + 0.3 * rows), squeeze=False,
        layout="constrained",
    )  # fmt: skip
    for axis in axes.flat:
        axis.axis("off")
    for axis, (caption, image, support) in zip(axes.flat, images, strict=False):
        axis.imshow(image, interpolation="antialiased")
        axis.set_title(caption, fontsize=11)
        _inset(axis, support)
    path.parent.mkdir(parents=True, exist_ok=True)
    figure.savefig(path, dpi=110, pil_kwargs={"optimize": True})
    plt.close(figure)
    return path


def _inset(axis: plt.Axes, support: Support) -> None:
    """Seen from above, ahead is up."""
    inset = axis.inset_axes((0.02, 0.67, 0.31, 0.31))
    for polygon in support.polygons:
        closed = np.vstack((polygon, polygon[:1]))
        inset.fill(-closed[:, 1], closed[:, 0], color="tab:green", alpha=0.25)
        inset.plot(-closed[:, 1], closed[:, 0], color="tab:green", linewidth=1.0)
    inset.plot(-support.goal[1], support.goal[0], "+", color="black", markersize=11, markeredgewidth=2)
    inset.plot(-support.com[1], support.com[0], "o", color="tab:red", markersize=5)
    middle = np.vstack(support.polygons).mean(axis=0) if support.polygons else support.com
    half = 0.3
    inset.set(aspect="equal", xticks=[], yticks=[], facecolor="white")
    inset.set(xlim=(-middle[1] - half, -middle[1] + half), ylim=(middle[0] - half, middle[0] + half))
    error = 1e3 * float(np.linalg.norm(support.com - support.goal))
    inset.text(0.5, 0.04, f"CoM off {error:.1f} mm", fontsize=8, ha="center", transform=inset.transAxes)
