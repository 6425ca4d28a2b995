"""Minimum versions in pyproject.toml match the set that was installed and tested together (.ci/floors.txt)."""

from __future__ import annotations

import re
import sys
from pathlib import Path

if sys.version_info >= (3, 11):
    import tomllib
else:
    import tomli as tomllib

ROOT = Path(__file__).parents[2]
TESTED = dict(
    line.split("==") for line in (ROOT / ".ci" / "floors.txt").read_text().splitlines() if line and line[0] != "#"
)


def test_floors_are_versions_that_were_tested() -> None:
    project = tomllib.loads((ROOT / "pyproject.toml").read_text())["project"]
    extras = project["optional-dependencies"]
    asked = [*project["dependencies"], *extras["mujoco"], *extras["plots"], *extras["solvers"], *extras["robots"]]
    floors = [
        (match[1], match[2])
        for line in asked
        if "python_version <" not in line and (match := re.match(r"([\w-]+)>=([\d.]+)", line))
    ]
    assert {name for name, _ in floors} <= set(TESTED)
    for name, floor in floors:
        assert (TESTED[name] + ".").startswith(floor + "."), f"{name}: {floor} asked, {TESTED[name]} tested"
