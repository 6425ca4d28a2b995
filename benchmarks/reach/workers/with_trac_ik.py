"""TRAC-IK on stored poses, up to a second each; its two solvers run in threads of their own, whose time counts."""

from chain import run
from trac_ik import TracIK


def make(source, base, tip, limits):
    """Its inverse kinematics as it comes, but for time and limits."""
    solver = TracIK(base, tip, source, timeout=1.0)
    solver.joint_limits = limits  # soft limits that a URDF leaves out are 0 to it
    return lambda pose, start: solver.ik(pose[:3, 3], pose[:3, :3], start)


run("pytracik", make)
