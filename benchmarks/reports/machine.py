"""What a figure was measured on: machine, versions, native or pure."""

from __future__ import annotations

import importlib.metadata
import importlib.util
import os
import platform
from pathlib import Path

import numpy as np

_PACKAGES = (
    "numpy", "scipy", "pin", "qpsolvers", "proxsuite", "osqp", "daqp", "piqp", "clarabel", "mujoco",
    "example-robot-data", "pin-pink", "mink",
)  # fmt: skip


def native() -> str:
    """Which of hqp's compiled parts are there: the solver's kernel, the assembly of rows, both or neither."""
    parts = {"_lexicographic": "solver", "_assembly": "assembly", "_torque": "torque"}
    found = [text for module, text in parts.items() if importlib.util.find_spec(f"hqp.{module}") is not None]
    missing = [text for text in parts.values() if text not in found]
    if not found:
        return "pure Python, nothing native"
    return f"native {' and '.join(found)}" + (f", {missing[0]} in Python" if missing else "")


def description() -> tuple[tuple[str, str], ...]:
    """Pairs of what and which, for the head of a report."""
    import hqp

    return (
        ("machine", f"{_processor()}, {os.cpu_count()} logical cores, {platform.system()} {platform.release()}"),
        ("Python", f"{platform.python_version()} ({platform.python_compiler()})"),
        ("hqp", f"{hqp.__version__}, {native()}"),
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
    found = []
    for name in _PACKAGES:
        try:
            found.append((name, importlib.metadata.version(name)))
        except importlib.metadata.PackageNotFoundError:
            continue
    return found


def _blas() -> str:
    build = np.show_config(mode="dicts")
    blas = build.get("Build Dependencies", {}).get("blas", {}) if isinstance(build, dict) else {}
    return f"{blas.get('name', 'unknown')} {blas.get('version', '')}".strip()


def _threads() -> str:
    if importlib.util.find_spec("threadpoolctl") is None:
        return f"OMP_NUM_THREADS={os.environ.get('OMP_NUM_THREADS', 'unset')}"
    import threadpoolctl

    counts = sorted({int(pool["num_threads"]) for pool in threadpoolctl.threadpool_info()})
    return f"threads {', '.join(map(str, counts))}"
