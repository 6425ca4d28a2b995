"""Flight recordings: files hold the solved problems without the robot; replay; cost per tick."""

from __future__ import annotations

import json
import math
import subprocess
import sys
import zipfile
from pathlib import Path
from typing import Any

import numpy as np
import pytest

import hqp
from hqp import Level, Stack, Status
from hqp.errors import DeclarationError, HqpError
from hqp.recorder import load, replay
from hqp.recorder.layout import Memory
from hqp.robots import Robot
from hqp.tasks import Com, FixedContact, JointLimits, Position, Posture, TorqueLimits
from tests.counting import calls

DT = 0.002
FORMULATIONS = [hqp.Velocity(), hqp.Acceleration(), hqp.Torque()]


def make(formulation: Any, name: str = "talos", **fields: Any) -> tuple[Robot, hqp.Session, Position]:
    robot = hqp.robots.load(name)
    limits = [TorqueLimits()] if isinstance(formulation, hqp.Torque) else [JointLimits()]
    hand = Position(frame=robot.landmarks["palms"][1], name="hand")
    stack = Stack(
        Level(Com(name="com")),
        Level(hand),
        Level(Posture()),
        subject_to=[*(FixedContact(frame=f) for f in robot.landmarks["soles"]), *limits],
    )
    return robot, hqp.Controller(stack, formulation, deadline=math.inf, **fields).session(robot, DT), hand


def drive(robot: Robot, run: hqp.Session, hand: Position, ticks: int) -> list[tuple[hqp.Tick, hqp.Hierarchy]]:
    q, v = robot.home.copy(), np.zeros(robot.nv)
    goal = robot.state(q, v).position(hand.frame) + [0.4, 0.0, 0.2]
    seen = []
    for _ in range(ticks):
        tick = run.step(robot.state(q, v), hand.at(goal))
        seen.append((tick, run.problem.copy()))
        q, v = tick.advance()
    return seen


@pytest.mark.parametrize("formulation", FORMULATIONS, ids=lambda f: type(f).__name__)
def test_a_file_holds_what_was_solved(formulation: Any, tmp_path: Path) -> None:
    robot, run, hand = make(formulation)
    run.step(robot.state())
    recorder = run.record(ticks=20, on="never", to=tmp_path)
    seen = drive(robot, run, hand, 33)[-20:]
    recorder.dump()
    recorder.wait()
    recording = load(recorder.files[0])
    assert len(recording) == 20
    for (tick, problem), found in zip(seen, recording, strict=True):
        assert found.status is tick.status
        assert np.array_equal(found.q, tick.state.q)
        assert np.array_equal(found.v, tick.state.v)
        assert np.array_equal(found.command, tick.command)
        for one, other in zip(problem.levels, found.problem.levels, strict=True):
            assert np.array_equal(one.dense(problem.n), other.dense(problem.n))
            assert np.array_equal(one.lower, other.lower)
            assert np.array_equal(one.upper, other.upper)
        for name in ("metric", "origin", "prices", "turning"):
            one, other = getattr(problem, name), getattr(found.problem, name)
            assert (one is None) == (other is None)
            assert one is None or np.array_equal(one, other)
        assert problem.motion is not None
        assert found.problem.motion is not None
        assert np.array_equal(found.problem.motion.F, problem.motion.F)
        assert tick.solution is not None
        assert found.solution is not None
        assert np.array_equal(found.solution.x, tick.solution.x)
        assert found.references[0]["name"] == "hand"
    assert recording.about["robot"]["name"] == "talos"
    assert len(recording.about["robot"]["hash"]) == 16
    assert recording.about["format"] == 1
    assert hqp.serial.loads(recording.about["toml"]) == run.controller.stack
    assert recording.about["hqp"] == hqp.__version__


def test_rows_that_are_multiples_of_others_are_kept_once(tmp_path: Path) -> None:
    """At torque level posture, joint limits, motion and metric are rows of qdd = X tau + c with symmetric X."""
    robot, run, _ = make(hqp.Torque())
    run.step(robot.state())
    program = run.program
    plain, lean = Memory(program.problem), Memory(program.problem, program.copies, program.symmetric)
    n = robot.actuated.size
    assert plain.size - lean.size > 1.9 * 8 * n * n
    ring = bytearray(lean.size)
    for part, begin, end in lean.parts:
        ring[begin:end] = part
    found = lean.problem(bytes(ring))
    for one, other in zip(program.problem.levels, found.levels, strict=True):
        assert np.array_equal(one.dense(n), other.dense(n))
    assert np.array_equal(program.problem.metric, found.metric)
    assert np.array_equal(program.problem.motion.F, found.motion.F)


def test_a_file_is_written_when_something_happens_and_not_again_at_once(tmp_path: Path) -> None:
    robot, run, hand = make(hqp.Velocity())
    recorder = run.record(ticks=30, to=tmp_path)
    drive(robot, run, hand, 12)
    for _ in range(5):
        run.step(robot.state(np.full(robot.nq, np.nan)))
    recorder.wait()
    (path,) = recorder.files
    recording = load(path)
    assert [tick.status for tick in recording] == [Status.OPTIMAL] * 12 + [Status.INVALID_STATE]
    assert "state" in recording[12].notes[0][0]
    assert recording[12].solution is None
    with pytest.raises(HqpError, match="not solved"):
        recording[12].explain()
    drive(robot, run, hand, 30)
    run.step(robot.state(np.full(robot.nq, np.nan)))
    recorder.wait()
    assert len(recorder.files) == 2


@pytest.mark.long
def test_changes_of_stack_are_in_one_file(tmp_path: Path) -> None:
    robot, run, hand = make(hqp.Velocity())
    recorder = run.record(ticks=60, on="never", to=tmp_path)
    drive(robot, run, hand, 10)
    run.change(run.stack.without("com"), over=0.02)
    drive(robot, run, hand, 20)
    recorder.dump()
    recorder.wait()
    recording = load(recorder.files[0])
    assert len(recording) == 30
    assert [tick.count for tick in recording][:10] == list(range(1, 11))
    assert {len(tick.problem.levels) for tick in recording} == {4, 5}
    assert 0.0 < recording[12].transition < 1.0
    assert len(replay(recording, "lexicographic").lines) == 1


@pytest.mark.long
@pytest.mark.parametrize(("every", "agreed"), [(20, 2), pytest.param(4, 10, marks=pytest.mark.slow)])
def test_replay_tells_who_agrees_and_the_account_over_time(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch, every: int, agreed: int
) -> None:
    """every, agreed: stride and count of the reference solver, which takes a second per tick."""
    monkeypatch.setattr(sys.modules["hqp.recorder.replay"], "SECONDS", math.inf)  # the function has the name, too
    robot, run, hand = make(hqp.Velocity())
    recorder = run.record(ticks=40, on="never", to=tmp_path)
    drive(robot, run, hand, 40)
    recorder.dump()
    recorder.wait()
    recording = load(recorder.files[0])
    found = replay(recording, ["lexicographic", "weighted"], every=4)
    lines = {line.solver: line for line in found.lines}
    assert lines["lexicographic"].agreed == lines["lexicographic"].solved == 10
    assert replay(recording, "reference", every=every).lines[0].agreed == agreed
    assert "refused" in lines["weighted"].note  # it solves no priced levels
    assert sum(period.last >= period.first for period in found.periods) == len(found.periods)
    assert any("hand" in str(period) for period in found.periods)
    assert "lexicographic" in str(found)
    spoilt = recording[4].problem.levels[-1].lower  # a demand that was not solved: no solver agrees there
    spoilt += 1.0
    recording[4].problem.levels[-1].upper[:] = spoilt
    recording[4].x_solved[:] += 0.3
    line = replay(recording, "lexicographic", every=4).lines[0]
    assert line.agreed == 9
    assert line.first == recording[4].count


@pytest.mark.long
def test_the_command_needs_no_robot(tmp_path: Path) -> None:
    robot, run, hand = make(hqp.Velocity(), "g1")
    recorder = run.record(ticks=8, on="never", to=tmp_path)
    drive(robot, run, hand, 8)
    recorder.dump()
    recorder.wait()
    (path,) = recorder.files
    block = (
        "import sys; sys.modules['pinocchio'] = None; from hqp.__main__ import main; "
        f"sys.exit(main(['replay', {str(path)!r}, '--solvers', 'lexicographic', 'cascade:proxqp']))"
    )
    done = subprocess.run([sys.executable, "-c", block], capture_output=True, text=True, check=False, timeout=1200)
    assert done.returncode == 0, done.stderr
    assert "lexicographic" in done.stdout
    assert "8 ticks of 2 ms on g1" in done.stdout
    block = block.replace("'--solvers', 'lexicographic', 'cascade:proxqp'", f"'--explain', '{run.count}'")
    done = subprocess.run([sys.executable, "-c", block], capture_output=True, text=True, check=False, timeout=1200)
    assert "residual" in done.stdout, done.stderr


def test_what_is_no_recording_is_refused(tmp_path: Path) -> None:
    for name, content in (
        ("none.npz", None),
        ("text.npz", b"no zip"),
        ("other.npz", {"format": 1}),
        ("late.npz", {"format": 2, "kind": "recording"}),
    ):
        path = tmp_path / name
        if isinstance(content, bytes):
            path.write_bytes(content)
        elif content is not None:
            with zipfile.ZipFile(path, "w") as file:
                file.writestr("recording.json", json.dumps(content))
        with pytest.raises(DeclarationError, match="recording"):
            load(path)
    _, run, _ = make(hqp.Velocity())
    for wrong in ({"ticks": 0}, {"on": "sometimes"}):
        with pytest.raises(DeclarationError, match="record"):
            run.record(to=tmp_path, **wrong)  # type: ignore[arg-type]


@pytest.mark.parametrize("blended", [False, True])
def test_a_folder_that_is_gone_is_told_and_its_ticks_are_kept(tmp_path: Path, blended: bool) -> None:
    robot, run, hand = make(hqp.Velocity(), "g1")
    folder = tmp_path / "gone"
    recorder = run.record(ticks=5, on="never", to=folder)
    seen = drive(robot, run, hand, 5)
    folder.rmdir()
    recorder.dump()
    recorder._threads[0].join()
    if blended:
        run.change(run.stack.without("com"), over=0.2)
    (tick, _) = drive(robot, run, hand, 3)[-1]
    note = next(note for note in tick.notes if note.element == "recorder")
    assert "could not be written" in note.detail
    assert str(folder) in note.detail
    with pytest.raises(HqpError, match=rf"{folder}.*No such file"):
        recorder.wait()
    with pytest.raises(HqpError, match="another folder"):
        recorder.wait(to=tmp_path / "gone as well")
    recorder.wait(to=tmp_path)
    found = load(recorder.files[0])
    assert [np.array_equal(a.q, b.state.q) for a, (b, _) in zip(found, seen, strict=True)] == [True] * 5
    assert not any(note.element == "recorder" for note in drive(robot, run, hand, 1)[0][0].notes)


def test_a_full_disk_leaves_no_half_file_and_costs_bounded_memory(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    def full(*_: object, **__: object) -> None:
        raise OSError(28, "No space left on device")

    robot, run, hand = make(hqp.Velocity(), "g1")
    recorder = run.record(ticks=2, on="never", to=tmp_path)
    with monkeypatch.context() as patch:
        patch.setattr(np.lib.format, "write_array", full)
        for _ in range(6):
            drive(robot, run, hand, 1)
            recorder.dump()
            recorder._threads[-1].join()
        assert list(tmp_path.iterdir()) == []
        with pytest.raises(HqpError, match=r"No space left on device.*2 that were dropped"):
            recorder.wait()
    with pytest.raises(HqpError, match="2 more recordings could not be written and were dropped"):
        recorder.wait()
    assert len(recorder.files) == 4
    recorder.wait()


def test_a_file_is_never_written_over(tmp_path: Path) -> None:
    recorders = []
    for _ in range(2):  # same robot, same count, same second
        robot, run, hand = make(hqp.Velocity(), "g1")
        recorders.append(run.record(ticks=2, on="never", to=tmp_path))
        drive(robot, run, hand, 2)
    for recorder in recorders:
        recorder.dump()
        recorder.wait()
    assert len(list(tmp_path.iterdir())) == 2
    assert [len(load(path)) for recorder in recorders for path in recorder.files] == [2, 2]


def test_without_a_tick_no_file_is_written(tmp_path: Path) -> None:
    recorder = make(hqp.Velocity(), "g1")[1].record(to=tmp_path)
    recorder.dump()
    recorder.wait()
    assert recorder.files == []
    (tmp_path / "file").write_text("in the way")
    with pytest.raises(DeclarationError, match="cannot make the folder"):
        make(hqp.Velocity(), "g1")[1].record(to=tmp_path / "file")


def test_a_tick_pays_little_for_its_recording(tmp_path: Path) -> None:
    """One copy in C++: a few calls, equally many for ticks of any size."""
    for name in ("talos", "cbi"):
        robot, run, _ = make(hqp.Velocity(), name)
        for _ in range(10):
            run.step(robot.state())
        bare = min(calls(run.step, robot.state()) for _ in range(3))
        run.record(ticks=100, on="never", to=tmp_path)
        run.step(robot.state())
        assert min(calls(run.step, robot.state()) for _ in range(3)) - bare <= 4
