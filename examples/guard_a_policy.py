"""A filter behind a policy: targets that cross the hands, leave ranges or are NaN, on the servos of a hoisted G1."""

import numpy as np
import pinocchio as pin

import hqp
from hqp.tasks import CollisionAvoidance

robot, dt = hqp.robots.load("g1", floating=False), 0.002
hands = (("left_wrist_yaw_link", "right_wrist_yaw_link"),)
guard = hqp.PolicyFilter(kp=60.0, kd=2.0, collision=CollisionAvoidance(pairs=hands))
session, servos = guard.session(robot, dt, max_age=0.02), guard.servos(robot, dt)
names, home = robot.joint_names, robot.state(robot.home).angles[robot.actuated]


def policy(t):
    """Move slowly for 1 s, then cross the arms, then send an absurd angle and NaN."""
    target = home + 0.05 * np.sin(2.0 * np.pi * t)
    if t > 1.0:
        target[names.index("left_shoulder_yaw_joint")] = -1.5
        target[names.index("right_shoulder_yaw_joint")] = 1.5
    if t > 2.0:
        target[names.index("left_elbow_joint")] = 30.0
        target[names.index("waist_yaw_joint")] = np.nan
    return target


model, q, v = pin.Model(robot.model), robot.home.copy(), np.zeros(robot.nv)
model.armature = model.armature + servos.stiffening  # servos act within the period
data = model.createData()
for k in range(1500):
    now = k * dt
    tick = session.step(robot.state(q, v, time=now), policy(now), now=now)
    if k % 250 == 0:
        least = min((n.distance for n in guard.collision.near(robot.state(q)) if n is not None), default=np.inf)
        limited = {name: round(change, 2) for name, change in tick.limited.items()}
        print(f"{k * dt:3.1f} s: hands {least:.3f} m apart (inf: far), limited: {limited or 'nobody'}")
    tau = servos.torque(tick.command, q + dt * v, v)
    v = v + dt * pin.aba(model, data, q, v, tau)
    q = pin.integrate(model, q, dt * v)
