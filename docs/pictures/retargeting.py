"""A person's motion on a robot, side by side: ``python -m docs.pictures.retargeting FILE ROBOT``.

The film's clip is ``tests/example_files/test_mocapbank.bvh`` in the source archive of bvhtoolbox 0.1.3 (MIT) on PyPI.
"""

from __future__ import annotations

import sys
from pathlib import Path

import numpy as np
from PIL import Image

from hqp.motion import Retargeted, retarget

from .moving import FPS, save
from .studio import BLUE, Studio, caption

FIGURES = Path(__file__).parents[1] / "figures"
SIZE = (420, 420)
APART = 0.75
"""Room between the person and the robot as a share of their height."""


def pictures(found: Retargeted) -> list[Image.Image]:
    """Frames of the person's joints and the robot; the caption lists the standing feet."""
    height = float(np.ptp(found.person[0, :, 2]))
    middle = 0.5 * (found.q[:, :3].min(axis=0) + found.q[:, :3].max(axis=0))
    across = (
        found.person[:, :, 1] - found.q[:, None, 1]
    )  # so far a part of the person is ever beside the base
    aside = np.array([0.0, APART * height - min(0.0, float(across.min())), 0.0])
    around = float(np.ptp(found.q[:, :2], axis=0).max())
    studio = Studio(
        found.robot,
        SIZE,
        look=np.array([*(middle + 0.5 * aside)[:2], 0.5 * height]),
        distance=2.4 * height + 0.8 * around + 0.6 * float(aside[1]),
        azimuth=180.0,
        elevation=-12.0,
    )
    shown = []
    for k in range(0, len(found), max(1, round(found.fps / FPS))):
        if not len(
            found.person_parents
        ):  # the clip does not say which joints are joined
            for joint in found.person[k]:
                studio.ball(joint + aside, BLUE, 0.03)
        for child, parent in enumerate(found.person_parents):
            joint = found.person[k, child] + aside
            if parent >= 0:
                studio.line(joint, found.person[k, parent] + aside, BLUE, 0.018)
        names = [
            n
            for n, on in zip(found.contact_names, found.contacts[k], strict=True)
            if on
        ]
        text = f"{k / found.fps:.1f} s, down: {', '.join(names) or 'nothing'}"
        shown.append(caption(studio.shoot(found.q[k]), "A person, and G1", text, BLUE))
    return shown


if __name__ == "__main__":
    motion, robot = sys.argv[1], sys.argv[2]
    print(save(pictures(retarget(motion, robot)), FIGURES / f"retarget_{robot}.webp"))
