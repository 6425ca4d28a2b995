"""Write the plan of UR5 and the end of its loop, as examples/cpp/follow.cpp prints it.

python -m tests.environments.plan FILE X Y Z
"""

import sys
from pathlib import Path

import numpy as np

from tests.scenes.stacks import scene

if __name__ == "__main__":
    path, shift = Path(sys.argv[1]), [float(x) for x in sys.argv[2:]]
    session, _ = scene("ur5")
    session.export(path)
    (hand,) = (element for element in session.controller.stack if element.name == "hand")
    q, v = session.robot.home, np.zeros(session.robot.nv)
    goal = session.robot.state(q).position(hand.frame) + shift
    session.step(session.robot.state(q, v))
    for _ in range(500):
        q, v = session.step(session.robot.state(q, v), hand.at(goal)).advance()
    path.with_suffix(".txt").write_text("\n".join(f"{angle:.9f}" for angle in q) + "\n")
