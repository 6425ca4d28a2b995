"""Write filters and hostile loops of them, for filter.cpp: ``python -m tests.export.native.record_filter FOLDER``."""

from __future__ import annotations

import math
import struct
import sys
from pathlib import Path

import numpy as np

import hqp
from hqp.tasks import CollisionAvoidance
from tests.scenes.hostile import DT, KINDS, Plant, hostile

TICKS = 500


def record(name: str, kind: str, folder: Path) -> None:
    """Write filter-ROBOT-KIND.hqp and .ticks: q, v, the policy's command, the sent one."""
    robot, rng = hqp.robots.load(name), np.random.default_rng(0)
    gains = {"kp": 60.0, "kd": 2.0} if kind == "positions" else {}
    guard = hqp.PolicyFilter(command=kind, collision=CollisionAvoidance(), **gains)  # type: ignore[arg-type]
    session = guard.session(robot, DT, deadline=math.inf)
    path = folder / f"filter-{name}-{kind}.hqp"
    session.export(path)
    plant = Plant(robot, kind, session)
    with path.with_suffix(".ticks").open("wb") as file:
        for i in range(TICKS):
            q, v, command = plant.q.copy(), plant.v.copy(), hostile(rng, kind, robot, 3 * i)
            if i % 50 == 20:
                q[-1] = math.nan
            sent = session.tick(q, v, command).command
            numbers = np.concatenate((q, v, command, sent))
            file.write(struct.pack("<i", numbers.size) + numbers.astype("<f8").tobytes())
            plant.move(sent)


if __name__ == "__main__":
    chosen = Path(sys.argv[1])
    chosen.mkdir(parents=True, exist_ok=True)
    for robot_name in ("g1", "ur5"):
        for command_kind in KINDS:
            record(robot_name, command_kind, chosen)
