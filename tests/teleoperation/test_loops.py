"""Robots that follow an operator over a bad network, at velocity and at torque level."""

from __future__ import annotations

from collections.abc import Iterator
from typing import Any

import numpy as np
import pytest

import hqp
from hqp.arrays import Mat

from .operator_loop import Done, plain, run, setup

GONE, BACK = 1.3, 1.6
"""Begin and end of the network failure [s]."""

START = "fewer than three consistent packets: held"

WINDOW = 0.1
"""Change of a joint's speed that ``JointLimits`` allows in a tick of 2 ms [rad/s]."""

ROBOTS = ("ur5", "g1", "talos")


def dropout(t: float, pose: Mat) -> Iterator[dict[str, Any]]:
    if not GONE < t < BACK:
        yield from plain(t, pose)


def twice(t: float, pose: Mat) -> Iterator[dict[str, Any]]:
    yield from plain(t, pose)
    yield from plain(t, pose)


def nans(t: float, pose: Mat) -> Iterator[dict[str, Any]]:
    yield {"value": np.full((4, 4), np.nan) if GONE < t < BACK or round(72 * t) % 7 == 0 else pose, "sent": t}


def teleports(t: float, pose: Mat) -> Iterator[dict[str, Any]]:
    away = pose.copy()
    away[:3, 3] += (2.0, 0.0, 0.0)
    yield {"value": away if GONE < t < BACK or round(72 * t) % 7 == 0 else pose, "sent": t}


def flips(t: float, pose: Mat) -> Iterator[dict[str, Any]]:
    flipped = pose.copy()
    flipped[:3, :3] = np.diag([1.0, -1.0, -1.0]) @ pose[:3, :3]
    yield {"value": flipped if GONE < t < BACK or round(72 * t) % 7 == 0 else pose, "sent": t}


def mirrored(t: float, pose: Mat) -> Iterator[dict[str, Any]]:
    wrong = pose.copy()
    wrong[:3, 0] *= -1.0
    yield {"value": wrong if GONE < t < BACK or round(72 * t) % 7 == 0 else pose, "sent": t}


def drifting(t: float, pose: Mat) -> Iterator[dict[str, Any]]:
    yield {"value": pose, "sent": 1.002 * t - 77.0}


class Swapped:
    """Swap each two successive packets."""

    def __init__(self) -> None:
        self.kept: list[dict[str, Any]] = []

    def __call__(self, t: float, pose: Mat) -> Iterator[dict[str, Any]]:
        self.kept += plain(t, pose)
        if len(self.kept) == 2:
            yield from reversed(self.kept)
            self.kept = []


FAULTS: dict[str, Any] = {
    "dropout": dropout, "twice": twice, "swapped": Swapped, "nan": nans, "teleport": teleports, "flip": flips,
    "mirrored": mirrored, "drift": drifting,
}  # fmt: skip
TOLD = {
    "dropout": "no packet", "twice": "duplicate", "swapped": "older", "nan": "not finite", "teleport": "2 outside",
    "flip": "3.14 outside", "mirrored": "not a rotation",
}  # fmt: skip


def fault(name: str) -> Any:
    return FAULTS[name]() if isinstance(FAULTS[name], type) else FAULTS[name]


def judge(done: Done, name: str) -> None:
    assert done.statuses == {"OPTIMAL"}
    assert done.jump < WINDOW + 1e-9
    assert done.worst(0.0, GONE) < 5e-3
    assert done.worst(BACK + 0.5) < 5e-3
    assert done.turned[done.time > BACK + 0.5].max() < 0.02
    if name in TOLD:
        assert any(TOLD[name] in note for note in done.notes), done.notes
    else:
        assert set(done.notes) == {START}


@pytest.mark.parametrize("name", FAULTS)
def test_an_arm_is_back_within_half_a_second(name: str) -> None:
    judge(run(*setup("ur5"), fault(name)), name)


@pytest.mark.long
@pytest.mark.parametrize("robot", ["g1", pytest.param("talos", marks=pytest.mark.slow)])
@pytest.mark.parametrize("name", ["dropout", "teleport", "flip"])
def test_a_humanoid_is_back_within_half_a_second(robot: str, name: str) -> None:
    done = run(*setup(robot), fault(name))
    judge(done, name)
    assert done.drift < 1e-4


@pytest.mark.slow
@pytest.mark.parametrize("robot", ROBOTS)
@pytest.mark.parametrize("name", ["dropout", "teleport", "flip"])
def test_at_torque_level_too(robot: str, name: str) -> None:
    done = run(*setup(robot, torque=True), fault(name), torque=True)
    assert done.statuses == {"OPTIMAL"}
    assert done.worst(0.0, GONE) < 5e-3
    assert done.worst(BACK + 0.5) < 5e-3
    assert done.drift < 1e-3


@pytest.mark.parametrize("rate", [30.0, 72.0, 120.0])
@pytest.mark.parametrize("dt", [pytest.param(0.001, marks=pytest.mark.slow), 0.002])
def test_no_lag_within_reach(rate: float, dt: float) -> None:
    done = run(*setup("ur5"), rate=rate, dt=dt)
    fastest = 0.05 * np.pi * np.sqrt(2.0)
    assert done.off[done.time > 1.3].max() < 2e-3 * fastest / 0.2
    third = np.diff(done.commands[done.time > 1.3], 2, axis=0) / dt**2
    assert np.sqrt((third**2).mean(axis=0)).max() < 50.0


@pytest.mark.long
def test_what_is_late_is_predicted() -> None:
    """A delay of 30 ms: ``latency`` states the part that the clocks do not show."""
    robot, hand, stack, start = setup("ur5")
    late = run(robot, hand, stack, start, delay=0.03)
    told = run(robot, hand, stack, start, delay=0.03, follow=hqp.Follow(hand, latency=0.03, max_age=0.2))
    assert late.off[late.time > 1.3].max() < 0.03 * 0.25  # at most the age
    assert told.off[told.time > 1.3].max() < 2.5e-3
