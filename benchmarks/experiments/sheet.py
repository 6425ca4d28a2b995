"""A contact sheet: pictures side by side, with the CoM over its support from above in a corner."""

from __future__ import annotations

from collections.abc import Sequence
from pathlib import Path
from typing import Any

import matplotlib

matplotlib.use("Agg")

import matplotlib.pyplot as plt
import numpy as np

from benchmarks.experiments.overlay import Support


def compose(images: Sequence[tuple[str, Any, Support | None]], columns: int, path: Path) -> Path:
    """Lay out captioned images ``(h, w, 3)``, each with its support from above where there is one."""
    rows = -(-len(images) // columns)
    height, width = images[0][1].shape[:2]
    figure, axes = plt.subplots(
        rows, columns, figsize=(2.6 * columns, 2.6 * rows * height / width + 0.25 * rows), squeeze=False,
        layout="constrained",
    )  # fmt: skip
    for axis in axes.flat:
        axis.axis("off")
    for axis, (caption, image, support) in zip(axes.flat, images, strict=False):
        axis.imshow(image, interpolation="antialiased")
        axis.set_title(caption, fontsize=9)
        if support is not None:
            _inset(axis, support)
    path.parent.mkdir(parents=True, exist_ok=True)
    figure.savefig(path, dpi=110, pil_kwargs={"optimize": True})
    plt.close(figure)
    _shrink(path)
    return path


def _inset(axis: plt.Axes, support: Support) -> None:
    inset = axis.inset_axes((0.02, 0.70, 0.30, 0.28))
    triangle = np.vstack((support.points, support.points[:1]))
    inset.fill(triangle[:, 0], triangle[:, 1], color="tab:green", alpha=0.25)
    inset.plot(triangle[:, 0], triangle[:, 1], color="tab:green", linewidth=1.0)
    inset.plot(*support.goal, "+", color="black", markersize=7)
    inset.plot(*support.com, "o", color="tab:red", markersize=3)
    inset.set(aspect="equal", xticks=[], yticks=[], xlim=(-0.2, 0.3), ylim=(-0.27, 0.27), facecolor="white")
    error = 1e3 * float(np.linalg.norm(support.com - support.goal))
    inset.set_xlabel(f"CoM off {error:.1f} mm", fontsize=6, labelpad=2)


def _shrink(path: Path) -> None:
    """Write the picture with a palette: a third of the size, no visible difference."""
    from PIL import Image  # matplotlib depends on it

    with Image.open(path) as picture:
        small = picture.convert("RGB").quantize(
            192, method=Image.Quantize.MEDIANCUT, dither=Image.Dither.FLOYDSTEINBERG
        )
    small.save(path, optimize=True)
