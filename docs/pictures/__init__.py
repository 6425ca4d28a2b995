"""The pictures of the docs, made headless by MuJoCo: ``python -m docs.pictures``; EGL or OSMesa is needed."""

import os
import sys

if sys.platform == "linux" and not os.environ.get(
    "DISPLAY"
):  # before the first import of MuJoCo
    os.environ.setdefault("MUJOCO_GL", "egl")
