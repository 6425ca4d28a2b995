"""TRAC-IK on stored poses, up to 1 s each; the CPU time includes the threads of its two solvers."""

from chain import run
from trac_ik import TracIK


def make(source, base, tip, limits):
    """TRAC-IK's inverse kinematics with default options except for time and limits."""
    solver = TracIK(base, tip, source, timeout=1.0)
    solver.joint_limits = limits  # TRAC-IK reads missing soft limits of a URDF as 0
    return lambda pose, start: solver.ik(pose[:3, 3], pose[:3, :3], start)


run("pytracik", make)
