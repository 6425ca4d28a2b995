"""An environment for each rival: made once, with the versions named here, and kept."""

from __future__ import annotations

import os
import subprocess
import sys
from collections.abc import Callable, Mapping, Sequence
from pathlib import Path

from hqp.errors import DeclarationError, HqpError

RIVALS: dict[str, tuple[str, ...]] = {
    "pink": ("pin-pink==4.4.0", "qpsolvers[daqp]", "daqp"),
    "mink": ("mink==1.3.0", "qpsolvers[daqp]", "daqp"),
    "placo": ("placo==0.10.2",),
    "tsid": ("tsid==1.7.1", "pin==3.4.0", "cmeel-urdfdom<5", "cmeel-tinyxml2<11"),  # versions of the wheel's build
}
"""Packages of each rival."""


def folder() -> Path:
    """Folder of the environments: HQP_RIVALS, or hqp/rivals in the user's cache."""
    given = os.environ.get("HQP_RIVALS")
    cache = Path(os.environ.get("XDG_CACHE_HOME") or Path.home() / ".cache")
    return Path(given) if given else cache / "hqp" / "rivals"


def environment(
    name: str, progress: Callable[[str], None] = lambda text: None, rivals: Mapping[str, Sequence[str]] = RIVALS
) -> Path:
    """The Python of a rival's environment, made if it is not there.

    Wheels only: a rival that would have to be compiled counts as not available.  Raises DeclarationError for an unknown
    name, HqpError where the installation fails.
    """
    if name not in rivals:
        raise DeclarationError("rivals", "unknown", value=name, allowed=", ".join(rivals))
    wanted = "\n".join(rivals[name])
    place = folder() / name
    python = place / ("Scripts/python.exe" if os.name == "nt" else "bin/python")
    mark = place / "installed.txt"
    if mark.is_file() and mark.read_text() == wanted and python.exists():
        return python
    progress(f"installing {', '.join(rivals[name])} into {place}")
    _call([sys.executable, "-m", "venv", "--clear", str(place)], name)
    options = ["--quiet", "--disable-pip-version-check", "--only-binary", ":all:"]
    _call([str(python), "-m", "pip", "install", *options, *rivals[name]], name)
    mark.write_text(wanted)
    return python


def _call(command: list[str], name: str) -> None:
    done = subprocess.run(command, capture_output=True, text=True, check=False)
    if done.returncode:
        said = (done.stderr or done.stdout).strip().splitlines()
        raise HqpError(f"{name} cannot be installed: {said[-1] if said else 'no reason given'}")
