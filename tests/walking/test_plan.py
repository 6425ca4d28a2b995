"""A walk as a reference motion, and the command that writes it."""

from __future__ import annotations

import os
import pty
import sys
from pathlib import Path
from types import SimpleNamespace
from typing import Any

import numpy as np
import pytest

import hqp.robots
from hqp.__main__ import main
from hqp.errors import DeclarationError
from hqp.walking import Gait, Walker
from hqp.walking.keys import Keys
from hqp.walking.plan import _loads


@pytest.mark.long
def test_a_plan_walks_where_it_is_told(tmp_path: Path) -> None:
    """Stance feet neither slide nor sink, the CoM covers the requested distance, and the walker is unchanged."""
    robot = hqp.robots.load("g1", rotors=True)
    walker = Walker(robot, Gait(single=0.4, double=0.1, first=0.4))
    walker.go(0.2)
    motion = walker.plan(4.0, fps=50.0)
    assert walker.time == 0.0
    assert motion.q.shape == (201, robot.nq)
    assert "swing" in motion.phases
    assert motion.phases[-1] == "stand"
    landed = [int(np.sum(motion.contacts[1:, k] & ~motion.contacts[:-1, k])) for k in (0, 1)]
    assert min(landed) > 0
    assert str(motion) == f"g1: 201 frames, 4.0 s; landings: left foot {landed[0]}, right foot {landed[1]}"
    for side, foot in enumerate(walker.feet):
        places = np.array([robot.state(q).position(foot.frame) for q in motion.q])
        stands = motion.contacts[:, side]
        held = stands[1:] & stands[:-1]
        assert np.abs(np.diff(places, axis=0)[held, :2]).max() * motion.fps < 2e-3
        assert np.abs(places[stands, 2]).max() < 2e-3
        assert places[~stands, 2].max() > 0.04
    start, end = (robot.state(motion.q[k]).com() for k in (0, -1))
    assert 0.08 < end[0] - start[0] < 0.3
    motion.save(tmp_path / "walk.npz")
    with np.load(tmp_path / "walk.npz") as file:
        assert str(file["quaternion_order"]) == "xyzw"
        assert tuple(file["joint_names"]) == robot.joint_names
        assert tuple(file["contact_names"]) == ("left", "right")
        assert file["fps"] == 50.0
        np.testing.assert_array_equal(file["q"], motion.q)
    with pytest.raises(DeclarationError, match="npz"):
        motion.save(tmp_path / "walk.csv")
    for fps in (0.0, 1e9):
        with pytest.raises(DeclarationError, match="fps"):
            walker.plan(1.0, fps=fps)


@pytest.mark.long
def test_frames_are_as_far_apart_as_their_rate_says() -> None:
    """Frames lie on the motion of the ticks, at rates that divide that of the ticks, that do not, and above it."""
    robot = hqp.robots.load("g1", rotors=True)
    walker = Walker(robot, Gait(single=0.3, double=0.1, first=0.3))
    walker.go(0.2)
    every = walker.plan(1.2, fps=1.0 / walker.dt)
    times = np.arange(len(every.q)) * walker.dt
    for fps in (7.0, 30.0, 120.0, 333.0, 1000.0):
        motion = walker.plan(1.2, fps=fps)
        assert len(motion.q) == round(1.2 * fps) + 1
        for f, q in enumerate(motion.q):
            k = min(int(f / fps / walker.dt + 1e-6), len(times) - 2)
            low, high = every.q[k], every.q[k + 1]
            share = f / fps / walker.dt - k
            np.testing.assert_allclose(q[7:], low[7:] + share * (high[7:] - low[7:]), rtol=0.0, atol=1e-9)
            np.testing.assert_allclose(q[:3], low[:3] + share * (high[:3] - low[:3]), rtol=0.0, atol=1e-6)


@pytest.mark.long
def test_a_plan_without_a_step_says_so() -> None:
    walker = Walker(hqp.robots.load("g1", rotors=True))
    assert walker.plan(0.1).remarks == ()
    walker.go(0.2)
    least = walker.stopping_time + walker.gait.first
    assert walker.plan(least + 0.1).remarks == ()
    short = walker.plan(least - 0.1)
    assert "swing" not in short.phases
    assert f"no step in {least - 0.1:.4g} s" in str(short)
    walker.go(3.0)
    assert walker.plan(0.1).remarks[:-1] == walker.why != ()


@pytest.mark.parametrize("side", [0, 1])
@pytest.mark.parametrize(("height", "share"), [(0.1, 0.0), (0.0, 0.1)])
def test_a_swing_foot_on_the_ground_takes_a_tenth_of_the_weight(side: int, height: float, share: float) -> None:
    part: Any = SimpleNamespace
    feet, holds = [part(frame="left"), part(frame="right")], [part(z=0.0), part(z=0.0)]
    walker = part(weight=100.0, phase="swing", stance=1 - side, feet=feet, holds=holds)
    found = _loads(walker, part(position=lambda frame: np.array([0.0, 0.0, height])))
    assert (found[side], found[1 - side]) == (100.0 * share, 100.0 * (1.0 - share))


@pytest.mark.long
def test_the_command_writes_a_plan(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    assert main(["walk", "--robot", "g1", "--seconds", "0.4", "--output", str(tmp_path / "g1.npz")]) == 0
    assert "21 frames" in capsys.readouterr().out
    assert (tmp_path / "g1.npz").is_file()


def test_keys_are_a_joystick() -> None:
    keys = Keys()
    assert keys.press("x") is None
    assert keys.press("ww") == (0.1, 0.0, 0.0)
    assert keys.press("Aq") == (0.1, 0.02, 0.05)
    assert keys.press("w" * 20) == (0.4, 0.02, 0.05)
    assert keys.press(" ") == (0.0, 0.0, 0.0)


def test_keys_pressed_at_once_are_all_read(monkeypatch: pytest.MonkeyPatch) -> None:
    own, theirs = pty.openpty()
    with open(theirs) as terminal:
        monkeypatch.setattr(sys, "stdin", terminal)
        with Keys() as keys:
            assert keys.command() is None
            os.write(own, b"www")
            assert keys.command() == (0.15, 0.0, 0.0)
            assert keys.command() is None
    os.close(own)
