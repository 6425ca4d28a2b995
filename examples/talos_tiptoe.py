"""Talos squeezes a box with 20 N and lifts a heel, at torque level; contact forces have limits in newtons."""

import math

import numpy as np
import pinocchio as pin

import hqp
from hqp import PD, Level, Stack
from hqp.tasks import (
    CenterOfPressure,
    Com,
    ContactForce,
    EdgeContact,
    FixedContact,
    ForceLimits,
    FrictionCone,
    HoldingTorque,
    JointLimits,
    Orientation,
    Posture,
    TorqueLimits,
    UnilateralContact,
    Weld,
    Within,
)  # fmt: skip

talos = hqp.robots.load("talos")
left, right = talos.landmarks["soles"]
one, other = talos.landmarks["palms"]
robot = talos.with_frame("toes", right, pin.SE3(np.eye(3), np.array([0.1, 0.0, 0.0])))
foot, toes = FixedContact(frame=left, name="foot"), EdgeContact(frame="toes", axis="y")
box = Weld(frame=one, relative_to=other, name="box")
limits = [
    UnilateralContact(contact="foot", minimum=100.0),
    FrictionCone(contact="foot", mu=0.6, torsion=0.03),
    CenterOfPressure(contact="foot", rectangle=(-0.1, 0.1, -0.05, 0.05)),
    ForceLimits(contact="box", force=60.0, moment=8.0),
    Within(HoldingTorque(joints="torso"), lower=-0.5, upper=0.5, name="back"),
    TorqueLimits(),
    JointLimits(),
]
com = Com(law=PD(40.0, max_velocity=0.1))
heel = Orientation(frame=right, axes="pitch", law=PD(40.0, max_velocity=0.4), name="heel")
squeeze = ContactForce(contact="box", components=("fy",), name="squeeze")
stack = Stack(
    Level(com), Level(squeeze), Level(heel), Level(Posture(law=PD(16.0))), subject_to=[foot, toes, box, *limits]
)
session = hqp.Controller(stack, hqp.Torque(), deadline=math.inf).session(robot, dt=0.002)
q, v = robot.home, np.zeros(robot.nv)
home = robot.state(q)
start, edge, between = home.com().copy(), home.position("toes").copy(), box.value(home).copy()


def off(state):
    """Change of the hands' relative pose since the start."""
    return np.abs(box.value(state) - between).max()


over = 0.6 * (home.position(left) - start) * [1.0, 1.0, 0.0]  # the CoM moves towards the flat foot
for k in range(2000):
    t = 0.002 * k
    goals = [com.at(start + over * min(1.0, t)), squeeze.at([20.0 * min(1.0, t)])]
    tick = session.step(robot.state(q, v), *goals, heel.at(0.4 * np.clip(t - 1.0, 0.0, 1.0)))
    q, v = tick.advance()
print(session.explain(tick))
force, state = session.program.contact_forces(tick.x), robot.state(q)
rise, slip = heel.value(state)[0], np.linalg.norm(state.position("toes") - edge)
flat, toe, grip = force["foot"][2], force["toes"][2], force["box"][1]
print(f"{flat:.0f} N on the flat foot, {toe:.0f} N on the toes, {grip:.2f} N on the box")
print(f"the heel is up by {rise:.3f} rad; toes slipped {1e3 * slip:.3f} mm, hands {1e3 * off(state):.3f} mm")
assert abs(grip - 20.0) < 1e-6
assert flat > 100.0
assert abs(rise - 0.4) < 1e-3
assert slip < 2e-4
assert off(state) < 2e-4
