"""Run a program as a user does, in a process that has finished the imports."""

from __future__ import annotations

import math
import multiprocessing
import os
import runpy
import sys
from pathlib import Path
from typing import Any

SERVER = multiprocessing.get_context("forkserver")
SERVER.set_forkserver_preload(["hqp.commands", "hqp.robots.on_mujoco"])


def play(path: Path, folder: Path, *arguments: str) -> tuple[int | None, str]:
    """Exit status, None after a timeout, and printed output; ``folder`` is the working directory."""
    process = SERVER.Process(target=_alone, args=(path, folder, arguments))
    process.start()
    process.join(1200)
    process.kill()
    return process.exitcode, (folder / "printed").read_text()


def _alone(path: Path, folder: Path, arguments: tuple[str, ...]) -> None:
    import hqp

    os.chdir(folder)
    printed = os.open("printed", os.O_CREAT | os.O_WRONLY)
    os.dup2(printed, 1)
    os.dup2(printed, 2)
    made: Any = hqp.Controller.__init__

    def patient(*given: Any, **more: Any) -> None:
        """Simulations wait for their answers, also on a busy machine."""
        made(*given, **{"deadline": math.inf, **more})

    hqp.Controller.__init__ = patient  # type: ignore[method-assign]
    sys.argv, sys.path[0] = [str(path), *arguments], str(path.parent)
    runpy.run_path(str(path), run_name="__main__")
