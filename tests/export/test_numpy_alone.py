"""Exported plans run with NumPy alone: a robot's computer installs hqp without its dependencies."""

from __future__ import annotations

import os
import subprocess
import sys
from pathlib import Path

import numpy as np
import pytest

import hqp
import hqp._session
from hqp import Level, P, Stack
from hqp.tasks import JointLimits, Position, Posture

CODE = """
import sys
from types import SimpleNamespace
import numpy as np
import hqp
from hqp.tasks import Position

(file,) = sys.argv[1:]
session = hqp.load(file)
print(session.step(session.home).status.name)
print(hqp.Batch.load(file, 2).step(np.tile(session.home, (2, 1))).statuses()[1].name)
hand, start = Position(frame="r_palm", name="hand"), session.held("hand")
at = SimpleNamespace(valid=True, position=lambda frame: start, rotation=lambda frame: np.eye(3))
follow, q = hqp.Follow(hand), session.home
for k in range(200):
    if k % 10 == 0:
        follow.receive(start + [0.0, 0.0, 0.05], received=0.002 * k)
    reference = follow.reference(at, 0.002 * k)
    tick = session.step(q, targets={"hand": (reference.value, reference.velocity)})
    q = session.advance(q, tick.command)
print(tick.status.name, np.round(reference.value - start, 3))
print(*sorted({name.partition(".")[0] for name in sys.modules} - {"__main__", *sys.stdlib_module_names}))
"""


@pytest.fixture
def bare(tmp_path: Path) -> Path:
    """A folder of packages as after `pip install hqp --no-deps numpy`: links to the files of both."""
    folder = tmp_path / "site-packages"
    (folder / "hqp").mkdir(parents=True)
    numpy = Path(np.__file__).parent
    for path in (numpy, numpy.with_name("numpy.libs")):
        if path.exists():
            (folder / path.name).symlink_to(path)
    for path in (*Path(hqp.__file__).parent.iterdir(), *Path(hqp._session.__file__).parent.glob("_*.so")):
        (folder / "hqp" / path.name).symlink_to(path.resolve())
    return folder


def run(bare: Path, *arguments: str) -> str:
    """Standard output of CODE in an interpreter with this folder alone."""
    environment = {**os.environ, "PYTHONPATH": str(bare), "HQP_REQUIRE_NATIVE": "1"}
    command = [sys.executable, "-S", "-c", CODE, *arguments]
    found = subprocess.run(command, capture_output=True, text=True, env=environment, check=False, cwd=bare)
    assert found.returncode == 0, found.stderr
    return found.stdout


@pytest.mark.long
def test_numpy_alone_steps_a_plan(bare: Path, tmp_path: Path) -> None:
    robot = hqp.robots.load("cbi", floating=False)
    hand = Position(frame="r_palm", law=P(5.0), name="hand")
    stack = Stack(Level(hand), Level(Posture()), subject_to=[JointLimits()])
    hqp.Controller(stack, hqp.Velocity()).session(robot, 0.002).export(tmp_path / "arm.hqp")
    shown = run(bare, str(tmp_path / "arm.hqp")).splitlines()
    assert shown == ["OPTIMAL", "OPTIMAL", "OPTIMAL [0.   0.   0.05]", "hqp numpy"]
