"""Write the plan of a session and a loop of it, for replay.cpp: ``python -m tests.export.native.record ROBOT ...``."""

from __future__ import annotations

import argparse
import struct
from pathlib import Path

import numpy as np

from hqp.arrays import Vec
from hqp.export.loaded import HOLD, STATUSES, VALUE, LoadedSession
from hqp.loop.plan_file.file import text
from tests.export.stacks import FORMULATIONS, ROBOTS, scene


def record(robot_name: str, formulation: str, ticks: int, folder: Path) -> Path:
    """ROBOT-FORMULATION.hqp and .ticks in a folder: states, what references are told, Python's x and status."""
    session, given = scene(robot_name, formulation)
    robot = session.robot
    path = folder / f"{robot_name}-{formulation}.hqp"
    path.write_bytes(text(session))
    names = LoadedSession(path.read_bytes()).names
    q, v = robot.home.copy(), np.zeros(robot.nv)
    with path.with_suffix(".ticks").open("wb") as file:
        for i in range(ticks):
            references = given(i)
            tick = session.step(robot.state(q, v), *references)
            told: list[tuple[int, int, Vec]] = []
            if i == 0:
                holds = session.hold_values.items()
                told += [(names.index(name), HOLD, np.ravel(value)) for name, value in holds if name in names]
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
    """All robots at all levels, or those named."""
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
