"""Talos walks forward, turns and stops under torque control, on the state that its sensors give."""

import sys

import hqp
from hqp.estimation import FeetEstimator
from hqp.robots.on_mujoco import Noise, Plane, Plant, Sensors
from hqp.walking import Gait, Walker

robot = hqp.robots.load(sys.argv[1] if len(sys.argv) > 1 else "talos", rotors=True)
walker = Walker(robot, Gait(single=0.6, double=0.15, height=0.05), dt=0.002)
sensors = Sensors(gyro=Noise(0.01), accelerometer=Noise(0.05), rate=Noise(0.02), force=Noise(2.0))
plant = Plant(robot, terrain=Plane(friction=0.6), sensors=sensors, imu=robot.landmarks["base"][0], delay=0.004)
plant.reset(walker.start)
estimator = FeetEstimator(robot, robot.landmarks["soles"], 0.002, plant.state()[0], least_load=0.9 * robot.mass)

for until, go in ((1.0, None), (6.0, (0.2, 0.0, 0.0)), (9.0, (0.1, 0.0, 0.2)), (12.0, "stop")):
    if go == "stop":
        walker.stop()
    elif go is not None:
        walker.go(*go)
    while plant.time < until:
        reading = plant.measure()
        q, v = estimator.update(reading.q, reading.v, reading.accelerometer, reading.contacts.load)
        tick = walker.step(robot.state(q, v), reading.contacts.load)
        plant.step(tick.command, steps=2)
        if walker.event:
            com, xi = plant.com().round(2), walker.capture_point.round(2)
            print(f"{plant.time:6.2f} s  {walker.phase:6}  CoM {com}  capture point {xi}")
