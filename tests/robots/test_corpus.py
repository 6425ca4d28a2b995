"""Every MJCF of the wheels that ``make corpus`` fetches."""

from __future__ import annotations

import os
import warnings
from pathlib import Path

import mujoco
import pytest

import hqp.robots
from hqp.errors import ModelError

FOLDER = Path(os.environ.get("HQP_CORPUS", "build/corpus"))
pytestmark = pytest.mark.corpus


def compiled() -> list[tuple[Path, int]]:
    """Files that MuJoCo compiles, and their nv."""
    found = []
    for path in sorted(FOLDER.rglob("*.xml")):
        try:
            found.append((path, mujoco.MjModel.from_xml_path(str(path)).nv))
        except ValueError:  # parts of other files
            continue
    return found


@pytest.mark.filterwarnings("ignore")
def test_every_file_that_mujoco_compiles_loads_or_is_refused_by_name() -> None:
    """``load`` compares nv, mass, places of bodies and M with MuJoCo itself, so what loads is right."""
    files = compiled()
    if not files:
        pytest.skip("no corpus here: make corpus")
    loaded, refused = [], []
    for path, nv in files:
        try:
            with warnings.catch_warnings():
                warnings.simplefilter("ignore")
                robot = hqp.robots.load(path)
        except ModelError as error:
            refused.append(path.name in str(error))
        else:
            assert robot.nv == nv
            loaded.append(path)
    moving = [path for path, nv in files if nv]
    print(f"{len(loaded)} of {len(moving)} files with joints load; {len(files) - len(moving)} have nothing that moves")
    assert all(refused)
    assert len(loaded) >= 0.9 * len(moving)
