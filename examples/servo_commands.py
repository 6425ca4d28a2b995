"""Commands of a servo: position, velocity and feedforward torque, integrated from the command, not the measurement."""

import numpy as np

import hqp
from hqp import Level, P, Stack
from hqp.tasks import JointLimits, Position

robot = hqp.robots.load("panda")
hand = Position(frame="panda_link8", law=P(5.0, max_velocity=0.3))
stack = Stack(Level(hand), subject_to=[JointLimits()])
session = hqp.Controller(stack, braking=hqp.Braking(resume="ask")).session(robot, dt=0.002)
kp, kd = np.full(robot.actuated.size, 600.0), np.full(robot.actuated.size, 50.0)

q_commanded, v_commanded = robot.home.copy(), np.zeros(robot.nv)
goal = robot.state(q_commanded).position(hand.frame) + [0.05, 0.1, 0.0]
for _ in range(1500):
    # The loop closes over the command: feedback of the servo's lag would add it to the command once more.
    state = robot.state(q_commanded, v_commanded)
    tick = session.step(state, hand.at(goal))
    gravity = state.gravity_force()[robot.actuated]
    q_commanded, v_commanded = tick.advance()
    setpoint = {  # one message to a joint-impedance interface: tau = kp (q - q_m) + kd (v - v_m) + feedforward
        "q": robot.state(q_commanded).angles[robot.actuated],
        "v": tick.command,
        "tau": gravity,
        "kp": kp,
        "kd": kd,
    }
print({name: np.round(values[:3], 3).tolist() for name, values in setpoint.items()})
assert np.linalg.norm(robot.state(q_commanded).position(hand.frame) - goal) < 2e-3
