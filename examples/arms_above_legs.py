"""G1's arms above legs that another controller moves: it squats, and both hands hold their places."""

import numpy as np

import hqp
from hqp.tasks import PrescribedMotion

robot = hqp.robots.load("g1")
LEGS = robot.joint_names[:12]
given = PrescribedMotion(joints=LEGS).selection(robot)  # coordinates of base and legs
arms = hqp.UpperBody(legs=LEGS, trunk="torso_link", output="velocities").session(robot, dt=0.01, max_age=0.05)

q, v = robot.home.copy(), np.zeros(robot.nv)
bend = np.zeros(robot.nv)  # amplitude of a squat [rad, m]: hips and ankles half of the knees, the pelvis moves down
for side in ("left", "right"):
    for joint, share in (("hip_pitch", -1.0), ("knee", 2.0), ("ankle_pitch", -1.0)):
        bend[robot.joints(f"{side}_{joint}_joint")] = 0.25 * share
sole = robot.landmarks["soles"][0]
height = robot.state(q).position(sole)[2]

for k in range(300):
    v[:] = 0.0
    v[given] = bend[given] * np.pi / 3.0 * np.sin(2.0 * np.pi * k * 0.01 / 3.0)  # the other controller's
    state = robot.state(q, v)
    v[2] = -float(state.jacobian(sole)[2, 6:] @ v[6:])  # the soles stay on the ground
    state = robot.state(q, v, time=0.01 * k)
    if k == 0:
        places = [hand.value(state) for hand in arms.hands]
    goals = [hand.at(place) for hand, place in zip(arms.hands, places, strict=True)]
    tick = arms.step(state, *goals, now=0.01 * k)
    v[arms.columns] = tick.velocities
    q = robot.integrate(q, v, 0.01)
    if k % 50 == 0:
        now = [hand.value(robot.state(q)) for hand in arms.hands]
        off = max(np.linalg.norm((there - place)[:3, 3]) for there, place in zip(now, places, strict=True))
        print(f"{k * 0.01:4.1f} s: pelvis at {q[2]:.3f} m, hands off by {1e3 * off:4.1f} mm, {tick.tick.status.name}")
print(f"soles moved by {1e3 * (robot.state(q).position(sole)[2] - height):.2f} mm")
