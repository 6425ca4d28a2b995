"""Scenes through hqp and its rivals, in turns, judged by the same measures from the states alone."""

from __future__ import annotations

import json
import os
import subprocess
import tempfile
from collections.abc import Callable, Iterator, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np

from hqp.arrays import Mask, Mat, Vec
from hqp.commands.manifest import manifest
from hqp.declare.law import PD, Law
from hqp.declare.stack import Level, Stack
from hqp.errors import HqpError
from hqp.lab.behaviour import behaviour
from hqp.lab.run import run
from hqp.lab.trajectory import Trajectory
from hqp.numbers import number, whole
from hqp.programs.formulation import Velocity
from hqp.solvers import load
from hqp.tasks import CenterOfPressure, FrictionCone, TorqueLimits
from hqp.torque import Torque

from .environments import RIVALS, environment
from .job import gain, write
from .scenes import SCENES, Scene, scene
from .table import Line, RivalTable, line

EXACT, TORQUE = "hqp, price 0", "hqp, torques"
"""The exact problem without calm; compare it with tsid, which solves for accelerations and forces too."""

SOLE = (-0.1, 0.1, -0.05, 0.05)
"""Rectangle of a foot [m]."""

SAME = 1e-5
"""Allowed difference of the centre of mass in another library; beyond it the robot differs [m]."""


def compare_rivals(
    stack: Stack,
    robot: Any,
    rivals: Sequence[str] = tuple(RIVALS),
    *,
    scenes: Sequence[str] = tuple(SCENES),
    seconds: float = 2.0,
    dt: float = 0.002,
    rounds: int = 3,
    progress: Callable[[str], None] = lambda text: None,
) -> RivalTable:
    """Run a stack in closed loop with hqp and with rivals, each in its own environment, which is made where needed.

    Levels become weights where a library has none: costs 100, 10, 1, ... for tasks, and hard constraints if it supports
    them. The first scene is run in ``rounds`` turns of all libraries; its times are those of the round with the least
    median. Raises UnsupportedProblem for a stack with elements that rivals are not given, HqpError where one cannot be
    installed or its robot is another.
    """
    for name, value in (("dt", dt), ("seconds", seconds)):
        number("rivals", name, value, 0.0, strict=True)
    rounds = whole("rivals", "rounds", rounds, 1)
    made = [scene(name, robot, stack) for name in scenes]
    places = {name: environment(name, progress) for name in rivals}
    found: list[Line] = []
    with tempfile.TemporaryDirectory() as held:
        folder = Path(held)
        write(folder, robot, made, seconds, dt)
        for turn in range(rounds):
            part = made if turn == 0 else made[:1]
            progress(f"hqp, round {turn + 1} of {rounds}")
            found += _ours(part, seconds, dt, "hqp")
            found += _ours(part, seconds, dt, EXACT)
            if "tsid" in rivals:
                found += _ours(part, seconds, dt, TORQUE)
            for name in rivals:
                progress(f"{name}, round {turn + 1} of {rounds}")
                found += _theirs(name, places[name], folder, part, seconds, dt)
    about = manifest(
        stack=str(stack), robot=robot.name, dt=dt, seconds=seconds, rounds=rounds,
        rivals={name: list(RIVALS[name]) for name in rivals}, scenes={name: SCENES[name] for name in scenes},
    )  # fmt: skip
    return RivalTable(about, tuple(_best(found)))


def _best(found: list[Line]) -> list[Line]:
    """Return the round of a scene with the least median."""
    kept: dict[tuple[str, str], Line] = {}
    for one in found:
        key = one.library, one.scene
        if key not in kept or one.p50_us < kept[key].p50_us:
            kept[key] = one
    return list(kept.values())


def _ours(scenes: Sequence[Scene], seconds: float, dt: float, which: str) -> list[Line]:
    """hqp at velocity level, with exact levels, or at torque level: the feet's forces inside cones as tsid has them."""
    lines, torque = [], which == TORQUE
    formulation = Torque(contact_law=PD(0.0, 40.0)) if torque else Velocity()
    for s in scenes:
        motion = _motion(s, seconds)
        done = run(
            _torque_stack(s.stack) if torque else s.stack, s.robot, load(), "hqp", formulation, motion,
            dt=dt, ticks=round(seconds / dt), plant="integrator", certify_every=10**9, progress=lambda k: None,
            price=0 if which == EXACT else None,
        )  # fmt: skip
        statuses = {status for status in done.statuses if status not in ("OPTIMAL", "NOT_STRICT")}
        speeds = done.rates[:, s.robot.actuated]
        said = ", ".join(sorted(statuses))
        lines.append(line(which, s.name, done.total, speeds, done.behaviour, dt, 0, said))
    return lines


def _torque_stack(stack: Stack) -> Stack:
    """Laws of second order, torque limits, contacts as constraints with friction and centre of pressure."""
    second: dict[str, Law] = {
        e.name: PD(4.0 * gain(e) ** 2, 4.0 * gain(e)) for e in stack if e.equality and not e.is_contact
    }
    stack = stack.with_laws(second)
    contacts = [e for e in stack if e.is_contact and e.equality]
    kept = [[e for e in level if e not in contacts] for level in stack.levels]
    levels = [Level(*own, name=level.name) for level, own in zip(stack.levels, kept, strict=True) if own]
    cones: list[Any] = []
    for contact in contacts:
        cones += [FrictionCone(contact=contact.name, mu=0.6), CenterOfPressure(contact=contact.name, rectangle=SOLE)]
    rest = [e for e in stack.subject_to if e not in contacts]
    motors = [] if any(isinstance(e, TorqueLimits) for e in rest) else [TorqueLimits()]
    return Stack(*levels, subject_to=[*motors, *contacts, *cones, *rest])


def _motion(s: Scene, seconds: float) -> Trajectory:
    """Trajectory of the scene with the values of frames that are held elsewhere."""
    base = Trajectory(s.motion, s.stack, s.robot, seconds)

    def values(t: float) -> dict[str, Any]:
        places = {n: x[0] if isinstance(x, tuple) else x for n, x in base.values(t).items()}  # rivals take no velocity
        return {**places, **s.held}

    return Trajectory(values, s.stack, s.robot, seconds)


def _theirs(name: str, python: Path, folder: Path, scenes: Sequence[Scene], seconds: float, dt: float) -> list[Line]:
    lines = []
    for s, found in answers(name, python, folder, scenes):
        if isinstance(found, str):
            lines.append(Line.refused(name, s.name, found))
            continue
        judged = behaviour(s.robot, s.stack, _motion(s, seconds), found.q, found.v, dt)
        commands = found.v[:, s.robot.actuated]
        lines.append(line(name, s.name, found.wall, commands, judged, dt, int(found.failed.sum()), found.said))
    return lines


@dataclass(frozen=True)
class Answer:
    """Result of a rival in a scene: q ``(n, nq)``, v ``(n, nv)`` in our coordinates, wall ``(n,)`` [us], ticks without
    an answer ``(n,)``, and the message of the first of them."""

    q: Mat
    v: Mat
    wall: Vec
    failed: Mask
    said: str


def answers(name: str, python: Path, folder: Path, scenes: Sequence[Scene]) -> Iterator[tuple[Scene, Answer | str]]:
    """Run scenes, written to a folder, in a rival's environment: its answer to each, or why it refuses it.

    Raises HqpError where it fails or reads another robot.
    """
    script = Path(__file__).parent / "workers" / f"with_{name}.py"
    env = {k: v for k, v in os.environ.items() if k not in ("PYTHONPATH", "PYTHONHOME", "VIRTUAL_ENV")}
    env |= {"OMP_NUM_THREADS": "1", "OPENBLAS_NUM_THREADS": "1", "MKL_NUM_THREADS": "1"}
    command = [str(python), str(script), str(folder), *(s.name for s in scenes)]
    done = subprocess.run(command, capture_output=True, text=True, env=env, check=False)
    if done.returncode:
        said = (done.stderr or done.stdout).strip().splitlines()
        raise HqpError(f"{name} failed: {said[-1] if said else f'status {done.returncode}'}")
    about = json.loads((folder / "answer.json").read_text())
    arrays = np.load(folder / "answer.npz")
    for s in scenes:
        answer = about[s.name]
        if "refused" in answer:
            yield s, str(answer["refused"])
            continue
        home = s.robot.state(s.robot.home)
        if float(np.abs(home.com() - answer["com"]).max()) > SAME:
            raise HqpError(f"{name} reads another robot: centre of mass {answer['com']}, here {home.com().tolist()}")
        part = {key: arrays[f"{s.name}/{key}"] for key in ("wall", "failed", "base", "angles", "speeds")}
        q, v = _states(s.robot, part["base"], part["angles"], part["speeds"])
        yield s, Answer(q, v, part["wall"], part["failed"], answer["failed"])


def _states(robot: Any, base: Mat, angles: Mat, speeds: Mat) -> tuple[Mat, Mat]:
    """Our coordinates of another library's states."""
    columns = [int(c) for c in robot.joints(None)]
    q, v = np.zeros((len(base), robot.nq)), np.zeros((len(base), robot.nv))
    start = robot.state(robot.home).angles
    step: Vec = np.zeros(robot.nv)
    for k in range(len(base)):
        step[columns] = angles[k] - start[columns]
        q[k] = robot.integrate(robot.home, step, 1.0)
        if robot.floating:
            q[k, :7] = base[k]
        v[k, columns] = speeds[k]
    return q, v
