"""G1 for walking.cpp: its walker in a file, its MuJoCo model, and the walk of Python: ``python walking.py FOLDER``."""

import math
import struct
import sys
from pathlib import Path

import mujoco
import numpy as np

import hqp
from hqp.robots import Plant
from hqp.walking import LEFT, RIGHT, Foothold, Walker

folder = Path(sys.argv[1])
robot = hqp.robots.load("g1", rotors=True)
walker = Walker(robot, dt=0.002, deadline=math.inf)
walker.export(folder / "walker.hqp")
plant = Plant(robot, timestep=0.001, watched=[foot.frame for foot in walker.feet])
mujoco.mj_saveModel(plant.model, str(folder / "walking.mjb"), None)

q, v = plant.reset(walker.start)
with (folder / "walking.ticks").open("wb") as file:
    for k in range(3000):
        if k == 250:
            walker.follow([Foothold(LEFT, 0.15, 0.12), Foothold(RIGHT, 0.3, -0.12), Foothold(LEFT, 0.45, 0.12)])
        if k == 1000:
            walker.go(0.3, 0.0, 0.1)
        if k == 1750:
            walker.stop()
        reading = plant.measure()
        tick = walker.step(robot.state(reading.q, reading.v), reading.contacts.load)
        numbers = np.concatenate((reading.q, reading.v, reading.contacts.load, tick.command))
        file.write(struct.pack("<i", numbers.size) + numbers.astype("<f8").tobytes())
        plant.step(tick.command, steps=2)
print(f"walked {plant.com()[0]:.2f} m in {plant.time:.1f} s")
