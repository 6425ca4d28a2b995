"""Which of hqp's compiled parts are there, and the warning where none is."""

from __future__ import annotations

import importlib
import importlib.util
import os
import warnings

from hqp.errors import PurePythonWarning

PARTS = {"_lexicographic": "solver", "_priced": "prices", "_assembly": "rows", "_torque": "torque"}
"""Extension modules of hqp, and what each does."""

ADVICE = "install a C++ compiler (Debian: apt install g++) and hqp again (pip install --force-reinstall --no-cache-dir)"


def missing() -> tuple[str, ...]:
    """What of solver, prices, rows and torque was not compiled."""
    return tuple(text for name, text in PARTS.items() if importlib.util.find_spec(f"hqp.{name}") is None)


def instruction_set() -> str:
    """That of the solver's kernel on this machine, ``""`` without one."""
    if "solver" in missing():
        return ""
    return str(importlib.import_module("hqp._lexicographic").instruction_set)


def describe() -> str:
    """``native (avx2)``, ``pure Python``, or what is missing of the compiled parts."""
    gone = missing()
    if len(gone) == len(PARTS):
        return "pure Python"
    return f"native ({instruction_set() or 'no kernel'})" + (f", {' and '.join(gone)} in Python" if gone else "")


def warn_if_pure() -> None:
    """Tell once that the compiled parts are missing; pip hides what a build prints.  HQP_PURE=1 silences it."""
    if missing() and os.environ.get("HQP_PURE", "0") in ("", "0"):
        warnings.warn(
            f"hqp runs in {describe()}: no compiler was found when it was installed. A tick takes milliseconds instead "
            f"of microseconds, and a Controller takes the solver `cascade` by default. To mend it, {ADVICE}; "
            "`hqp doctor` tells more, HQP_PURE=1 silences this.",
            PurePythonWarning,
            stacklevel=3,
        )
