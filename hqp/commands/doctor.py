"""Report of hqp's installation on this machine: versions, compiled parts, BLAS threads, optional packages, and how to
mend each."""

from __future__ import annotations

import ctypes
import importlib.metadata
import importlib.util
import os
import platform
from dataclasses import dataclass
from pathlib import Path

from hqp import native, user_cache

REQUIRED = ("numpy", "scipy", "pin")

EXTRAS: dict[str, tuple[str, ...]] = {
    "mujoco": ("mujoco",),
    "plots": ("matplotlib",),
    "video": ("imageio-ffmpeg",),
    "motion": ("example-robot-data", "plotly", "qpsolvers", "clarabel"),
    "view": ("viser", "trimesh", "pycollada"),
    "robots": ("example-robot-data",),
    "solvers": ("qpsolvers", "proxsuite", "osqp", "daqp", "piqp", "clarabel"),
    "quadprog": ("qpsolvers", "quadprog"),
    "lab": ("plotly", "pyarrow", "rich", "threadpoolctl"),
    "sweep": ("pyarrow", "ray", "rich"),
    "gym": ("gymnasium",),
}
"""Extras of hqp, and the packages that each installs."""

BENCH = tuple(name for extra in ("mujoco", "plots", "solvers", "robots", "lab") for name in EXTRAS[extra])
CONTRIBUTORS: dict[str, tuple[str, ...]] = {
    "docs": ("mkdocs-material", "mkdocstrings", "gymnasium", "ruff"),
    "browser": (*EXTRAS["view"], *EXTRAS["robots"], "playwright"),
    "bench": BENCH,
    "dev": (
        *BENCH, *EXTRAS["motion"], *EXTRAS["video"], *EXTRAS["view"],
        "pytest", "pytest-timeout", "pytest-xdist", "hypothesis", "ruff", "mypy", "clang-format", "pyright",
    ),
}  # fmt: skip
"""Extras for work on hqp itself."""

THREADS = ("OMP_NUM_THREADS", "OPENBLAS_NUM_THREADS", "MKL_NUM_THREADS", "VECLIB_MAXIMUM_THREADS")


@dataclass(frozen=True)
class Finding:
    """One line: its subject, the result, and the remedy ("" if nothing is wrong).

    slow: true if it slows the control loop.
    """

    what: str
    found: str
    mend: str = ""
    slow: bool = False


def findings(contributor: bool = False) -> list[Finding]:
    """Everything that was looked at; contributor: with the extras for work on hqp itself."""
    import hqp

    found = [
        Finding("hqp", hqp.__version__),
        Finding("Python", f"{platform.python_version()}, {platform.system()} {platform.machine()}"),
    ]
    gone, newer = native.missing(), native.outdated()
    parts, advice = native.describe(), native.ADVICE if gone else ""
    if newer and not gone:
        parts, advice = f"{parts}, older than {newer}", "compile again: pip install --editable ., or make setup"
    found.append(Finding("compiled parts", parts, advice, bool(gone or newer)))
    threads = blas_threads()
    if threads is None:
        found.append(Finding("BLAS threads", "unknown", "set OMP_NUM_THREADS=1 before Python starts"))
    else:
        advice = "set OMP_NUM_THREADS=1 before Python starts: threads that wait for each other cost milliseconds a tick"
        found.append(Finding("BLAS threads", str(threads), advice if threads > 1 else "", threads > 1))
    for name in REQUIRED:
        version = version_of(name)
        found.append(Finding(name, version or "missing", "" if version else f"pip install {name}"))
    found += [_extra(*extra) for extra in (EXTRAS | CONTRIBUTORS if contributor else EXTRAS).items()]
    found += [
        Finding(title, _cached(part)) for title, part in (("fitted capsules", "capsules"), ("pairs of links", "pairs"))
    ]
    return found


def _extra(extra: str, packages: tuple[str, ...]) -> Finding:
    versions = {name: version_of(name) for name in packages}
    text = ", ".join(f"{name} {version or 'not installed'}" for name, version in versions.items())
    return Finding(f"hqp[{extra}]", text, "" if all(versions.values()) else f"pip install 'hqp[{extra}]'")


def _cached(part: str) -> str:
    """A folder of the user's cache, and its number of files."""
    try:
        folder = user_cache.folder(part)
        return f"{folder}, {len(list(folder.glob('*.json')))} files; delete it to compute them again"
    except (RuntimeError, OSError) as error:
        return f"unknown: {error}"


def version_of(package: str) -> str:
    """Its installed version, "" for none."""
    try:
        return importlib.metadata.version(package)
    except importlib.metadata.PackageNotFoundError:
        return ""


def blas_threads() -> int | None:
    """The most threads that a BLAS of NumPy or SciPy would use, None if unknown."""
    counts = [count for library in _blas_libraries() if (count := _thread_count(library)) is not None]
    if counts:
        return max(counts)
    for name in THREADS:
        if os.environ.get(name, "").isdigit():
            return int(os.environ[name])
    return None


def _blas_libraries() -> list[Path]:
    """The OpenBLAS files that come in the wheels of NumPy and SciPy."""
    found: list[Path] = []
    for package in ("numpy", "scipy"):
        spec = importlib.util.find_spec(package)
        if spec is not None and spec.origin is not None:
            home = Path(spec.origin).parent
            for folder in (home.with_name(f"{package}.libs"), home / ".dylibs"):
                found += sorted(folder.glob("*openblas*"))
    return found


def _thread_count(library: Path) -> int | None:
    try:
        loaded = ctypes.CDLL(str(library))
    except OSError:
        return None
    for name in ("scipy_openblas_get_num_threads64_", "scipy_openblas_get_num_threads", "openblas_get_num_threads64_",
                 "openblas_get_num_threads"):  # fmt: skip
        function = getattr(loaded, name, None)
        if function is not None:
            return int(function())
    return None


def table(found: list[Finding]) -> str:
    """The findings as aligned lines; each fault with its remedy."""
    width = max(len(finding.what) for finding in found)
    lines = []
    for finding in found:
        lines.append(f"{finding.what:{width}}  {finding.found}")
        if finding.mend:
            lines.append(f"{'':{width}}    -> {finding.mend}")
    return "\n".join(lines)
