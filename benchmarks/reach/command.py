"""``hqp.reach`` to poses of random configurations inside the limits and free of collisions, beside other libraries."""

from __future__ import annotations

import argparse
import json
import math
import os
import subprocess
import tempfile
import time
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np

import hqp
from benchmarks.reports import report
from hqp import Level, Stack
from hqp.arrays import Mat, Vec
from hqp.errors import HqpError
from hqp.lab.rivals.environments import environment
from hqp.tasks import CollisionAvoidance, Pose

WRISTS = ("left_wrist_yaw_link", "right_wrist_yaw_link")
CASES = {
    "UR5, `tool0`": ("ur5", ("tool0",), {}, False),
    "Panda, `panda_hand_tcp`": ("panda", ("panda_hand_tcp",), {}, False),
    "Panda, started with its elbow at the limit": ("panda", ("panda_hand_tcp",), {3: "upper"}, False),
    "G1, both wrists": ("g1", WRISTS, {}, False),
    "UR5, without collisions": ("ur5", ("tool0",), {}, True),
    "Panda, without collisions": ("panda", ("panda_hand_tcp",), {}, True),
    "G1, without collisions": ("g1", WRISTS, {}, True),
}
"""Robot, frames, joints that start at a limit, and true if links must keep apart."""
APART = CollisionAvoidance(clearance=1e-3, influence=0.05)
WITHIN = 1e-3
"""Largest error of a reached pose [m], [rad]."""
LEAST = 0.995
"""Least share of poses reached."""
RIVALS = {
    "roboplan": ("roboplan==0.7.0", "pin"),
    "optik": ("optik-py==0.5.0", "numpy"),
    "trac_ik": ("pytracik==0.0.3", "numpy<2"),
}
"""Packages of each library's own environment; all but roboplan solve for one frame."""
PAGE = Path(__file__).parents[2] / "docs" / "results" / "inverse-kinematics.md"
MARK = "<!-- table: python -m benchmarks reach --rivals roboplan optik trac_ik --page -->"
"""Marks the table of the page."""


@dataclass(frozen=True)
class Outcome:
    """Outcome of one case: poses reached, poses reached from the first start, times of all poses [s]."""

    reached: int
    first: int
    times: Vec

    def __str__(self) -> str:
        return f"{1e3 * float(np.median(self.times)):.3f}, {1e3 * float(np.mean(self.times)):.2f} ms"


def add_arguments(parser: argparse.ArgumentParser) -> None:
    """Options of this part."""
    parser.add_argument("--count", type=int, default=1000, help="poses of each robot (1000)")
    parser.add_argument("--rounds", type=int, default=2, help="by turns; the one with the lower median counts (2)")
    parser.add_argument("--rivals", nargs="+", choices=RIVALS, default=[], help="other libraries, on the same poses")
    parser.add_argument("--page", action="store_true", help=f"write the table into {PAGE.name}")


def run(arguments: argparse.Namespace) -> int:
    """Measure, show, write; returns 1 if too few poses are reached."""
    count = 50 if arguments.quick else arguments.count
    header = ["robot", "reached", "from the first start", "median, mean", *arguments.rivals]
    rows, failed = [], False
    for title, (name, frames, moved, apart) in CASES.items():
        robot = hqp.robots.load(name, floating=False)
        start = robot.home.copy()
        for joint, side in moved.items():
            start[joint] = getattr(robot, side)[joint]
        poses = reachable(robot, frames, count)
        ours: list[Outcome] = []
        theirs: dict[str, list[Outcome]] = {rival: [] for rival in arguments.rivals}
        for _ in range(arguments.rounds):
            ours.append(measured(robot, frames, start, poses, apart))
            for rival, found in theirs.items():
                if not apart and (len(frames) == 1 or rival == "roboplan"):
                    found.append(beside(rival, robot, frames, start, poses))
        least = best(ours)
        failed |= least.reached < LEAST * count
        row = [title, f"{least.reached} of {count}", str(least.first), str(least)]
        for found in theirs.values():
            row.append(f"{best(found).reached}: {best(found)}" if found else "")
        rows.append(row)
        report.console.print(", ".join(row))
    text = report.table(header, rows)
    report.section(arguments.output, "reach", text)
    if arguments.page:
        head, mark, rest = PAGE.read_text().partition(MARK)
        tail = rest.split("\n\n", 2)[2] if mark else ""
        PAGE.write_text(f"{head}{MARK}\n\n{text.strip()}\n\n{tail}")
    if arguments.json is not None:
        arguments.json.write_text(json.dumps(rows, indent=1))
    return int(failed)


def reachable(robot: Any, frames: tuple[str, ...], count: int) -> Mat:
    """Poses of frames ``(count, k, 4, 4)`` in random configurations inside the limits and free of collisions."""
    apart, rng = CollisionAvoidance(clearance=0.0), np.random.default_rng(1)
    lower, upper = np.maximum(robot.lower, -math.pi), np.minimum(robot.upper, math.pi)
    found: list[list[Mat]] = []
    while len(found) < count:
        step = rng.uniform(lower, upper) - robot.state(robot.home).angles
        state = robot.state(robot.integrate(robot.home, step, 1.0))
        if all(near is None or near.distance > 0.0 for near in apart.near(state)):
            found.append([Pose(frame=f).value(state) for f in frames])
    return np.array(found)


def measured(robot: Any, frames: tuple[str, ...], start: Vec, poses: Mat, apart: bool) -> Outcome:
    """Reach each pose by ``hqp.reach`` with its defaults; leave out a stack's first call, which compiles it."""
    hands = [Pose(frame=f) for f in frames]
    stack = Stack(Level(*hands), subject_to=[APART] if apart else ())
    hqp.reach(stack, robot, *(h.at(p) for h, p in zip(hands, poses[0], strict=True)), q0=start)
    times, reached, first = [], 0, 0
    for k, goal in enumerate(poses):
        references = [h.at(p) for h, p in zip(hands, goal, strict=True)]
        begin = time.process_time()
        found = hqp.reach(stack, robot, *references, q0=start, seed=k)
        times.append(time.process_time() - begin)
        good = found.success and there(robot, frames, found.q, goal)
        if apart:
            good &= all(near is None or near.distance > 0.0 for near in APART.near(robot.state(found.q)))
        reached, first = reached + good, first + (good and found.starts == 1)
    return Outcome(reached, first, np.array(times))


def there(robot: Any, frames: tuple[str, ...], q: Vec, goal: Mat) -> bool:
    """Return true if frames are at their poses and joints inside their limits."""
    state = robot.state(np.asarray(q, dtype=np.float64))
    if np.any(state.angles < robot.lower - 1e-9) or np.any(state.angles > robot.upper + 1e-9):
        return False
    errors = [
        (state.position(f) - T[:3, 3], robot.log3(state.rotation(f) @ T[:3, :3].T))
        for f, T in zip(frames, goal, strict=True)
    ]
    return all(float(np.linalg.norm(e)) < WITHIN for pair in errors for e in pair)


def best(found: list[Outcome]) -> Outcome:
    """Select the round with the least median."""
    return min(found, key=lambda outcome: float(np.median(outcome.times)))


def beside(rival: str, robot: Any, frames: tuple[str, ...], start: Vec, poses: Mat) -> Outcome:
    """Reach the poses by another library; raises HqpError if it does not run."""
    python = environment(rival, report.console.print, RIVALS)
    script = Path(__file__).parent / "workers" / f"with_{rival}.py"
    env = {k: v for k, v in os.environ.items() if k not in ("PYTHONPATH", "PYTHONHOME", "VIRTUAL_ENV")}
    with tempfile.TemporaryDirectory() as folder:
        file = Path(folder) / "poses.npz"
        data = {"poses": poses, "start": start, "lower": robot.lower, "upper": robot.upper}
        data |= {"frames": np.array(frames), "joints": np.array(robot.joint_names)}
        np.savez(file, source=np.array(str(robot.source)), **data)
        command = [str(python), str(script), str(file)]
        result = subprocess.run(command, capture_output=True, text=True, check=False, env=env)
    if result.returncode:
        raise HqpError(f"{rival} does not run:\n{result.stderr[-2000:]}")
    told = json.loads(result.stdout.strip().splitlines()[-1])
    good = sum(t and there(robot, frames, q, p) for t, q, p in zip(told["told"], told["q"], poses, strict=True))
    return Outcome(good, 0, np.array(told["times"]))
