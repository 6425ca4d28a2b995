"""python -m benchmarks.walking.beside_placo: placo's plan of a walk, ours and the walker, on servos in one Plant."""

from __future__ import annotations

import json
import math
import subprocess
import tempfile
from pathlib import Path

import numpy as np

import hqp.robots
from hqp.arrays import Mat
from hqp.lab.rivals.environments import environment
from hqp.lab.rivals.urdf import urdf
from hqp.markdown import table
from hqp.robots.on_mujoco import Plane, Plant, Servo
from hqp.walking import Walker
from hqp.walking.course import FALLEN, Course
from hqp.walking.feet import base_of

CASES = (("talos", 3000.0), ("talos", 1000.0), ("g1", 500.0), ("g1", 100.0))
"""Robots, and the stiffness of their servos [N m/rad]."""

DT, SPEED, STEPS, SECONDS = 0.002, 0.2, 12, 10.4
STANDS, GOES, STOPS = 0.5, 0.6, 8.4
"""Times at which a replay begins, the walker starts, and the walker stops [s]."""

DAMPING = 0.03
"""Damping of the servos by their stiffness [s]."""


def main() -> int:
    """Run all cases and print the table."""
    rows = []
    plans: dict[str, Mat] = {}
    for name, kp in CASES:
        if name not in plans:
            plans[name] = _placo(name)
        walker = _walker(name)
        walker.go(SPEED)
        ours = walker.plan(SECONDS, fps=1.0 / DT).q
        found = (_replayed(name, plans[name], kp), _replayed(name, ours, kp), _walked(name, kp))
        rows.append((f"{name}, {kp:g}", *found))
        print(" | ".join(rows[-1]), flush=True)
    print(table(("robot, kp [N m/rad]", "placo's plan", "`walker.plan`", "the walker"), rows))
    return 0


def _walker(name: str) -> Walker:
    return Walker(hqp.robots.load(name, rotors=True), dt=DT, deadline=math.inf)


def _placo(name: str) -> Mat:
    """Joint angles of placo's walk, with the walker's soles, height, times and lift ``(n, nq)``."""
    walker = _walker(name)
    robot, frames = walker.robot, [*(foot.frame for foot in walker.feet), base_of(walker.robot)]
    text = urdf(robot, frames)
    for own, theirs in zip(frames, ("left_foot", "right_foot", "trunk"), strict=True):
        text = text.replace(f'"{own}"', f'"{theirs}"').replace(f'"fix_{own}"', f'"fix_{theirs}"')
    corners = np.array(walker.feet[0].corners)
    low, high = corners.min(axis=0), corners.max(axis=0)
    gait = walker.gait
    asked = {
        "urdf": text, "names": list(robot.joint_names), "q": walker.start.tolist(),
        "height": walker.height, "spacing": walker.footsteps.width, "length": float(high[0] - low[0]),
        "width": float(high[1] - low[1]), "middle": float(0.5 * (high[0] + low[0])), "single": gait.single,
        "double": gait.double, "first": gait.first, "lift": gait.height, "speed": SPEED, "steps": STEPS,
        "legs": [name for foot in walker.feet for name in foot.leg],
    }  # fmt: skip
    worker = Path(__file__).parent / "workers" / "placo_plan.py"
    with tempfile.TemporaryDirectory() as kept:
        question, answer = Path(kept) / "question.json", Path(kept) / "answer.npz"
        question.write_text(json.dumps(asked), encoding="utf-8")
        subprocess.run([str(environment("placo", print)), str(worker), str(question), str(answer)], check=True)
        return np.asarray(np.load(answer)["q"])


def _replayed(name: str, q: Mat, kp: float) -> str:
    """Distance that a plan covers on servos, open loop."""
    walker = _walker(name)
    robot, soles = walker.robot, [foot.frame for foot in walker.feet]
    servo, floor = Servo(other=kp, damping_time=DAMPING), Plane(friction=0.5)
    plant = Plant(robot, terrain=floor, watched=soles, actuation="position", servo=servo, imu=base_of(robot))
    plant.reset(q[0].copy())
    rates = np.vstack((np.diff(q[:, 7:], axis=0) / DT, np.zeros((1, q.shape[1] - 7))))
    for _ in range(round(STANDS / DT)):
        plant.step(q[0, 7:], 0.0 * rates[0], steps=2)
    start = plant.com()[0]
    for k in range(len(q) + round(1.0 / DT)):
        i = min(k, len(q) - 1)
        plant.step(q[i, 7:], rates[i], steps=2)
        if plant.com()[2] - min(plant.place(sole)[0][2] for sole in soles) < FALLEN * walker.height:
            return f"falls, {k * DT:.1f} s"
    return f"{plant.com()[0] - start:.2f} m"


def _walked(name: str, kp: float) -> str:
    """Distance that the walker covers on these servos, on the true state."""
    walker = _walker(name)
    servo = Servo(other=kp, damping_time=DAMPING)
    course = Course(walker, sensors=None, delay=0.0, servo=servo, terrain=Plane(friction=0.5))
    start = course.plant.com()[0]
    while course.plant.time < SECONDS:
        if GOES < course.plant.time < STOPS and not walker.walking:
            walker.go(SPEED)
        if course.plant.time > STOPS and walker.walking:
            walker.stop()
        course.step()
        if course.fallen:
            return f"falls, {course.plant.time:.1f} s"
    return f"{course.plant.com()[0] - start:.2f} m"


if __name__ == "__main__":
    raise SystemExit(main())
