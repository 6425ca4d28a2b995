"""An operator's hand over a bad network: UR5 follows despite lost, repeated and wrong packets."""

import numpy as np

import hqp
from hqp import Level, P, Stack
from hqp.tasks import JointLimits, Pose, Posture

robot = hqp.robots.load("ur5")
hand = Pose(frame="tool0", law=P(8.0), name="hand")
stack = Stack(Level(hand), Level(Posture()), subject_to=[JointLimits()])
session = hqp.Controller(stack, braking=hqp.Braking(resume="ask")).session(robot, dt=0.002, max_age=0.02)
follow = hqp.Follow(hand)

q = robot.integrate(robot.home, np.array([0.3, -1.4, 1.5, -1.2, -1.3, 0.2]), 1.0)
v, rng, sent, told = np.zeros(robot.nv), np.random.default_rng(0), 0, set()
home = hand.value(robot.state(q))


def operator(t):
    """10 cm to either side, once in 2 s."""
    pose = home.copy()
    pose[1, 3] += 0.1 * min(t, 1.0) ** 3 * np.sin(np.pi * t)
    return pose


for k in range(2500):
    t = k * 0.002
    while sent / 72.0 <= t:  # a headset's rate
        when, fate = sent / 72.0, rng.random()
        pose = operator(when)
        if fate < 0.05:  # the tracker mistakes another object for the hand
            pose[:3, 3] += (0.0, 0.0, 2.0)
        if not 2.0 < when < 2.3 and fate < 0.95:  # a gap of 0.3 s, and single lost packets
            for _ in range(1 + (fate > 0.9)):
                follow.receive(pose, sent=when, received=t)
        sent += 1
    state = robot.state(q, v, time=t)
    tick = session.step(state, follow.reference(state, now=t), now=t)
    off = np.linalg.norm(state.position("tool0") - operator(t)[:3, 3])
    for note in tick.notes:
        kind = "".join(c for c in note.detail if not c.isdigit())
        if kind not in told:
            told.add(kind)
            print(f"{t:5.2f} s: {note.detail}")
    if k % 250 == 0:
        print(f"{t:5.2f} s: {1e3 * off:5.1f} mm from the operator")
    q, v = tick.advance()
