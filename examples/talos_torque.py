"""Whole-body torque control: contacts, friction and torque limits, on the exact plant."""

import numpy as np

import hqp
from hqp import PD, Level, Stack
from hqp.tasks import Com, FixedContact, FrictionCone, JointLimits, Position, Posture, TorqueLimits

robot = hqp.robots.load("talos")
soles = robot.landmarks["soles"]
feet = [FixedContact(frame=sole) for sole in soles]
cones = [FrictionCone(contact=sole, mu=0.6) for sole in soles]
hand = Position(frame=robot.landmarks["palms"][1], law=PD(60.0, 15.0, max_velocity=0.4), name="hand")
stack = Stack(
    Level(Com(law=PD(60.0, 15.0)), name="balance"),
    Level(hand, name="hand"),
    Level(Posture(law=PD(20.0, 9.0)), name="posture"),
    subject_to=[*feet, *cones, TorqueLimits(), JointLimits()],
)
session = hqp.Controller(stack, hqp.Torque(contact_law=PD(0.0, 40.0))).session(robot, dt=0.002)
q, v = robot.home, np.zeros(robot.nv)
goal = robot.state(q).position(hand.frame) + [0.1, 0.0, 0.1]
for _ in range(1000):
    tick = session.step(robot.state(q, v), hand.at(goal))
    q, v = tick.advance()
forces = session.program.contact_forces(tick.solution.x)
print({name: np.round(force[:3], 1).tolist() for name, force in forces.items()}, "N")
print(f"hand {1e3 * np.linalg.norm(robot.state(q, v).position(hand.frame) - goal):.1f} mm off")
assert sum(force[2] for force in forces.values()) > 0.9 * 9.81 * robot.mass
