"""Every example runs as a user would run it."""

from __future__ import annotations

import importlib.util
import subprocess
import sys
from pathlib import Path

import pytest

EXAMPLES = Path(__file__).parents[2] / "examples"
UNTESTED = {"ros2_node"}
NEEDS = {"aloha": "gym_aloha", "pink_g1": "pink", "view_g1": "viser"}
ARGUMENTS = {"view_g1": ["2"]}


def test_there_are_a_dozen() -> None:
    assert len(list(EXAMPLES.glob("*.py"))) - len(UNTESTED) >= 12


@pytest.mark.parametrize("path", sorted(EXAMPLES.glob("*.py")), ids=lambda path: path.stem)
def test_it_runs(path: Path, tmp_path: Path) -> None:
    if path.stem in UNTESTED:
        assert path.read_text().startswith('"""UNTESTED')
        compile(path.read_text(), str(path), "exec")
        return
    if path.stem in NEEDS and importlib.util.find_spec(NEEDS[path.stem]) is None:
        pytest.skip(f"needs {NEEDS[path.stem]}")
    given = [sys.executable, str(path), *ARGUMENTS.get(path.stem, [])]
    result = subprocess.run(given, capture_output=True, text=True, cwd=tmp_path, timeout=120, check=False)
    assert result.returncode == 0, result.stdout + result.stderr
    assert result.stdout.strip()
