"""Counters of a session against its own ticks, in Python, from a file and in a batch; its heartbeat."""

from __future__ import annotations

import math
import threading
import time
from pathlib import Path
from typing import Any

import numpy as np
import pytest

import hqp
from hqp import Level, Stack, Status
from hqp.tasks import JointLimits, Pose, Position, Posture

DT = 0.002
HAND = Position(frame="tool0", name="hand")
STACK = Stack(Level(HAND), Level(Posture()), subject_to=[JointLimits()])
OTHER = Stack(Level(Pose(frame="tool0", name="pose")), Level(Posture()), subject_to=[JointLimits()])


def session(**fields: Any) -> hqp.Session:
    return hqp.Controller(STACK, **fields).session(hqp.robots.load("ur5"), DT, stuck=False)


def sums(ticks: list[hqp.Tick]) -> dict[str, int]:
    """Counts from the ticks alone."""
    return {
        "ticks": len(ticks),
        "cut": sum(tick.status.cut for tick in ticks),
        "held": sum(tick.held > 0 for tick in ticks),
        "rejected_states": sum(tick.status is Status.INVALID_STATE for tick in ticks),
        "rejected_references": sum(
            sum(note.status is Status.INVALID_REFERENCE for note in tick.notes) for tick in ticks
        ),
    }


@pytest.mark.parametrize("seed", range(4))
@pytest.mark.parametrize("deadline", [math.inf, 1e-7])
def test_counters_are_sums_over_the_ticks_through_every_change(seed: int, deadline: float) -> None:
    draw = np.random.default_rng(seed)
    run = session(deadline=deadline)
    robot, q, stack = run.robot, run.robot.home.copy(), STACK
    ticks: list[hqp.Tick] = []
    for i in range(200):
        if i % 50 == 25:
            stack = OTHER if stack is STACK else STACK
            run.change(stack, over=float(draw.choice([0.0, 0.02])))
        bad = draw.random() < 0.1
        place = np.full(3, np.nan) if draw.random() < 0.1 else draw.uniform(-0.5, 0.5, 3)
        references = [HAND.at(place)] if "hand" in run else []
        state = robot.state(np.full(6, np.nan) if bad else q, np.zeros(6))
        ticks.append(run.step(state, *references))
        assert run.heartbeat == run.counters.ticks == len(ticks)
    expected = sums(ticks)
    counted = run.counters._asdict()
    assert {name: counted[name] for name in expected} == expected
    assert expected["held"]
    assert expected["rejected_states"]
    assert expected["rejected_references"]
    assert bool(expected["cut"]) == (deadline < 1.0)
    assert counted["worst_time"] > 0.0
    assert counted["longest_gap"] > 0.0


def test_late_ticks_and_gaps_are_measured() -> None:
    run = hqp.Controller(STACK, deadline=math.inf).session(hqp.robots.load("ur5"), 1e-7, stuck=False)  # always late
    for _ in range(3):
        run.tick(run.robot.home)
    assert run.counters.late == 3
    run = hqp.Controller(STACK, deadline=math.inf).session(hqp.robots.load("ur5"), 0.1, stuck=False)
    run.tick(run.robot.home)
    assert run.counters.late == 0
    assert run.counters.longest_gap == 0.0
    time.sleep(0.03)
    run.tick(run.robot.home)
    assert run.counters.longest_gap >= 0.03
    assert run.counters.late == 0


def test_a_file_and_a_batch_count_the_same(tmp_path: Path) -> None:
    run = session(deadline=math.inf)
    run.export(tmp_path / "arm.hqp")
    loaded = hqp.load(tmp_path / "arm.hqp")
    batch = hqp.Batch.load(tmp_path / "arm.hqp", 2, threads=1)
    draw = np.random.default_rng(5)
    for _ in range(60):
        q = np.full(6, np.nan) if draw.random() < 0.2 else run.robot.home
        place = np.full(3, np.nan) if draw.random() < 0.2 else draw.uniform(-0.5, 0.5, 3)
        run.step(run.robot.state(q), HAND.at(place))
        loaded.step(q, None, {"hand": place})
        batch.step(np.array([q, q]), None, {"hand": np.array([place, place])})
    counted = run.counters[:6]
    assert run.counters.rejected_states
    assert run.counters.rejected_references
    assert [n for i, n in enumerate(loaded.counters[:6]) if i != 1] == [n for i, n in enumerate(counted) if i != 1]
    assert [n for i, n in enumerate(batch.counters[:6]) if i != 1] == [2 * n for i, n in enumerate(counted) if i != 1]
    loaded.reset()
    assert loaded.heartbeat == loaded.counters.ticks == 60
    loaded.step(run.robot.home)
    assert loaded.heartbeat == 61


def test_another_thread_reads_a_heartbeat_that_only_rises() -> None:
    run = session()
    seen: list[int] = []
    done = threading.Event()

    def watch() -> None:
        while not done.is_set():
            seen.append(run.heartbeat)

    watchdog = threading.Thread(target=watch)
    watchdog.start()
    try:
        for _ in range(300):
            run.tick(run.robot.home)
    finally:
        done.set()
        watchdog.join()
    assert seen == sorted(seen)
    assert run.heartbeat == 300


def test_a_recording_has_the_counters_of_its_time(tmp_path: Path) -> None:
    run = session(deadline=math.inf)
    recorder = run.record(ticks=5, on="not solved", to=tmp_path)
    for i in range(6):
        run.step(run.robot.state(np.full(6, np.nan) if i == 3 else run.robot.home))
    recorder.wait()
    recording = hqp.recorder.load(recorder.files[0])
    assert recording.counters is not None
    assert recording.counters[:6] == (4, run.counters.late, 0, 1, 1, 0)
    assert "1 held; rejected: 1 states" in str(recording)
