"""A UR5 carries a tray: upright, loaded on the way, pushed by a guest; motors lose torque with speed."""

import math

import numpy as np
import pinocchio as pin

import hqp
from hqp import PD, Level, Stack
from hqp.tasks import AlignAxis, Cone, Damping, ExternalWrench, JointLimits, Payload, Position, TorqueSpeedLimits

robot, frame, dt = hqp.robots.load("ur5"), "tool0", 0.002
robot.set_home([0.0, -1.4, 1.9, -2.0708, 1.5708, 0.0])  # the tool looks up
hand = Position(frame=frame, law=PD(60.0, max_velocity=0.4), name="hand")
upright = AlignAxis(frame=frame, axis=(0.0, 0.0, 1.0), law=PD(60.0), name="upright")
spill = Cone(AlignAxis(frame=frame, axis=(0.0, 0.0, 1.0)), angle=0.08, rate=10.0, name="spill")
load, push = Payload(frame=frame), ExternalWrench(frame=frame)
stack = Stack(
    Level(hand),
    Level(upright),
    Level(Damping(kinetic_energy=True, law=PD(0.0, 4.0))),
    subject_to=[TorqueSpeedLimits(corner=0.5), JointLimits(), spill, load, push],
)
session = hqp.Controller(stack, hqp.Torque(), deadline=math.inf, braking=hqp.Braking(resume="ask")).session(robot, dt)

plant = robot.model.copy()  # the plant also carries the glasses
data, where = plant.createData(), plant.frames[plant.getFrameId(frame)]
bare, top = pin.Inertia(plant.inertias[where.parentJoint]), np.array([0.0, 0.0, 0.15])
q, v, tilt, off = robot.home, np.zeros(robot.nv), 0.0, 0.0
start, up = robot.state(q).position(frame).copy(), np.array([0.0, 0.0, 1.0])
way = np.array([0.1, 0.35, 0.1])
for k in range(3000):
    t, state = k * dt, robot.state(q, v)
    there, mass = np.interp(t, [0.5, 2.0], [0.0, 1.0]), np.interp(t, [2.2, 2.6], [0.0, 2.0])
    force = np.array([0.0, -20.0 * math.sin(math.pi * (t - 4.0)) if 4.0 < t < 5.0 else 0.0, 0.0, 0.0, 0.0, 0.0])
    goals = [hand.at(start + way * there), upright.at(up), spill.at(up)]
    tick = session.step(state, *goals, load.at(mass, top), push.at(force))
    plant.inertias[where.parentJoint] = bare + where.placement.act(pin.Inertia(mass, top, np.zeros((3, 3))))
    tau = state.jacobian(frame).T @ force
    tau[robot.actuated] += tick.command
    v = v + dt * pin.aba(plant, data, q, v, tau)
    q = robot.integrate(q, v, dt)
    tilt = max(tilt, float(np.arccos(min(1.0, robot.state(q).rotation(frame)[2, 2]))))
    if t > 3.5:
        off = max(off, float(np.linalg.norm(robot.state(q).position(frame) - start - way)))
print(session.explain(tick))
print(f"tilted by {tilt:.3f} rad of 0.08; {1e3 * off:.2f} mm off its place, 2 kg on it and 20 N from the side")
assert tilt < 0.081
assert off < 2e-3
