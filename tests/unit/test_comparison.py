from __future__ import annotations

import csv
import io
import json
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from threadpoolctl import threadpool_info, threadpool_limits

import hqp
from hqp import Level, P, Stack, serial
from hqp.__main__ import main
from hqp.comparison.table import Comparison
from hqp.solvers.lexicographic import Lexicographic
from hqp.tasks import Com, FixedContact, JointLimits, Position, Posture

SOLVERS = ("nullspace", "chiaverini", "cascade:proxqp")
STACK = Stack(
    Level(FixedContact(frame="l_sole"), FixedContact(frame="r_sole"), Com(axes="xy"), name="balance"),
    Level(Position(frame="r_palm"), name="hand"),
    Level(Posture(law=P(1.0)), name="posture"),
    subject_to=[JointLimits(acceleration=None, approach=0)],
)


@pytest.fixture(scope="module")
def result() -> Comparison:
    return hqp.compare(STACK, hqp.robots.load("cbi"), solvers=SOLVERS)


@pytest.mark.long
def test_every_solver_is_judged_on_the_same_problems(result: Comparison) -> None:
    assert [line.solver for line in result.lines] == list(SOLVERS)
    assert result.levels == ("subject_to", "balance", "hand", "posture")
    cascade = result["cascade:proxqp"]
    assert cascade.certified == 1.0
    assert cascade.residuals[1] < 1e-8
    assert result["nullspace"].note == "inequalities left out"
    assert result["chiaverini"].residuals[2] > 1e3 * cascade.residuals[2]


@pytest.mark.long
def test_formats(result: Comparison) -> None:
    assert "cascade:proxqp" in str(result)
    assert result.markdown().count("\n| ") >= len(SOLVERS)
    rows = list(csv.DictReader(io.StringIO(result.csv())))
    assert [row["solver"] for row in rows] == list(SOLVERS)
    assert json.loads(result.json())["lines"][0]["solver"] == "nullspace"


def test_given_states_and_unknown_names(result: Comparison) -> None:
    robot = hqp.robots.load("cbi")
    one = hqp.compare(STACK, robot, solvers="nullspace", states=[(robot.home, np.zeros(robot.nv))], repeats=1)
    assert one.solves == 1
    with pytest.raises(KeyError, match="nullspace"):
        one["lexicographic"]


def test_command_line(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    path = tmp_path / "stack.toml"
    path.write_text(serial.dumps(STACK))
    assert main(["compare", str(path), "--robot", "cbi", "--solvers", "nullspace", "--format", "markdown"]) == 0
    assert "| nullspace" in capsys.readouterr().out
    assert main(["solvers"]) == 0
    assert "cascade:proxqp" in capsys.readouterr().out
    assert main(["robots"]) == 0
    assert "cbi" in capsys.readouterr().out
    assert main(["compare", str(path), "--robot", "cbii"]) == 2
    assert "closest" in capsys.readouterr().err
    assert main([]) == 0
    assert "usage: hqp" in capsys.readouterr().out


@pytest.mark.long
def test_drawn_states_are_those_of_a_loop_that_holds_its_constraints() -> None:
    """With acceleration limits and default contacts; every level has something to do."""
    stack = Stack(
        Level(Com(axes="xy"), name="balance"),
        Level(Position(frame="gripper_right_base_link"), name="hand"),
        Level(Posture(law=P(1.0)), name="posture"),
        subject_to=[*(FixedContact(frame=f"{side}_sole_link") for side in ("left", "right")), JointLimits()],
    )
    lines = hqp.compare(stack, hqp.robots.load("talos"), solvers=["lexicographic", "chiaverini"], repeats=1)
    strict = lines["lexicographic"]
    assert (strict.status, strict.certified) == ("OPTIMAL", 1.0)
    assert max(strict.residuals[:3]) < 1e-9
    assert strict.residuals[-1] > 1.0
    assert max(lines["chiaverini"].residuals[:3]) > 0.1


def test_references_take_the_place_of_drawn_targets() -> None:
    robot = hqp.robots.load("ur5")
    hand = Position(frame="tool0", law=P(5.0))
    stack = Stack(Level(hand, name="hand"), Level(Posture(law=P(1.0))), subject_to=[JointLimits()])
    far = hand.at(robot.state().position("tool0") + np.array([3.0, 0.0, 0.0]))
    near, away = (hqp.compare(stack, robot, references=r, solvers="lexicographic", repeats=1) for r in ([], [far]))
    assert near.lines[0].residuals[1] < 0.5
    assert away.lines[0].residuals[1] > 1.0


@pytest.mark.long
def test_blas_takes_one_thread_while_solvers_are_compared() -> None:
    found: list[int] = []

    class Counting(Lexicographic):
        def workspace(self, shape: Any) -> Any:
            found.extend(info["num_threads"] for info in threadpool_info() if info["user_api"] == "blas")
            return super().workspace(shape)

    with threadpool_limits(limits=2, user_api="blas"):
        if max(info["num_threads"] for info in threadpool_info() if info["user_api"] == "blas") < 2:
            pytest.skip("BLAS has one thread here")
        robot, stack = hqp.robots.load("ur5"), Stack(Level(Posture(law=P(1.0))))
        hqp.compare(stack, robot, solvers=[Counting()], repeats=1)
        hqp.bench(stack, robot, solvers=[Counting()], seconds=0.01)
    assert set(found) == {1}


@pytest.mark.long
def test_exact_and_priced_levels_side_by_side() -> None:
    robot = hqp.robots.load("ur5")
    hand = Position(frame="tool0", law=P(5.0))
    stack = Stack(Level(hand, name="hand"), Level(Posture(law=P(1.0)), name="posture"), subject_to=[JointLimits()])
    far = hand.at(robot.state().position("tool0") + np.array([3.0, 0.0, 0.0]))
    states = [(robot.home, np.zeros(robot.nv))]
    both = hqp.compare(
        stack, robot, states=states, references=[far], solvers=["lexicographic", "nullspace", "reference"], price="both"
    )
    assert [line.solver for line in both.lines] == [
        "lexicographic", "nullspace", "reference", "lexicographic, priced", "reference, priced",
    ]  # fmt: skip
    exact, priced = both["lexicographic"], both["lexicographic, priced"]
    assert exact.certified == priced.certified == both["reference, priced"].certified == 1.0
    assert both["reference, priced"].difference < 1e-6
    assert priced.residuals[1] > exact.residuals[1]  # out of reach the price has an effect
    alone = hqp.compare(stack, robot, states=states, references=[far], solvers="lexicographic", price=None)
    assert alone.lines[0].residuals == priced.residuals
