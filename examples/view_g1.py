"""G1 in the browser: drag the hand's target and see which tasks deviate.  Needs hqp[view]; argument: duration [s]."""

import sys
import time

import numpy as np

import hqp
from hqp import Level, P, Stack
from hqp.tasks import Com, FixedContact, JointLimits, Orientation, Position, Posture

robot = hqp.robots.load("g1")
left, right = robot.landmarks["soles"]
stack = Stack(
    Level(
        FixedContact(frame=left, name="left_foot"),
        FixedContact(frame=right, name="right_foot"),
        Com(axes="xy", law=P(2.0)),
        name="balance",
    ),
    Level(Position(frame="right_wrist_yaw_link", law=P(5.0, max_velocity=0.5), name="right_hand"), name="hand"),
    Level(Orientation(frame="pelvis", law=P(2.0)), name="base"),
    Level(Posture(law=P(1.0)), name="posture"),
    subject_to=[JointLimits()],
)
session = hqp.Controller(stack).session(robot, dt=0.002)
seconds = float(sys.argv[1]) if len(sys.argv) > 1 else 600.0
q, v = robot.home, np.zeros(robot.nv)
with hqp.view(session, control=True) as view:
    print(f"open {view.url}", flush=True)
    end = time.perf_counter() + seconds
    while time.perf_counter() < end:
        view.wait()  # while the page is paused
        tick = view.step(robot.state(q, v))
        q, v = tick.advance()
        time.sleep(0.002)
