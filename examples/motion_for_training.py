"""Reference motions for training in the layout of mjlab's tracker: a walk, and clips that are named on the line."""

import sys
from pathlib import Path
from tempfile import mkdtemp

import numpy as np

import hqp
from hqp.motion import read_motion, retarget, save_training
from hqp.walking import Walker

folder = Path(mkdtemp(prefix="hqp-"))
robot = hqp.robots.load("g1")
walker = Walker(robot, dt=0.002)
walker.go(0.2)
motions = {"walk": walker.plan(8.0, fps=50.0)}
for clip in sys.argv[1:]:
    motions[Path(clip).stem] = retarget(read_motion(clip), robot)
for name, motion in motions.items():
    path = save_training(folder / f"{name}.npz", robot, motion)
    data = np.load(path)
    print(f"{path.name}: {len(data['joint_pos'])} frames at {data['fps'][0]:g}/s, {len(data['body_names'])} bodies")
    print(f"    the pelvis goes {np.ptp(data['body_pos_w'][:, 0, 0]):.2f} m, at most "
          f"{np.abs(data['body_lin_vel_w'][:, 0, 0]).max():.2f} m/s")  # fmt: skip
