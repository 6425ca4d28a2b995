"""What a figure was measured on: machine, versions, native or pure."""

from __future__ import annotations

import os
import platform
from pathlib import Path

import numpy as np

from hqp import doctor, native

_PACKAGES = (
    "numpy", "scipy", "pin", "qpsolvers", "proxsuite", "osqp", "daqp", "piqp", "clarabel", "mujoco",
    "example-robot-data", "pin-pink", "mink",
)  # fmt: skip


def description() -> tuple[tuple[str, str], ...]:
    """Pairs of what and which, for the head of a report."""
    import hqp

    return (
        ("machine", f"{_processor()}, {os.cpu_count()} logical cores, {platform.system()} {platform.release()}"),
        ("Python", f"{platform.python_version()} ({platform.python_compiler()})"),
        ("hqp", f"{hqp.__version__}, {native.describe()}"),
        ("packages", ", ".join(f"{name} {version}" for name, version in _versions())),
        ("BLAS", f"{_blas()}, {_threads()}"),
        ("load average", ", ".join(f"{x:.1f}" for x in os.getloadavg()) if hasattr(os, "getloadavg") else "unknown"),
    )


def _processor() -> str:
    cpuinfo = Path("/proc/cpuinfo")
    if cpuinfo.is_file():
        for line in cpuinfo.read_text().splitlines():
            if line.startswith("model name"):
                return line.partition(":")[2].strip()
    return platform.processor() or platform.machine()


def _versions() -> list[tuple[str, str]]:
    return [(name, version) for name in _PACKAGES if (version := doctor.version_of(name))]


def _blas() -> str:
    build = np.show_config(mode="dicts")
    blas = build.get("Build Dependencies", {}).get("blas", {}) if isinstance(build, dict) else {}
    return f"{blas.get('name', 'unknown')} {blas.get('version', '')}".strip()


def _threads() -> str:
    threads = doctor.blas_threads()
    return f"threads {'unknown' if threads is None else threads}"
