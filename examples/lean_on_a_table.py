"""Talos lowers a hand to a table until contact, leans on it beyond the edge of a foot, and lifts the other foot."""

import math

import mujoco
import numpy as np

import hqp
from hqp import PD, Level, Phase, Sequence, Stack
from hqp.robots.on_mujoco import Plant
from hqp.sequence import loaded
from hqp.tasks import (
    CenterOfPressure,
    Com,
    ContactForce,
    FixedContact,
    FrictionCone,
    JointLimits,
    LoadShare,
    Orientation,
    PointContact,
    Pose,
    Position,
    Posture,
    TorqueLimits,
)

dt, palm, finger = 0.002, "gripper_left_base_link", "gripper_left_fingertip_2_link"
top, touches, bears, beyond, lasts = 0.63, 8.0, 40.0, 0.14, 2.5
robot = hqp.robots.load("talos", rotors=True)
soles = robot.landmarks["soles"]
both, leaning = ("stand", "reach", "lean", "return"), ("lean", "lift", "return")
left, right = FixedContact(frame=soles[0], name="left"), FixedContact(frame=soles[1], name="right", when=both)
hand = PointContact(frame=finger, name="hand", when=leaning)
limits = JointLimits(acceleration=1000.0, braking=200.0)
within = [left, right, hand, TorqueLimits(), limits, FrictionCone(contact="hand", mu=0.5)]
for foot in (left, right):
    within.append(FrictionCone(contact=foot.name, mu=0.5))
    within.append(CenterOfPressure(contact=foot.name, rectangle=(-0.09, 0.09, -0.05, 0.05)))
com, trunk = Com(law=PD(60.0, 16.0), name="com"), Orientation(frame="base_link", name="trunk")
reach = Position(frame=finger, law=PD(100.0, 20.0), name="finger", when=("stand", "reach"))
swing = Pose(frame=soles[1], law=PD(200.0, 30.0), name="swing", when="lift")
push = ContactForce(contact="hand", components=("fz",), name="push")
share = LoadShare(contacts=("left", "right"))
stack = Stack(
    Level(com, trunk, reach, swing),
    Level(push, price=0),
    Level(Posture(law=PD(40.0, 13.0))),
    Level(share, price=0),
    subject_to=within,
)
steps = Sequence(
    Phase(name="stand", after=0.3),
    Phase(name="reach", until=loaded("hand", 5.0), within=4.0, late="stand"),
    Phase(name="lean", after=lasts + 0.5),
    Phase(name="lift", after=1.4, until=loaded("right", 10.0), within=3.0),
    Phase(name="return"),
)


def table(spec: mujoco.MjSpec) -> None:
    """A box beside the robot."""
    box = spec.worldbody.add_geom(name="table", pos=[0.2, 0.76, top - 0.02], size=[0.3, 0.3, 0.02])
    box.type = mujoco.mjtGeom.mjGEOM_BOX


session = hqp.Controller(stack, hqp.Torque(contact_law=PD(0.0, 20.0), holding=None), deadline=math.inf).session(
    robot, dt
)
run = steps.run(session)
plant = Plant(robot, watched=(*soles, palm), edit=table)
state = robot.state(*plant.reset(robot.home.copy()))
start, point, sole = state.com(), state.position(finger), swing.value(state)
shift, lifted, last, seen = np.array([0.0, beyond - start[1], -0.06]), sole.copy(), None, []
for _ in range(round(9.0 / dt)):
    loads, state = plant.contacts().load, robot.state(*plant.state())
    t, now = run.since, run.phase.name
    way = {"lean": t / lasts, "lift": 1.0, "return": 1.0 - t / lasts}.get(now, 0.0)
    turn = math.pi * min(max(way, 0.0), 1.0)  # half a cosine
    sign = {"lean": 1.0, "return": -1.0}.get(now, 0.0) * math.pi / lasts
    leans, rate, bend = 0.5 - 0.5 * math.cos(turn), 0.5 * sign * math.sin(turn), 0.5 * sign**2 * math.cos(turn)
    if now == "reach":
        point += [0.0, 0.06 * dt, -0.03 * dt]
    if now == "lift":
        up = 0.025 * (1.0 - math.cos(2.0 * math.pi * min(t / 1.4, 1.0)))
        lifted[2, 3] = sole[2, 3] + up - 0.03 * max(t - 1.4, 0.0)  # down until contact
    tick = run.step(
        state,
        com.at(start + leans * shift, velocity=rate * shift, acceleration=bend * shift),
        reach.at(point),
        swing.at(lifted),
        push.at([touches + leans * (bears - touches)]),
        share.at(0.5 * (1.0 - leans)),
        *(contact.at().loaded(load) for contact, load in zip((left, right, hand), loads, strict=True)),
    )
    if tick.event:
        print(f"{plant.time:.2f} s  {tick.event}: feet and hand bear {loads.round(0)} N")
    jump = 0.0 if last is None else float(np.abs(tick.command - last).max())
    seen.append((jump, bool(tick.event), loads[2], plant.place(soles[1])[0][2], plant.com()[1], tick.status.solved))
    last = tick.command
    plant.step(tick.command, steps=2)
jumps, switch, hand_load, height, aside, solved = (np.array(column) for column in zip(*seen, strict=True))
in_the_air, edge = height > 0.03, -sole[1, 3] + 0.05  # inner edge of the left sole
print(f"foot {1e3 * height.max():.0f} mm up while the hand bears {hand_load[in_the_air].mean():.0f} N")
print(f"CoM {1e3 * (aside[in_the_air].min() - edge):.1f} mm beyond the sole; {100.0 * solved.mean():.2f} % solved")
print(f"torques change by {jumps[switch][1:].max():.1f} N m at switches, {jumps[~switch].max():.1f} elsewhere")
assert height.max() > 0.04
assert aside[in_the_air].min() > edge
assert jumps.max() < 20.0
assert run.phase.name == "return"
assert plant.com()[2] > 0.95 * start[2]
