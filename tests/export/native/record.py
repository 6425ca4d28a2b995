"""Write the plan of a session and a loop of it, for replay.cpp: ``python -m tests.export.native.record ROBOT ...``."""

from __future__ import annotations

import argparse
import struct
from pathlib import Path

import numpy as np

from hqp import PD, P, Phase, Sequence
from hqp.arrays import Mat, Vec
from hqp.explanation.notes import STATUSES
from hqp.export.loaded import HOLD, VALUE, LoadedSession
from hqp.loop.file import text
from tests.scenes.stacks import FORMULATIONS, ROBOTS, scene

PRESENT, PHASE = 6, 7
"""Kinds of records after value, velocity, acceleration, normal, load and hold value: presence of an element; phase of a
tick, whose name is its number."""

AWAY = (("hand",), ("turn",), ("hand", "turn"), ())
"""Elements switched off for ten ticks of each fifty, in turns."""


def phases(formulation: str) -> Sequence:
    """Phases with new laws that begin before the change to the previous ones has ended."""
    hand, posture = PD((90.0, 70.0, 80.0), max_velocity=0.5), PD(30.0)
    if formulation == "velocity":
        hand, posture = P((9.0, 7.0, 8.0), max_velocity=0.5), P(2.0)
    laws = {}, {"hand": hand, "posture": posture}, {"hand": posture}
    return Sequence(*(Phase(name=str(k), laws=each) for k, each in enumerate(laws)))


def record(robot_name: str, formulation: str, ticks: int, folder: Path) -> Path:
    """Write ROBOT-FORMULATION.hqp and .ticks to a folder: states, references, Python's x and status."""
    session, given = scene(robot_name, formulation)
    robot = session.robot
    path = folder / f"{robot_name}-{formulation}.hqp"
    path.write_bytes(text(session, phases(formulation)))
    names = LoadedSession(path.read_bytes()).names
    elements = {element.name: element for element in session.stack}
    kept: dict[str, Vec | Mat] = {}
    run = phases(formulation).run(session)
    q, v = robot.home.copy(), np.zeros(robot.nv)
    with path.with_suffix(".ticks").open("wb") as file:
        for i in range(ticks):
            away = AWAY[i // 50 % len(AWAY)] if 20 <= i % 50 < 30 else ()
            references = tuple(one for one in given(i) if one.name not in away)
            run.go(str(i // 17 % 3))
            tick = run.step(robot.state(q, v), *references, *(elements[name].off() for name in away))
            told: list[tuple[int, int, Vec]] = [(names.index(name), PRESENT, np.zeros(1)) for name in away]
            told.append((0, PHASE, np.full(1, i // 17 % 3)))
            for name, value in session.hold_values.items():
                if name in names and not np.array_equal(kept.get(name, ()), value):
                    kept[name] = value
                    told.append((names.index(name), HOLD, np.ravel(value)))
            if i == 0:
                file.write(struct.pack("<4i", ticks, robot.nq, robot.nv, tick.x.size))
            for one in references:
                parts = (one.value, one.velocity, one.acceleration)
                told += [
                    (names.index(one.name), VALUE + k, np.ravel(part))
                    for k, part in enumerate(parts)
                    if part is not None
                ]
            file.write(struct.pack("<2i", len(told), STATUSES.index(tick.status)))
            for element, what, values in told:
                file.write(struct.pack("<3i", element, what, values.size) + values.astype("<f8").tobytes())
            file.write(np.concatenate((q, v, tick.x)).astype("<f8").tobytes())
            q, v = tick.advance()
    return path


def main() -> None:
    """Record all robots at all levels, or the named ones."""
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("robots", nargs="*", default=list(ROBOTS), metavar="ROBOT")
    parser.add_argument("--formulations", nargs="+", default=list(FORMULATIONS), metavar="NAME")
    parser.add_argument("--ticks", type=int, default=1000, metavar="N")
    parser.add_argument("--folder", type=Path, default=Path("build/replay"))
    arguments = parser.parse_args()
    arguments.folder.mkdir(parents=True, exist_ok=True)
    for robot in arguments.robots:
        for formulation in arguments.formulations:
            print(record(robot, formulation, arguments.ticks, arguments.folder))


if __name__ == "__main__":
    main()
