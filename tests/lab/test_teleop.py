"""Scenes of teleoperation: measurements, inputs of rivals, and behaviour of hqp."""

from __future__ import annotations

from pathlib import Path
from typing import Any

import numpy as np
import pytest

import hqp
from hqp import Level, P, Stack
from hqp.errors import UnsupportedProblem
from hqp.lab.rivals.compare import Answer
from hqp.lab.teleop import FAMILIES, TeleopTable, compare, compare_teleop
from hqp.lab.teleop.families import RATE, family, hand_of, sine
from hqp.lab.teleop.measures import felt, lag, power_above
from hqp.lab.teleop.targets import latest, smoothed
from hqp.tasks import JointLimits, Pose, Posture

DT = 0.002
STACK = Stack(Level(Pose(frame="panda_hand", law=P(5.0), name="hand")), Level(Posture()), subject_to=[JointLimits()])


@pytest.fixture(scope="module")
def robot() -> Any:
    return hqp.robots.load("panda")


def test_measures_of_motions_that_are_known() -> None:
    t = np.arange(2500) * DT
    way = np.stack((np.sin(np.pi * t), np.cos(np.pi * t), 0.0 * t), axis=1)
    behind = np.stack((np.sin(np.pi * (t - 0.0307)), np.cos(np.pi * (t - 0.0307)), 0.0 * t), axis=1)
    assert lag(behind, way, DT) == pytest.approx(30.7, abs=0.1)
    assert lag(way, behind, DT) == pytest.approx(-30.7, abs=0.1)
    assert np.isnan(lag(0.0 * way, 0.0 * way, DT))
    one = felt("hqp", "sine", way, behind, way, np.zeros(2500, dtype=bool), DT)
    assert one.jerk == pytest.approx(np.pi**2 / np.sqrt(2.0), rel=1e-2)
    assert one.high < 0.02
    assert one.jump == pytest.approx(np.pi * DT, rel=1e-3)
    assert power_above(np.sin(2.0 * np.pi * 5.0 * t)[:, None], DT) > 0.99
    still = way.copy()
    still[500:600], still[700:720] = 0.0, 0.0
    failed = np.zeros(2500, dtype=bool)
    failed[1000] = True
    assert felt("", "", still, way + 0.1, way, failed, DT).frozen == pytest.approx(101 / 2500)
    assert felt("", "", still, way, way, failed, DT).frozen == pytest.approx(1 / 2500)


def test_what_others_are_given(robot: Any) -> None:
    """Packets at 72 Hz, held in between; smoothing delays them by 60 ms."""
    one = family("sine", robot, STACK)
    rows = latest(one, 5.0, DT)
    assert len(np.unique(rows[1000:2000], axis=0)) == pytest.approx(2.0 * RATE, abs=1)
    truth = np.array([sine(k * DT) for k in range(len(rows))])
    assert lag(rows, truth, DT) == pytest.approx(500.0 / RATE, abs=1.5)
    assert lag(smoothed(rows, DT), rows, DT) == pytest.approx(60.0, abs=2.0)
    assert len(list(family("dropout", robot, STACK).packets(5.0))) == len(list(one.packets(5.0))) - 21
    wrong = [shift[2] for _, shift in family("glitch", robot, STACK).packets(5.0) if shift[2] > 0.4]
    assert len(wrong) == 18


def test_the_straight_arm_is_at_the_edge_of_reach(robot: Any) -> None:
    way = family("straight arm", robot, STACK).shift(1.9)
    hand: Any = hand_of(STACK)
    home = hand.value(robot.copy().state(robot.home))
    for more, met in ((0.0, True), (0.02, False)):
        goal = home.copy()
        goal[:3, 3] += way * (1.0 + more / np.linalg.norm(way))
        assert hqp.reach(STACK, robot, hand.at(goal)).success == met


@pytest.mark.parametrize("name", FAMILIES)
def test_no_tick_is_frozen(robot: Any, name: str) -> None:
    one = compare.ours(family(name, robot, STACK), robot, STACK, 3.0, DT)
    assert one.frozen == 0.0
    assert one.jump < 0.1 + 1e-9
    assert not one.said
    if name in ("sine", "glitch"):
        assert one.jerk < 50.0
        assert abs(one.lag) < 10.0


def test_rivals_run_with_and_without_a_filter(robot: Any, monkeypatch: pytest.MonkeyPatch) -> None:
    """One rival that stands still, and one that refuses a scene."""

    def answers(name: str, python: Path, folder: Path, scenes: Any) -> Any:
        assert (folder / "job.json").exists()
        for scene in scenes:
            q = np.repeat(robot.home[None], 500, axis=0)
            still = Answer(q, np.zeros((500, robot.nv)), np.ones(500), np.zeros(500, dtype=bool), "")
            yield scene, "refused" if scene.name.startswith("step") else still

    monkeypatch.setattr(compare, "answers", answers)
    monkeypatch.setattr(compare, "environment", lambda name, told: Path("python"))
    table = compare_teleop(STACK, robot, ["pink"], families=["sine", "step"], seconds=1.0)
    assert [(one.library, one.scene) for one in table.lines] == [
        (library, scene) for scene in ("sine", "step") for library in ("hqp", "pink", "pink, filtered")
    ]
    assert table["pink", "sine"].frozen > 0.1
    assert table["pink, filtered", "step"].said == "refused"
    assert isinstance(table, TeleopTable)
    assert "| sine | pink, filtered |" in table.markdown()
    assert '"lag"' in table.json()
    assert "pink" in str(table)


def test_a_stack_without_a_hand_is_refused(robot: Any) -> None:
    with pytest.raises(UnsupportedProblem, match="Position or Pose"):
        compare_teleop(Stack(Level(Posture())), robot)
