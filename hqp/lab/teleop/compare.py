"""The six families through hqp and other libraries, each of these with and without the usual filter."""

from __future__ import annotations

import tempfile
from collections.abc import Callable, Sequence
from pathlib import Path
from typing import Any

import numpy as np

from hqp.arrays import Mat
from hqp.commands.manifest import manifest
from hqp.declare.law import P
from hqp.declare.stack import Stack
from hqp.lab.rivals.compare import answers
from hqp.lab.rivals.environments import environment
from hqp.lab.rivals.job import write
from hqp.lab.rivals.scenes import Scene
from hqp.loop.session import Controller
from hqp.numbers import number
from hqp.programs.formulation import Velocity
from hqp.teleoperation import Follow

from .families import FAMILIES, SECONDS, Family, family, hand_of, moved
from .measures import Felt, felt, refused
from .table import TeleopTable
from .targets import latest, smoothed

FILTERED = ", filtered"


def compare_teleop(
    stack: Stack,
    robot: Any,
    rivals: Sequence[str] = (),
    *,
    families: Sequence[str] = tuple(FAMILIES),
    seconds: float = SECONDS,
    dt: float = 0.002,
    progress: Callable[[str], None] = lambda text: None,
) -> TeleopTable:
    """Follow an operator's hand with hqp, and with rivals as their users do: the latest packet, to be met in one tick.

    hqp takes the packets through ``Follow``, with the law that the stack has.  Each rival runs twice, without and with
    exponential smoothing of 60 ms.  Raises UnsupportedProblem for a stack without a hand or with elements without a
    counterpart in rivals, HqpError if a rival cannot be installed.
    """
    dt = number("teleop", "dt", dt, 0.0, strict=True)
    seconds = number("teleop", "seconds", seconds, 0.0, strict=True)
    made = [family(name, robot, stack) for name in families]
    lines: list[Felt] = []
    progress("hqp")
    lines += [ours(one, robot, stack, seconds, dt) for one in made]
    for name in rivals:
        progress(name)
        lines += _theirs(name, environment(name, progress), made, robot, stack, seconds, dt)
    about = manifest(
        stack=str(stack), robot=robot.name, dt=dt, seconds=seconds, families={f.name: FAMILIES[f.name] for f in made}
    )
    return TeleopTable(about, tuple(sorted(lines, key=lambda line: list(families).index(line.scene))))


def ours(one: Family, robot: Any, stack: Stack, seconds: float, dt: float) -> Felt:
    """A family through ``Follow`` in closed loop, the commands carried out exactly."""
    robot = robot.copy()
    session = Controller(stack, Velocity(), deadline=np.inf).session(robot, dt)
    hand: Any = hand_of(stack)
    follow, packets, sent = Follow(hand), list(one.packets(seconds)), 0
    q, v = robot.home.copy(), np.zeros(robot.nv)
    home = np.array(hand.value(robot.state(q, v)))
    n = round(seconds / dt)
    speeds, places, failed = np.zeros((n, len(robot.joint_names))), np.zeros((n, 3)), np.zeros(n, dtype=bool)
    said: set[str] = set()
    for k in range(n):
        t = k * dt
        while sent < len(packets) and packets[sent][0] <= t:
            when, shift = packets[sent]
            follow.receive(moved(home, shift), sent=when, received=t)
            sent += 1
        state = robot.state(q, v)
        tick = session.step(state, follow.reference(state, now=t))
        places[k], speeds[k], failed[k] = state.position(hand.frame), tick.command, tick.held > 0
        if not tick.status.solved:
            said.add(tick.status.name)
        q, v = tick.advance()
    return felt("hqp", one.name, speeds, places, _operator(one, home, n, dt), failed, dt, ", ".join(sorted(said)))


def _operator(one: Family, home: Mat, n: int, dt: float) -> Mat:
    place = home if home.ndim == 1 else home[:3, 3]
    return np.array([place + one.shift(k * dt) for k in range(n)])


def _theirs(
    name: str, python: Path, made: Sequence[Family], robot: Any, stack: Stack, seconds: float, dt: float
) -> list[Felt]:
    hand: Any = hand_of(stack)
    eager = stack.with_laws({hand.name: P(1.0 / dt)})
    home = np.array(hand.value(robot.copy().state(robot.home)))
    scenes, of = [], {}
    for one in made:
        raw = latest(one, seconds, dt)
        for suffix, shifts in (("", raw), (FILTERED, smoothed(raw, dt))):
            of[one.name + suffix] = one
            scenes.append(Scene(one.name + suffix, robot.copy(), eager, _targets(hand.name, home, shifts, dt)))
    lines = []
    with tempfile.TemporaryDirectory() as held:
        folder = Path(held)
        write(folder, robot, scenes, seconds, dt)
        for scene, answer in answers(name, python, folder, scenes):
            one, suffix = of[scene.name], FILTERED if scene.name.endswith(FILTERED) else ""
            if isinstance(answer, str):
                lines.append(refused(name + suffix, one.name, answer))
                continue
            places = np.array([scene.robot.state(q).position(hand.frame) for q in answer.q])
            operator = _operator(one, home, len(places), dt)
            speeds = answer.v[:, scene.robot.actuated]
            lines.append(felt(name + suffix, one.name, speeds, places, operator, answer.failed, dt, answer.said))
    return lines


def _targets(hand: str, home: Mat, shifts: Mat, dt: float) -> Callable[[float], dict[str, Any]]:
    return lambda t: {hand: moved(home, shifts[min(round(t / dt), len(shifts) - 1)])}
