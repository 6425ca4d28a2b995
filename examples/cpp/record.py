"""Record the problems and answers of a G1's loop for replay.cpp: python examples/cpp/record.py FILE"""

from __future__ import annotations

import struct
import sys
from pathlib import Path

import numpy as np

import hqp
from hqp import Level, P, Selection, Stack
from hqp.tasks import Com, FixedContact, JointLimits, Position, Posture

TICKS = 300


def main(path: Path) -> None:
    robot = hqp.robots.load("g1")
    hand = Position(frame=robot.landmarks["palms"][1], law=P(5.0, max_velocity=0.5))
    stack = Stack(
        Level(*(FixedContact(frame=sole) for sole in robot.landmarks["soles"]), Com(axes="xy"), price=0),
        Level(hand, price=0),
        Level(Posture(law=P(1.0)), price=0),
        subject_to=[JointLimits()],
    )
    session = hqp.Controller(stack, deadline=np.inf).session(robot, dt=0.002)  # a cut answer is none to compare
    q, v = robot.home, np.zeros(robot.nv)
    goal = robot.state(q).position(hand.frame) + [0.15, 0.05, 0.2]
    with path.open("wb") as file:
        file.write(struct.pack("i", TICKS))
        for _ in range(TICKS):
            tick = session.step(robot.state(q, v), hand.at(goal))
            problem = session.problem
            file.write(struct.pack("ii", problem.n, len(problem.levels)))
            for rows in problem.levels:
                picked = isinstance(rows.A, Selection)
                file.write(struct.pack("ii", rows.m, picked))
                if picked:
                    file.write(rows.A.index.astype(np.int64).tobytes() + rows.A.scale.tobytes())
                else:
                    file.write(np.ascontiguousarray(rows.A).tobytes())
                file.write(rows.lower.tobytes() + rows.upper.tobytes())
            file.write(tick.solution.x.tobytes())
            q, v = tick.advance()


if __name__ == "__main__":
    main(Path(sys.argv[1]))
