"""A Panda presses a table with 20 N, from the air: by torques, and by velocities that position servos follow."""

import math

import mujoco
import numpy as np

import hqp
from hqp import PD, Level, P, Stack
from hqp.robots.on_mujoco import Noise, Plant, Sensors, Servo
from hqp.tasks import Admittance, ExternalWrench, Impedance, JointLimits, Orientation, Posture, TorqueLimits

frame, dt, K, M = "panda_hand", 0.002, 2000.0, 4.0
damping = 2.0 * math.sqrt(K * M)


def table(spec: mujoco.MjSpec) -> None:
    """A box under the hand."""
    box = spec.worldbody.add_geom(name="table", pos=[0.5, 0.0, 0.35], size=[0.4, 0.5, 0.05])
    box.type, box.priority, box.friction = mujoco.mjtGeom.mjGEOM_BOX, 2, [0.2, 0.005, 0.0001]


def report(what: str, loads: list[float]) -> None:
    """Print the load on the table."""
    rest, touch = np.array(loads[-250:]), dt * int(np.argmax(np.array(loads) > 0.0))
    off = np.abs(rest - 20.0).max()
    print(f"{what}: touch after {touch:.2f} s, largest {max(loads):.1f} N, then {rest.mean():.2f} N, off by {off:.2f}")


robot = hqp.robots.load("panda")
felt = ExternalWrench(frame=frame)  # the measured force enters the dynamics
hand = Impedance(frame=frame, stiffness=(K, K, 0.0), damping=(damping, damping, 400.0), mass=M, name="hand")
upright = Orientation(frame=frame, law=PD(100.0), name="upright")
stack = Stack(Level(hand, upright), Level(Posture()), subject_to=[JointLimits(), TorqueLimits(), felt])
session = hqp.Controller(stack, hqp.Torque(), deadline=math.inf, braking=hqp.Braking(resume="ask")).session(robot, dt)
plant, loads = Plant(robot, watched=(frame,), edit=table, delay=dt, sensors=Sensors(force=Noise(0.3))), []
for _ in range(1500):
    reading = plant.measure()
    force = reading.contacts.force[0]
    goals = [hand.at(force=force, bears=[0.0, 0.0, 20.0]), felt.at([*force, 0.0, 0.0, 0.0])]
    plant.step(session.step(robot.state(reading.q, reading.v), *goals).command, steps=2)
    loads.append(plant.contacts().load[0])
report("by torques", loads)

giving = Admittance(frame=frame, stiffness=(K, K, 0.0), damping=(400.0, 400.0, 500.0), name="hand")
turn = Orientation(frame=frame, law=P(5.0), name="upright")
stack = Stack(Level(giving, turn), Level(Posture()), subject_to=[JointLimits()])
session = hqp.Controller(stack, deadline=math.inf, braking=hqp.Braking(resume="ask")).session(robot, dt)
servo = Servo(other=4000.0, damping_time=0.01)
plant, loads = Plant(robot, watched=(frame,), edit=table, actuation="position", servo=servo), []
q, v = plant.reset(robot.home.copy())
for _ in range(1500):
    force = plant.measure().contacts.force[0]
    q, v = session.step(robot.state(q, v), giving.at(force=force, bears=[0.0, 0.0, 20.0])).advance()
    plant.step(q[robot.actuated], v[robot.actuated], steps=2)
    loads.append(plant.contacts().load[0])
report("by servos", loads)
