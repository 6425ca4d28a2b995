"""Sphere barriers like pink's: a UR5 holds its tool while two balls pass, and avoids them."""

import math

import numpy as np

import hqp
from hqp import Level, P, Stack, shapes
from hqp.tasks import CollisionAvoidance, JointLimits, Position, Posture

robot = hqp.robots.load("ur5")
robot.set_home([0.0, -1.2, 1.6, -0.4, 1.57, 0.0])
tool = Position(frame="tool0", law=P(3.0, max_velocity=0.5))
balls = CollisionAvoidance(
    pairs="world",
    world=(shapes.sphere("red", 0.08), shapes.sphere("blue", 0.12)),
    clearance=0.03,
    influence=0.15,
)
stack = Stack(Level(tool), Level(Posture(law=P(1.0))), subject_to=[JointLimits(), balls])
session = hqp.Controller(stack, braking=hqp.Braking(resume="ask")).session(robot, dt=0.004)
q, v, least, away = robot.home, np.zeros(robot.nv), math.inf, 0.0
place = robot.state(q).position("tool0")
for k in range(4000):
    t = 0.004 * k
    red = place + [0.0, 0.3 * math.cos(0.4 * t), 0.05]  # through the tool, to and fro
    blue = [0.45, 0.5 + 0.25 * math.cos(0.4 * t), 0.5]
    swing = -0.4 * math.sin(0.4 * t)
    rates = {"red": [0.0, 0.3 * swing, 0.0], "blue": [0.0, 0.25 * swing, 0.0]}
    around = balls.at({"red": red, "blue": blue}, rates)
    q, v = session.step(robot.state(q, v), tool.at(place), around).advance()
    least = min([least, *(n.distance for n in balls.near(robot.state(q), around.value) if n is not None)])
    away = max(away, float(np.linalg.norm(robot.state(q).position("tool0") - place)))
print(f"nearest {1e3 * least:.1f} mm of 30 asked; the tool gave way by up to {100 * away:.0f} cm")
assert least > 0.029
assert away > 0.05
