"""Talos shifts its load onto one foot, lifts the other and stands there, under torque control in MuJoCo."""

import numpy as np

import hqp
from hqp import DCM, PD, Level, Stack
from hqp.robots.on_mujoco import Plant
from hqp.tasks import Balance, CenterOfPressure, Com, FixedContact, FrictionCone, LoadShare, Orientation, Pose, Posture
from hqp.walking import DcmPlan, Piece, natural_frequency

robot = hqp.robots.load("talos", rotors=True)
left, right = robot.landmarks["soles"]
contacts = {s: FixedContact(frame=s) for s in (left, right)}
friction = {s: FrictionCone(contact=s, mu=0.6, torsion=0.03) for s in contacts}
within = {s: CenterOfPressure(contact=s, rectangle=(-0.09, 0.09, -0.05, 0.05)) for s in contacts}
balance, share = Balance(law=DCM(3.0), margin=0.005), LoadShare(contacts=(left, right))
foot = Pose(frame=right, law=PD(200.0, 30.0), name="foot")
first = Level(balance, Com(axes="z", name="height"))
body = [Level(Orientation(frame="base_link", name="trunk")), Level(Posture())]
both = Stack(first, *body, Level(share, price=0), subject_to=[*contacts.values(), *friction.values(), *within.values()])
alone = Stack(first, Level(foot), *body, subject_to=[contacts[left], friction[left], within[left]])
session = hqp.Controller(both, hqp.Torque(contact_law=PD(0.0, 20.0), holding=None)).session(robot, dt=0.002)
session.prepare(alone)

plant = Plant(robot)
state = robot.state(*plant.reset(robot.home.copy()))
start, over, height, placed = state.com()[:2], state.position(left)[:2], state.com()[2], foot.value(state)
pieces = [Piece(1.0, start, start), Piece(1.0, start, over), Piece(2.0, over, over)]
plan = DcmPlan(pieces, natural_frequency(height))
on_both, last, jump = True, None, 0.0
for k in range(2000):
    t = 0.002 * k
    bears = 0.5 * (1.0 - min(max(t - 1.0, 0.0), 1.0))  # the right foot's share of the load
    placed[2, 3] += 0.05 * 0.002 * (2.2 < t < 3.2)
    if on_both and t > 2.1:
        session.change(alone)
        on_both = False
    tick = session.step(
        robot.state(*plant.state()), balance.at(*plan.at(t)), share.at(bears) if on_both else foot.at(placed)
    )
    jump = jump if last is None or abs(t - 2.1) > 0.01 else max(jump, float(np.abs(tick.command - last).max()))
    last = tick.command
    plant.step(tick.command, steps=2)
print(f"right foot {1e3 * plant.place(right)[0][2]:.0f} mm up; torques changed by {jump:.2f} N m when it left")
assert plant.place(right)[0][2] > 0.04
assert plant.com()[2] > 0.95 * height
assert jump < 5.0
