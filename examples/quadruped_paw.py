"""Solo12 gives a paw: its balance moves over three feet, the load of the fourth fades, and it lifts and returns.

Feet are points that only push, inside friction cones; free contact forces minimise the torque.
"""

import math

import numpy as np

import hqp
from hqp import PD, Level, Stack
from hqp.tasks import (
    Com,
    ContactForce,
    FrictionCone,
    JointLimits,
    JointTorque,
    Orientation,
    PointContact,
    Position,
    UnilateralContact,
)  # fmt: skip

robot, dt = hqp.robots.load("solo12"), 0.002
feet = robot.landmarks["feet"]
paw, *others = feet
com = Com(law=PD(40.0, max_velocity=0.1))
trunk = Orientation(frame="base_link", law=PD(40.0))
lift = Position(frame=paw, law=PD(60.0, max_velocity=0.3), name="lift")
unload = ContactForce(contact=paw, components=("fz",), name="unload")


def on(standing, *levels):
    """Stack of a body that stands on these feet."""
    limits = [
        f(contact=foot, **k) for foot in standing for f, k in ((UnilateralContact, {}), (FrictionCone, {"mu": 0.6}))
    ]
    points = [PointContact(frame=foot) for foot in standing]
    return Stack(Level(com, trunk), *levels, Level(JointTorque()), subject_to=[*points, *limits, JointLimits()])


four, three = on(feet, Level(unload)), on(others, Level(lift))
session = hqp.Controller(four, hqp.Torque(), deadline=math.inf).session(robot, dt)
session.prepare(three)
q, v = robot.home, np.zeros(robot.nv)
home = robot.state(q)
start, ground = home.com().copy(), home.position(paw).copy()
places = {foot: home.position(foot).copy() for foot in others}
over = 0.8 * (np.mean([*places.values()], axis=0) - start) * [1.0, 1.0, 0.0]
high = slip = jump = 0.0
load, last = [], None
for k in range(4000):
    t, state = k * dt, robot.state(q, v)
    if k in (1250, 2750):  # the paw is unloaded; it is down again
        session.change(three if k == 1250 else four, over=0.2)
    goals = [com.at(start + over * np.interp(t, [0.0, 1.0, 6.0, 7.0], [0.0, 1.0, 1.0, 0.0]))]
    if "lift" in session:  # in a transition while either stack has it
        goals.append(lift.at(ground + ([0.06, 0.0, 0.08] if t < 4.0 else [0.0, 0.0, 0.0])))
    if "unload" in session:
        share = np.interp(t, [0.0, 2.0, 6.0, 7.0], [0.25, 0.0, 0.0, 0.25])  # share of the robot's weight
        goals.append(unload.at([share * 9.81 * robot.mass]))
    tick = session.step(state, *goals)
    q, v = tick.advance()
    force = session.program.contact_forces(tick.x)
    load.append(force[paw][2] if paw in force else 0.0)
    high = max(high, robot.state(q).position(paw)[2] - ground[2])
    slip = max(slip, *(np.linalg.norm(robot.state(q).position(f) - p) for f, p in places.items()))
    jump = max(jump, 0.0 if last is None else np.abs(tick.command - last).max())
    last = tick.command
print(f"the paw bore {load[0]:.1f} N, {load[1200]:.2f} N before it lifted {100 * high:.1f} cm, {load[-1]:.1f} N again")
print(f"feet slipped by {1e6 * slip:.1f} um, the largest change of a torque in a tick was {jump:.3f} N m")
assert abs(load[1200]) < 0.01
assert high > 0.07
assert slip < 5e-4
assert jump < 0.1
