"""A stack as TOML, with the tree of the constructors, for users without Python."""

import hqp
from hqp import serial

TEXT = """
[[level]]
name = "hand"
[[level.element]]
type = "Position"
frame = "tool0"
law = { type = "P", gain = 5.0, max_velocity = 0.3 }

[[level]]
name = "posture"
[[level.element]]
type = "Posture"
law = { type = "P", gain = 1.0 }

[[subject_to]]
type = "JointLimits"
margin = 0.05
"""
stack = serial.loads(TEXT)
robot = hqp.robots.load("ur5")
tick = hqp.Controller(stack, braking=hqp.Braking(resume="ask")).session(robot, dt=0.002).step(robot.state())
print(stack, tick.status.name)
assert serial.loads(serial.dumps(stack)) == stack
