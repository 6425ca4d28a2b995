"""Compiled parts of hqp, and messages on missing ones."""

from __future__ import annotations

import importlib
import importlib.util
import os
import warnings
from pathlib import Path

from hqp.errors import PurePythonWarning

PARTS = {
    "_lexicographic": "solver",
    "_assembly": "rows",
    "_torque": "torque",
    "_session": "sessions",
}
"""Extension modules of hqp, and the purpose of each."""

ADVICE = (
    "install a C++ compiler (Debian: apt install g++) and hqp again "
    "(HQP_REQUIRE_NATIVE=1 pip install --force-reinstall --no-cache-dir ...: then a failed build reports why)"
)


def missing() -> tuple[str, ...]:
    """Names of the parts that were not compiled."""
    return tuple(text for name, text in PARTS.items() if importlib.util.find_spec(f"hqp.{name}") is None)


def outdated() -> str:
    """Name of a C++ source of an editable checkout that is newer than the compiled parts, ``""`` without one."""
    found = importlib.util.find_spec("hqp._session")
    folder = Path(__file__).absolute().parent
    if found is None or found.origin is None or Path(found.origin).parent == folder:
        return ""  # not compiled, or installed with its sources
    built = Path(found.origin).stat().st_mtime
    newer = (path for path in sorted((folder / "cpp").rglob("*.[ch]pp")) if path.stat().st_mtime > built)
    return next((path.relative_to(folder.parent).as_posix() for path in newer), "")


def instruction_set() -> str:
    """Instruction set of the solver's kernel on this machine, ``""`` without one."""
    if "solver" in missing():
        return ""
    return str(importlib.import_module("hqp._lexicographic").instruction_set)


def describe() -> str:
    """``native (avx2)``, ``pure Python``, or the missing compiled parts."""
    gone = missing()
    if len(gone) == len(PARTS):
        return "pure Python"
    return f"native ({instruction_set() or 'no kernel'})" + (f", {' and '.join(gone)} in Python" if gone else "")


ISAS = ("generic", "avx2")
"""Values of the environment variable HQP_ISA, which chooses the kernels; without it the best of the machine run."""


def check_instruction_set() -> None:
    """Raise ImportError if HQP_ISA names kernels that are unknown, or that this machine or build lacks."""
    requested = os.environ.get("HQP_ISA", "")
    if requested and requested not in ISAS:
        raise ImportError(f"HQP_ISA={requested!r}: unknown kernels; allowed: {', '.join(ISAS)}, or unset for the best")
    if requested == "avx2" and instruction_set() not in ("avx2", ""):
        raise ImportError("HQP_ISA=avx2: this machine or build of hqp has no AVX2 kernels; unset it, or take generic")


def check() -> None:
    """Raise ImportError in a checkout that was not built, else warn once of missing compiled parts.

    HQP_PURE=1 allows both without a word, HQP_REQUIRE_NATIVE=1 neither.  pip hides the output of a build, so the
    warning has to come here.
    """
    check_instruction_set()
    if not missing() or _set("HQP_PURE"):
        return
    if _is_bare_checkout(folder := Path(__file__).absolute().parents[1]):
        raise ImportError(
            f"this is the source folder {folder}, which has no compiled parts. Run Python in another folder to use the "
            f"installed hqp, or install this folder as editable (pip install --editable {folder}); HQP_PURE=1 runs it "
            "without compiled parts, and without sessions."
        )
    why = f"hqp runs in {describe()}: its C++ build failed, or found no compiler, when it was installed"
    if _set("HQP_REQUIRE_NATIVE"):
        raise ImportError(f"{why}. HQP_REQUIRE_NATIVE is set: {ADVICE}")
    warnings.warn(
        f"{why}. It reads stacks and solves problems "
        f"(default solver: `cascade`), but has no sessions. To repair it, {ADVICE}; "
        "`hqp doctor` reports more, HQP_PURE=1 silences this.",
        PurePythonWarning,
        stacklevel=3,
    )


def _set(variable: str) -> bool:
    return os.environ.get(variable, "0") not in ("", "0")


def _is_bare_checkout(folder: Path) -> bool:
    """Return true if the folder holds hqp's sources and no editable install points to it (PEP 610)."""
    project = folder / "pyproject.toml"
    if not project.is_file() or 'name = "hqp"' not in project.read_text(encoding="utf-8"):
        return False
    import json
    from importlib.metadata import distributions

    origins = (json.loads(found.read_text("direct_url.json") or "{}") for found in distributions(name="hqp"))
    editable = {origin["url"] for origin in origins if origin.get("dir_info", {}).get("editable")}
    return editable.isdisjoint((folder.as_uri(), folder.resolve().as_uri()))
