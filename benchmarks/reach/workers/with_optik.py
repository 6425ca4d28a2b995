"""OptIK on stored poses, one thread, at most 50 restarts within a second."""

import numpy as np
import optik
from chain import run


def make(source, base, tip, limits):
    """OptIK's inverse kinematics with its default tolerances."""
    robot = optik.Robot.from_urdf_file(source, base, tip)
    robot.set_parallelism(1)
    config = optik.SolverConfig(max_time=1.0, max_restarts=50)

    def solve(pose, start):
        found = robot.ik(config, pose, start)
        return None if found is None else np.array(found[0])

    return solve


run("optik-py", make)
