"""C++ follows .clang-format; `make format` applies it."""

from __future__ import annotations

import shutil
import subprocess
import sys
from pathlib import Path

import pytest

ROOT = Path(__file__).parents[2]
SOURCES = sorted(p for folder in ("hqp/cpp", "tests") for p in (ROOT / folder).rglob("*.[ch]pp"))
TOOL = shutil.which("clang-format", path=str(Path(sys.executable).parent))


@pytest.mark.skipif(TOOL is None, reason="clang-format is not installed beside Python")
def test_cpp_is_formatted() -> None:
    assert SOURCES
    result = subprocess.run([str(TOOL), "--dry-run", "-Werror", *map(str, SOURCES)], capture_output=True, text=True)
    assert result.returncode == 0, "run `make format`:\n" + result.stderr[:2000]
