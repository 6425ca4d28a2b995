"""A hand guides a UR5 with friction in its joints: it floats, and a virtual floor stops it as a contact would."""

import numpy as np
import pinocchio as pin

import hqp
from hqp import PD, Stack
from hqp.tasks import ExternalWrench, JointLimits, JointLoad, NominalTorque, Position, TorqueLimits, Within

robot, frame, dt = hqp.robots.load("ur5"), "tool0", 0.002
robot.set_home([0.0, -1.4, 1.9, -2.0708, 1.5708, 0.0])
floor = Within(Position(frame=frame, axes="z", law=PD(400.0)), lower=-0.05, name="floor")  # 5 cm below the start
friction, floating, push = JointLoad(name="friction"), NominalTorque(), ExternalWrench(frame=frame, resisted=False)
stack = Stack(subject_to=[JointLimits(acceleration=None), TorqueLimits(), floor, friction, floating, push])
controller = hqp.Controller(stack, hqp.Torque(holding=None), price=0, braking=hqp.Braking(resume="ask"))
session = controller.session(robot, dt)

data, q, v = robot.model.createData(), robot.home, np.zeros(robot.nv)
start, lowest = robot.state(q).position(frame).copy(), 0.0
for _ in range(1500):
    state = robot.state(q, v)
    force = np.array([0.0, 10.0, -20.0, 0.0, 0.0, 0.0])  # of the hand: down and aside
    d = -1.0 * np.tanh(v / 0.05)  # friction [N m]
    nominal = pin.computeGeneralizedGravity(robot.model, robot.model.createData(), q) - d - 4.0 * v
    pulled = state.jacobian(frame).T @ force
    tick = session.step(state, floor.at(start[2:]), friction.at(d), floating.at(nominal), push.at(force))
    v = v + dt * pin.aba(robot.model, data, q, v, tick.command + d + pulled)
    q = pin.integrate(robot.model, q, dt * v)
    lowest = min(lowest, float(robot.state(q).position(frame)[2] - start[2]))
moved = robot.state(q).position(frame) - start
print(session.explain(tick))
print(f"lowest {1e3 * lowest:.2f} mm, floor at -50; moved {1e3 * moved[1]:.0f} mm aside")
assert lowest > -0.0505
assert moved[1] > 0.1
