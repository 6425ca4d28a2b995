"""A recording in the viewer, without a browser: recorded ticks, and refused files."""

from __future__ import annotations

import math
from pathlib import Path

import numpy as np
import pytest

import hqp
from hqp import Level, P, Stack
from hqp.errors import HqpError
from hqp.recorder import Recording, load
from hqp.tasks import Com, FixedContact, JointLimits, Position, Posture
from hqp.viewer import replay as module
from hqp.viewer.account import make_account
from hqp.viewer.history import History

HAND = Position(frame="r_palm", law=P(5.0, max_velocity=0.5), name="hand")
STACK = Stack(
    Level(FixedContact(frame="l_sole"), FixedContact(frame="r_sole"), Com(axes="xy"), name="balance"),
    Level(HAND, name="hand"),
    Level(Posture(law=P(1.0)), name="posture"),
    subject_to=[JointLimits()],
)


@pytest.fixture(scope="module")
def recording(tmp_path_factory: pytest.TempPathFactory) -> Recording:
    robot = hqp.robots.load("cbi")
    session = hqp.Controller(STACK, deadline=math.inf).session(robot, 0.002)
    session.step(robot.state())
    recorder = session.record(ticks=30, on="never", to=tmp_path_factory.mktemp("recordings"))
    q, v = robot.home, np.zeros(robot.nv)
    goal = robot.state(q).position("r_palm") + [2.0, 0.0, 0.5]
    for _ in range(40):
        q, v = session.step(robot.state(q, v), HAND.at(goal)).advance()
    recorder.dump()
    recorder.wait()
    return load(recorder.files[0])


class Kept(module.ReplayView):
    """View without a served page: the test reads the channel."""

    kept: Kept

    def _start(self, host: str, port: int, title: str) -> None:
        self._channel.set_ready(1.0)
        self.period = 0.0
        Kept.kept = self
        self._hurry = True

    def wait(self) -> None:
        """Return at once."""

    def close(self) -> None:
        self._flush()
        self.history = History(self.description)
        self.history.add(self._channel.read(0))
        _, self.snapshot = self._channel.read_snapshot(0)
        self._channel.close()


def test_ticks_are_shown_as_they_were(recording: Recording, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(module, "ReplayView", Kept)
    robot = hqp.robots.load("cbi")
    shown = module.replay(recording, robot, seconds=0.2, speed=1000.0)
    assert shown > 1
    last = recording[(shown - 1) % len(recording)]
    view = Kept.kept
    assert np.array_equal(view.history.part(0), last.q)
    assert np.array_equal(view.history.part(2), last.command)
    joints = (tuple(robot.joint_name(i) for i in range(robot.nv)), robot.lower, robot.upper, robot.velocity_limit)
    state = robot.state(last.q, last.v)
    account = make_account(view.description, view.snapshot, {}, joints, (state.angles, last.v))
    assert account.status == last.status.name
    assert {e.name for level in account.levels for e in level.elements} >= {"hand", "com", "l_sole", "joint_limits"}


def test_another_robot_is_refused(recording: Recording) -> None:
    with pytest.raises(HqpError, match="joints are not those"):
        module.replay(recording, hqp.robots.load("ur5"), seconds=0.1)


def test_the_command_takes_a_recording(recording: Recording, tmp_path: Path) -> None:
    from hqp.__main__ import main

    wrong = tmp_path / "broken.npz"
    wrong.write_bytes(b"no recording")
    assert main(["view", str(wrong), "--robot", "cbi"]) == 2
