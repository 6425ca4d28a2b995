"""Many worlds at once on G1 and UR5: ticks per second in reach, at its edge and beyond; memory; construction time."""

from __future__ import annotations

import argparse
import time
from dataclasses import dataclass
from pathlib import Path

import numpy as np

import hqp
import hqp.tasks as t
from benchmarks.reports import machine, report
from hqp import Level, Stack
from hqp.arrays import Mat
from hqp.export.loaded import LoadedSession
from hqp.loop.file import text
from hqp.markdown import table

DT = 0.002
MARK = "<!-- table: python -m benchmarks batches --page docs/results/batches.md -->"
END = "<!-- end of batches -->"
AWAY = {"in reach": 0.02, "at its edge": 0.1, "beyond": 0.3}
"""Amplitudes of the targets around the hands' first places, on each axis [m]."""


def add_arguments(parser: argparse.ArgumentParser) -> None:
    """Options of this part."""
    parser.add_argument("--worlds", type=int, default=4096, metavar="N", help="default 4096")
    parser.add_argument("--ticks", type=int, default=None, metavar="N", help="ticks of a world, default 60")
    parser.add_argument("--threads", nargs="+", type=int, default=[1, 2], metavar="N", help="default: 1 2")
    parser.add_argument("--page", type=Path, metavar="FILE", help="write the table into this page")


@dataclass(frozen=True)
class Measured:
    """Measurements over the last half of the ticks: ticks per second, the best of five parts; CPU time of a tick [s].

    bytes of a world, time to construct all [s], share of solved ticks.
    """

    rate: float
    cpu: float
    bytes: float
    made: float
    solved: float


def run(arguments: argparse.Namespace) -> int:
    """Measure and show."""
    count = arguments.ticks or (20 if arguments.quick else 60)
    rows = []
    for name in ("g1", "ur5"):
        for where, away in AWAY.items():
            found = [measure(name, away, arguments.worlds, count, threads) for threads in arguments.threads]
            alone = session_rate(name, away, count)
            figures = (found[0].cpu * 1e6, found[0].bytes / 1e3, found[0].made * 1e3, found[0].solved * 1e2)
            rates = [f"{round(rate, -2):,.0f}" for rate in (*(one.rate for one in found), alone)]
            rows.append([name, where, f"{figures[0]:.1f}", *rates, *(f"{figure:.1f}" for figure in figures[1:])])
    heads = [f"{n} thread{'s' * (n > 1)} [1/s]" for n in arguments.threads]
    labels = [
        "robot",
        "targets",
        "CPU a tick [us]",
        *heads,
        "`session.step` [1/s]",
        "kB a world",
        "made in [ms]",
        "solved [%]",
    ]
    text = f"{table(labels, rows)}\n\n{machine.line()}\n"
    print(text)
    if arguments.page is not None:
        report.into_page(arguments.page, MARK, text, END)
    return 0


def controller(name: str) -> tuple[hqp.Controller, hqp.robots.Robot, list[str]]:
    """G1 on both feet, balance, two hands, pelvis, posture, limits; UR5 with hand, posture, limits; the frames."""
    robot = hqp.robots.load(name)
    marks = robot.landmarks
    held = [t.JointLimits(), *(t.FixedContact(frame=sole) for sole in marks.get("soles", ()))]
    frames = list(marks.get("palms") or marks.get("tools") or robot.frame_names[-1:])
    hands = Level(*(t.Position(frame=frame, name=f"hand{k}") for k, frame in enumerate(frames)))
    posture = Level(t.Posture())
    if name != "g1":
        return hqp.Controller(Stack(hands, posture, subject_to=held)), robot, frames
    balance, pelvis = Level(t.Com(axes="xy", name="balance")), Level(t.Orientation(frame="pelvis", name="pelvis"))
    return hqp.Controller(Stack(balance, hands, pelvis, posture, subject_to=held)), robot, frames


class Motion:
    """Targets that circle the hands' first places, each world with its own phase."""

    def __init__(self, robot: hqp.robots.Robot, frames: list[str], away: float, count: int) -> None:
        state = robot.state(robot.home)
        self._start = [np.asarray(state.position(frame)) for frame in frames]
        self._phase = np.random.default_rng(0).uniform(0.0, 2.0 * np.pi, (count, len(frames), 3))
        self._away = away

    def at(self, i: int) -> dict[str, Mat]:
        """Targets of tick i, (count, 3) for each hand."""
        return {
            f"hand{k}": start + self._away * np.sin(0.01 * i + self._phase[:, k]) for k, start in enumerate(self._start)
        }


def measure(name: str, away: float, worlds: int, ticks: int, threads: int) -> Measured:
    """Run a kinematic loop of all worlds; only the batch's step is timed."""
    declared, robot, frames = controller(name)
    motion = Motion(robot, frames, away, worlds)
    file = LoadedSession(text(declared.session(robot, DT)))
    began = time.perf_counter()
    batch = hqp.Batch(declared, robot, worlds, DT, threads=threads)
    made = time.perf_counter() - began
    Q, V = np.tile(robot.home, (worlds, 1)), np.zeros((worlds, robot.nv))
    times, busy = [], []
    for i in range(ticks):
        targets = motion.at(i)
        began, spent = time.perf_counter(), time.process_time()
        tick = batch.step(Q, V, targets)
        times.append(time.perf_counter() - began)
        busy.append(time.process_time() - spent)
        V = tick.x
        for k in range(worlds):
            Q[k] = file.advance(Q[k], V[k])
    parts = np.array_split(times[ticks // 2 :], 5)
    return Measured(
        rate=worlds / min(float(np.mean(part)) for part in parts),
        cpu=float(np.median(busy[ticks // 2 :])) / worlds,
        bytes=batch.bytes / worlds,
        made=made,
        solved=float(tick.solved.mean()),
    )


def session_rate(name: str, away: float, ticks: int, worlds: int = 20) -> float:
    """Ticks per second of single sessions from files, from Python: mean over sessions of the median tick."""
    declared, robot, frames = controller(name)
    motion = Motion(robot, frames, away, worlds)
    session = LoadedSession(text(declared.session(robot, DT)))
    medians = []
    for k in range(worlds):
        session.reset()
        q, v, times = robot.home, np.zeros(robot.nv), []
        for i in range(ticks):
            targets = {name: values[k] for name, values in motion.at(i).items()}
            began = time.perf_counter()
            tick = session.step(q, v, targets)
            times.append(time.perf_counter() - began)
            q, v = session.advance(q, tick.x), tick.x
        medians.append(float(np.median(times[ticks // 2 :])))
    return 1.0 / float(np.mean(medians))
