"""A function to sweep over, in a file beside its cases."""

from __future__ import annotations

import os
import signal
import time
from pathlib import Path

import numpy as np


def square(
    x: int, folder: str = "", kill_at: int | None = None, once: bool = True, seconds: float = 0.0
) -> dict[str, object]:
    """x squared; writes a mark for every call to ``folder``, refuses 7, and kills its process at ``kill_at``."""
    time.sleep(seconds)
    if folder:
        with open(Path(folder) / f"call-{x}", "a") as file:
            file.write("x")
    if x == kill_at and (not once or len((Path(folder) / f"call-{x}").read_text()) == 1):
        os.kill(os.getpid(), signal.SIGKILL)
    if x == 7:
        raise ValueError("seven")
    return {"square": np.float64(x * x), "list": np.array([x, 2.0 * x]), "mixed": x if x % 2 else "even"}
