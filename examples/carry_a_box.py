"""A clip with a box in both hands on G1: the box keeps its size, the hands keep their places on it."""

from pathlib import Path

import numpy as np

import hqp
from hqp.motion import read_motion, retarget

CLIP = Path(__file__).parent / "lift_a_box.npz"  # a synthetic person, 3 s at 30 frames/s, and a box of 300 mm

motion = read_motion(CLIP)
robot = hqp.robots.load("g1")
found = retarget(motion, robot)
print(found)
palms = robot.landmarks["palms"]
places = np.array([[robot.state(q).position(palm) for palm in palms] for q in found.q])
box = found.box
for k in range(0, len(found), 15):
    one, two = (box.within(places[:, side])[k] for side in (0, 1))
    print(f"{k / found.fps:3.1f} s: box {1e3 * box.lowest()[k]:4.0f} mm above the floor, palms at "
          f"{np.round(1e3 * one)} and {np.round(1e3 * two)} mm in its axes")  # fmt: skip
