"""Memory for loading a long chain: that of one Pinocchio Data, whose four tensors of nv^3 numbers hqp cannot spare."""

from __future__ import annotations

import subprocess
import sys
from pathlib import Path

import pytest

LINK = (
    '<link name="l{0}"><inertial><mass value="1"/>'
    '<inertia ixx="1" iyy="1" izz="1" ixy="0" ixz="0" iyz="0"/></inertial></link>'
)
JOINT = (
    '<joint name="j{0}" type="revolute"><parent link="l{0}"/><child link="l{1}"/><origin xyz="0 0 0.1"/>'
    '<axis xyz="0 1 0"/><limit lower="-1" upper="1" effort="10" velocity="2"/></joint>'
)
MEASURE = """
import resource, sys
import hqp.robots
def peak(): return resource.getrusage(resource.RUSAGE_SELF).ru_maxrss * (1 if sys.platform == "darwin" else 1024)
before = peak()
robot = hqp.robots.load(sys.argv[1], floating=False)
print(peak() - before, len(robot.joint_names))
"""


def grown(joints: int, folder: Path) -> int:
    """Peak memory that loading takes [bytes], in a process of its own."""
    path = folder / f"chain{joints}.urdf"
    links = "".join(LINK.format(i) for i in range(joints + 1))
    path.write_text(f'<robot name="chain">{links}{"".join(JOINT.format(i, i + 1) for i in range(joints))}</robot>')
    done = subprocess.run([sys.executable, "-c", MEASURE, str(path)], capture_output=True, text=True, check=True)
    size, count = map(int, done.stdout.split())
    assert count == joints
    return size


@pytest.mark.long
def test_a_long_chain_takes_the_memory_of_one_data(tmp_path: Path) -> None:
    """32 nv^3 bytes for the tensors, and at most as much as 1 kB nv^2 and 32 MB for all else."""
    for joints in (100, 200):
        rest = grown(joints, tmp_path) - 32 * joints**3
        assert rest < 1000 * joints**2 + 3.2e7
