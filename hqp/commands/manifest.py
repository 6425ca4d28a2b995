"""Conditions of a measurement: machine, versions, commit, seed."""

from __future__ import annotations

import datetime
import importlib.metadata
import os
import platform
import subprocess
from pathlib import Path
from typing import Any

import numpy as np

PACKAGES = (
    "numpy",
    "scipy",
    "pin",
    "qpsolvers",
    "proxsuite",
    "osqp",
    "daqp",
    "piqp",
    "clarabel",
    "mujoco",
    "example-robot-data",
)


def manifest(**settings: Any) -> dict[str, Any]:
    """Context of a figure; settings: settings of the run itself."""
    import hqp

    return {
        "format": 1,
        "made": datetime.datetime.now(datetime.timezone.utc).isoformat(timespec="seconds"),
        "machine": {
            "processor": _processor(),
            "cores": os.cpu_count(),
            "system": f"{platform.system()} {platform.release()}",
            "load": list(os.getloadavg()) if hasattr(os, "getloadavg") else [],
        },
        "python": platform.python_version(),
        "hqp": hqp.__version__,
        "commit": commit(),
        "packages": {name: version for name in PACKAGES if (version := _version(name))},
        "blas": _blas(),
        **settings,
    }


def _version(name: str) -> str:
    try:
        return importlib.metadata.version(name)
    except importlib.metadata.PackageNotFoundError:
        return ""


def _processor() -> str:
    try:
        lines = Path("/proc/cpuinfo").read_text().splitlines()
    except OSError:
        return platform.processor() or platform.machine()
    return next((line.partition(":")[2].strip() for line in lines if line.startswith("model name")), platform.machine())


def _blas() -> str:
    from hqp.commands.doctor import blas_threads

    build = np.show_config(mode="dicts")
    blas = build.get("Build Dependencies", {}).get("blas", {}) if isinstance(build, dict) else {}
    threads = blas_threads()
    name = f"{blas.get('name', 'unknown')} {blas.get('version', '')}".strip()
    return f"{name}, threads {'unknown' if threads is None else threads}"


def commit() -> str:
    """The commit of a checkout, an empty string for an installed wheel."""
    folder = Path(__file__).parents[2]
    if not (folder / ".git").exists():
        return ""
    try:
        found = subprocess.run(
            ["git", "rev-parse", "HEAD"], cwd=folder, capture_output=True, text=True, check=True, timeout=5.0
        )
    except (OSError, subprocess.SubprocessError):
        return ""
    return found.stdout.strip()
