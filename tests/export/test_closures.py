"""Closures of loops command the same bits live, from a plan file and in a batch, at three levels."""

from __future__ import annotations

from pathlib import Path
from typing import Any

import numpy as np
import pytest

import hqp
from hqp import PD, Level, P, Stack
from hqp.export.loaded import LoadedSession
from hqp.loop.file import text
from hqp.solvers.lexicographic import kernel
from hqp.tasks import Ball, Hinge, JointLimits, Posture, Weld

pytestmark = pytest.mark.skipif(not kernel(), reason="no native kernel here")
CLOSURES = {
    "ball": lambda: Ball(frame="left", relative_to="right", name="loop"),
    "hinge": lambda: Hinge(frame="left", relative_to="right", axis=(0.6, 0.0, 0.8), name="loop"),
    "weld": lambda: Weld(frame="left", relative_to="right", name="loop"),
}
LEVELS = {"velocity": hqp.Velocity, "acceleration": hqp.Acceleration, "torque": hqp.Torque}
WORLDS, TICKS, DT = 3, 40, 0.002


def two_arms(folder: Path, rng: Any) -> Any:
    """Two chains of seven hinges about drawn axes, which end in the sites left and right."""

    def arm(side: str, y: float) -> str:
        inside = f'<site name="{side}"/>'
        for k in range(7):
            axis, place = rng.normal(size=3), rng.uniform(-0.05, 0.05, 3) + (0.2, 0.0, 0.0)
            inside = (
                f'<body pos="{" ".join(f"{x:.6f}" for x in place)}"><joint name="{side}{k}" range="-2.5 2.5" '
                f'axis="{" ".join(f"{x:.6f}" for x in axis)}"/><geom size=".04" mass="1"/>{inside}</body>'
            )
        return f'<body pos="0 {y} 1"><geom size=".04"/>{inside}</body>'

    motors = "".join(f'<motor joint="{side}{k}" ctrlrange="-200 200"/>' for side in ("left", "right") for k in range(7))
    path = folder / "arms.xml"
    path.write_text(
        f'<mujoco><compiler angle="radian" autolimits="true"/><worldbody>{arm("left", 0.3)}{arm("right", -0.3)}'
        f"</worldbody><actuator>{motors}</actuator></mujoco>"
    )
    return hqp.robots.load(path)


@pytest.mark.parametrize("level", LEVELS)
@pytest.mark.parametrize("kind", CLOSURES)
def test_closures_command_the_same_bits(kind: str, level: str, tmp_path: Path) -> None:
    rng = np.random.default_rng([len(kind), len(level)])
    robot = two_arms(tmp_path, rng)
    lead = Posture(law=P(5.0) if level == "velocity" else PD(50.0), name="lead")
    controller = hqp.Controller(
        Stack(Level(lead), subject_to=[JointLimits(), CLOSURES[kind]()]), LEVELS[level](), deadline=np.inf
    )
    live = [controller.session(robot, DT) for _ in range(WORLDS)]
    file = [LoadedSession(text(live[0])) for _ in range(WORLDS)]
    batch = hqp.Batch(controller, robot, WORLDS, DT, threads=1)
    Q = np.array([robot.integrate(robot.home, rng.uniform(-0.5, 0.5, robot.nv), 1.0) for _ in range(WORLDS)])
    V = np.zeros((WORLDS, robot.nv))
    goals = Q + rng.uniform(-0.3, 0.3, Q.shape)
    closure = CLOSURES[kind]()
    holds = [closure.hold(robot.state(q)).value for q in Q]
    for _ in range(TICKS):
        together = batch.step(Q, V, {"lead": goals})
        for k in range(WORLDS):
            tick = live[k].step(robot.state(Q[k], V[k]), lead.at(goals[k]))
            assert tick.status.usable, tick.notes
            np.testing.assert_array_equal(file[k].step(Q[k], V[k], {"lead": goals[k]}).x, tick.x)
            np.testing.assert_array_equal(together.x[k], tick.x)
            Q[k], V[k] = tick.advance()
    moved = [closure.error(robot.state(q), hold) for q, hold in zip(Q, holds, strict=True)]
    assert np.abs(moved).max() < 1e-3
    freely = [closure.error(robot.state(q), hold) for q, hold in zip(goals, holds, strict=True)]
    assert min(np.abs(e).max() for e in freely) > 1e-2
