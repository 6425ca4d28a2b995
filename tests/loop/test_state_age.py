"""Sessions without max_age note once that states carry their time; exported loops take the time."""

from __future__ import annotations

import math
from pathlib import Path

import numpy as np
import pytest

import hqp
from hqp import Level, Stack
from hqp.__main__ import main
from hqp.tasks import Position, Posture

DT = 0.002
STACK = Stack(Level(Posture()))


def about_age(notes: tuple[hqp.Note, ...]) -> int:
    return sum("no max_age" in note.detail for note in notes)


@pytest.mark.parametrize(
    "formulation", [hqp.Velocity(), hqp.Acceleration(), hqp.Torque()], ids=lambda f: type(f).__name__
)
def test_states_with_a_time_and_no_max_age_are_noted_once(formulation: hqp.Velocity, tmp_path: Path) -> None:
    robot = hqp.robots.load("ur5")
    session = hqp.Controller(STACK, formulation, deadline=math.inf).session(robot, DT, stuck=False)
    session.export(tmp_path / "arm.hqp")
    file = hqp.load(tmp_path / "arm.hqp")
    live = [about_age(session.step(robot.state(time=k * DT)).notes) for k in range(5)]
    other = Stack(Level(Position(frame="tool0")), Level(Posture()))
    for stack, over in ((other, 0.0), (STACK, 0.01)):
        session.change(stack, over=over)
        live += [about_age(session.step(robot.state(time=1.0 + k * DT)).notes) for k in range(10)]
    assert live == [1] + [0] * 24
    assert [about_age(file.step(robot.home, time=k * DT).notes) for k in range(5)] == [1, 0, 0, 0, 0]


def test_neither_without_a_time_nor_with_max_age() -> None:
    robot = hqp.robots.load("ur5")
    plain = hqp.Controller(STACK, deadline=math.inf).session(robot, DT, stuck=False)
    aged = hqp.Controller(STACK, deadline=math.inf).session(robot, DT, max_age=0.01, stuck=False)
    assert not plain.step(robot.state()).notes
    assert not aged.step(robot.state(time=1.0), now=1.0).notes


def test_the_command_line_exports_plans_that_refuse_old_states(tmp_path: Path) -> None:
    (tmp_path / "stack.toml").write_text(hqp.serial.dumps(STACK), encoding="utf-8")
    plan = tmp_path / "arm.hqp"
    given = ["export", str(tmp_path / "stack.toml"), "--robot", "ur5", "--max-age", "0.01", "-o", str(plan)]
    assert main(given) == 0
    file = hqp.load(plan)
    assert file.step(file.home, np.zeros(6), time=1.0, now=1.005).status is hqp.Status.OPTIMAL
    assert file.step(file.home, np.zeros(6), time=1.0, now=1.05).status is hqp.Status.INVALID_STATE
