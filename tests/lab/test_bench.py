"""The lab: a stack in closed loop through solvers, its reports, and the comparison with an older run."""

from __future__ import annotations

import json
import re
from dataclasses import replace
from importlib.util import find_spec
from pathlib import Path

import numpy as np
import pytest

import hqp
from hqp import Level, P, Stack
from hqp.errors import DeclarationError
from hqp.lab import Bench, Trajectory
from hqp.lab.measures import _longest, reversals
from hqp.tasks import Com, FixedContact, JointLimits, Position, Posture

HAND = Position(frame="r_palm", law=P(5.0, max_velocity=0.5))
STACK = Stack(
    Level(FixedContact(frame="l_sole"), FixedContact(frame="r_sole"), Com(axes="xy"), name="balance"),
    Level(HAND, name="hand"),
    Level(Posture(law=P(1.0)), name="posture"),
    subject_to=[JointLimits()],
)


@pytest.fixture(scope="module")
def robot():
    return hqp.robots.load("cbi")


@pytest.fixture(scope="module")
def result(robot) -> Bench:
    return hqp.bench(STACK, robot, solvers=("lexicographic", "weighted", "nullspace"), seconds=0.3, certify_every=20)


@pytest.mark.long
def test_a_strict_solver_is_certified_and_a_weighted_one_is_marked(result: Bench) -> None:
    own = result["lexicographic"]
    assert own.strict
    assert own.certified == 1.0
    assert own.ticks == 150
    assert own.p50_us <= own.p95_us <= own.p99_us <= own.max_us
    assert own.residual_max["balance"] < 1e-9
    assert not result["weighted"].strict
    assert result["weighted"].certified < 1.0
    assert result["nullspace"].status == "refused"
    assert "inequalities" in str(result)
    with pytest.raises(KeyError, match="lexicographic"):
        result["qp"]


@pytest.mark.long
def test_progress_grows_to_the_end(robot) -> None:
    shares: list[float] = []
    hqp.bench(
        STACK, robot, solvers=("lexicographic",), seconds=0.6, certify_every=300,
        progress=lambda _, share: shares.append(share),
    )  # fmt: skip
    assert len(shares) > 2
    assert shares == sorted({*shares})
    assert shares[-1] == 1.0


@pytest.mark.long
def test_markdown_renders(result: Bench) -> None:
    table = [line for line in result.markdown().splitlines() if line.startswith("|")]
    widths = {len(re.findall(r"(?<!\\)\|", line)) for line in table}
    assert len(widths) == 2  # two tables, each of one width
    assert "[rad/s]" in result.markdown()


def test_json_says_what_it_was_measured_on(result: Bench) -> None:
    read = json.loads(result.json())
    assert read["manifest"]["format"] == 1
    assert {"machine", "packages", "dt", "seed", "commit"} <= set(read["manifest"])
    assert read["lines"][0]["split_us"]["solve"] > 0.0


def test_against_an_older_run(result: Bench, tmp_path: Path) -> None:
    old = tmp_path / "old.json"
    old.write_text(result.json())
    assert {change.verdict for change in result.against(old)} == {"no change"}
    tree = json.loads(result.json())
    tree["lines"][0]["ratio"] *= 10.0
    old.write_text(json.dumps(tree))
    verdicts = {change.solver: change.verdict for change in result.against(old)}
    assert verdicts["lexicographic"] == "faster"
    tree["manifest"]["robot"] = "talos"
    old.write_text(json.dumps(tree))
    with pytest.raises(DeclarationError, match="another robot"):
        result.against(old)


@pytest.mark.long
def test_the_page_is_whole_in_itself(result: Bench, tmp_path: Path) -> None:
    pytest.importorskip("plotly")
    html = result.html(tmp_path / "report.html").read_text()
    assert "Residual of every level" in html
    assert not re.search(r'<(script|link)[^>]+(src|href)="http', html)
    prose = re.sub(r"<script.*?</script>", "", html, flags=re.DOTALL)
    assert "{" not in re.sub(r"<style>.*?</style>", "", prose, flags=re.DOTALL)  # no dictionary in Python's format
    assert max(row.count("<th>") for row in re.findall(r"<tr>.*?</tr>", prose)) <= 10  # fits on the page
    assert {"over limit", "reversals/s"} <= set(re.findall(r"<th>(.*?)</th>", prose))


def test_reports_do_not_depend_on_the_order_of_solvers(result: Bench, robot, tmp_path: Path) -> None:
    """An exact hierarchy keeps contacts and CoM in one level, a priced one does not; each level has its plot."""
    pytest.importorskip("plotly")
    parquet = pytest.importorskip("pyarrow.parquet")
    turned = replace(result, lines=result.lines[::-1], runs=result.runs[::-1])
    assert len({run.levels for run in result.runs}) > 1  # else it tests nothing
    assert turned.levels == result.levels
    assert sorted(turned.residual_cells()) == sorted(result.residual_cells())
    html = turned.html(tmp_path / "report.html").read_text()
    assert all(f"<th>{name}</th>" in html for name in turned.levels)
    tables = [parquet.read_table(b.parquet(tmp_path / "b.parquet")).num_rows for b in (result, turned)]
    assert tables == [sum(len(run.statuses) for run in result.runs)] * 2


def test_what_misses_its_goal_is_marked(result: Bench, tmp_path: Path) -> None:
    own = result["lexicographic"]
    good = replace(own, p50_us=9.0, p95_us=10.0, p99_us=11.0, max_us=12.0, misses=0, reversals=5.0, drift=0.0, over=0.0)
    assert good.missed(2000.0) == frozenset()
    for name, field, value in (
        ("p99", "p99_us", 2001.0), ("missed", "misses", 1), ("certified", "certified", 0.99),
        ("reversals/s", "reversals", 6.0), ("drift mm", "drift", 2e-4), ("over limit", "over", 1e-3),
        ("status", "statuses", {"OPTIMAL": 9, "TIME_LIMIT": 1}),
    ):  # fmt: skip
        assert replace(good, **{field: value}).missed(2000.0) == {name}
    late = Bench(result.manifest, (replace(good, reversals=40.0), replace(good, solver="calm")))
    marked, plain = (dict(zip(late.header(), row, strict=True)) for row in late.cells())
    assert (marked["reversals/s"], plain["reversals/s"]) == ("40 !", "5")
    assert not any(cell.endswith("!") for cell in plain.values())
    if find_spec("plotly"):
        assert late.html(tmp_path / "late.html").read_text().count('<td class="missed">') == 1


def test_parquet_holds_every_tick(result: Bench, tmp_path: Path) -> None:
    parquet = pytest.importorskip("pyarrow.parquet")
    table = parquet.read_table(result.parquet(tmp_path / "ticks.parquet"))
    assert table.num_rows == 300
    assert json.loads(table.schema.metadata[b"hqp"])["robot"] == "cbi"
    assert {"residual hand", "solve_us", "command"} <= set(table.column_names)


@pytest.mark.long
@pytest.mark.parametrize("formulation", [hqp.Acceleration(), hqp.Torque()], ids=["acceleration", "torque"])
def test_other_formulations(robot, formulation) -> None:
    feet = [FixedContact(frame="l_sole"), FixedContact(frame="r_sole")]
    stack = Stack(Level(Com()), Level(Position(frame="r_palm")), Level(Posture()), subject_to=feet)
    found = hqp.bench(stack, robot, formulation=formulation, seconds=0.1, trajectory="hold")
    assert found["lexicographic"].certified == 1.0


@pytest.mark.long
def test_mujoco_carries_out_velocities(robot) -> None:
    pytest.importorskip("mujoco")
    found = hqp.bench(STACK, robot, plant="mujoco", seconds=0.3, trajectory="hold")
    assert found["lexicographic"].residual_max["balance"] < 1e-6
    assert found["lexicographic"].certified == 1.0


@pytest.mark.long
@pytest.mark.parametrize("order", [1, 2])
@pytest.mark.parametrize("name", ["ur5", "xarm7", "baxter", "romeo", "iris", "solo12"])
def test_robots_without_gains_run_in_mujoco(name: str, order: int) -> None:
    pytest.importorskip("mujoco")
    robot = hqp.robots.load(name)
    soles = robot.landmarks.get("soles", ())
    law = hqp.P(5.0) if order == 1 else hqp.PD(25.0, 10.0)
    hand = Position(frame=robot.landmarks.get("palms", robot.frame_names[-1:])[0], law=law)
    feet = [FixedContact(frame=sole) for sole in soles]
    above = [Level(Com(axes="xy", law=law))] if soles else []
    stack = Stack(*above, Level(hand), subject_to=[JointLimits(), *feet])
    formulation = hqp.Velocity() if order == 1 else hqp.Acceleration()
    found = hqp.bench(stack, robot, formulation=formulation, plant="mujoco", seconds=0.5, trajectory="hold")
    (run,) = found.runs
    assert set(run.statuses) == {"OPTIMAL"}
    if not robot.floating:
        assert found["lexicographic"].off[hand.name] < 1e-3
    assert found["lexicographic"].drift < 0.01


def test_trajectories_from_files_and_functions(robot, tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    file = tmp_path / "hand.csv"
    file.write_text("t,r_palm.0,r_palm.1,r_palm.2\n0,0.3,-0.2,0.9\n1,0.5,-0.2,1.1\n")
    (reference,) = Trajectory(file, STACK, robot, 1.0)(0.5)
    assert reference.name == "r_palm"
    assert reference.value == pytest.approx([0.4, -0.2, 1.0])
    monkeypatch.chdir(tmp_path)
    (tmp_path / "moves.py").write_text("def hand(t):\n    return {'r_palm': ([t, 0, 1], [1, 0, 0])}\n")
    (reference,) = Trajectory("moves:hand", STACK, robot, 1.0)(0.25)
    assert reference.velocity.tolist() == [1.0, 0.0, 0.0]
    with pytest.raises(DeclarationError, match="circle"):
        Trajectory("cirkle", STACK, robot, 1.0)
    file.write_text("time,a\n0,1\n")
    with pytest.raises(DeclarationError, match="column t"):
        Trajectory(file, STACK, robot, 1.0)


@pytest.mark.long
def test_nan_targets_are_told_by_status(robot) -> None:
    found = hqp.bench(STACK, robot, seconds=0.3, trajectory="nan")
    assert found["lexicographic"].statuses["INVALID_REFERENCE"] > 10


@pytest.mark.long
def test_a_solver_that_is_not_installed_has_a_line(robot, monkeypatch: pytest.MonkeyPatch) -> None:
    from hqp.errors import SolverNotInstalled
    from hqp.lab import closed_loop

    def load(name: str) -> object:
        if name == "daqp":
            raise SolverNotInstalled("solver 'daqp' is not installed: pip install daqp")
        return hqp.solvers.load(name)

    monkeypatch.setattr(closed_loop, "load", load)
    found = hqp.bench(STACK, robot, solvers=("lexicographic", "daqp"), seconds=0.02)
    assert found["daqp"].status == "refused"
    assert "pip install daqp" in str(found)
    assert found["lexicographic"].ticks == 10


def test_longest_run_andreversals() -> None:
    assert _longest(np.array([True, True, False, True, True, True, False])) == 3
    zigzag = np.where(np.arange(101) % 2, 1.0, -1.0)[:, None]
    assert reversals(zigzag, 0.01) == pytest.approx(99.0)
    assert reversals(np.arange(101.0)[:, None], 0.01) == 0.0


@pytest.mark.long
def test_the_command(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    from hqp.__main__ import main

    file = tmp_path / "stack.toml"
    file.write_text(hqp.serial.dumps(STACK))
    given = ["bench", str(file), "--robot", "cbi", "--seconds", "0.1", "--json", str(tmp_path / "a.json")]
    assert main(given) == 0
    assert "lexicographic" in capsys.readouterr().out
    assert json.loads((tmp_path / "a.json").read_text())["lines"]
    assert main([*given[:3], "cbi", "--trajectory", "cirkle"]) == 2
