"""Velocities that a walk can follow: bounded steps between them, and a reason for every change."""

from __future__ import annotations

import math

import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from hqp.walking import Command, Gait, Reach
from hqp.walking.preview import COMFORT, QUICK, TURNS, Ability

ABLE = Ability(
    gait=Gait(), reach=Reach(forward=0.26, least=0.12, most=0.3, turn=0.4), width=0.2, height=0.65, gravity=9.81
)
speeds = st.builds(Command, *(st.floats(-2.0, 2.0) for _ in range(3)))


@settings(max_examples=80)
@given(speeds)
def test_what_is_changed_is_said(asked: Command) -> None:
    found, why = ABLE.allowed(asked)
    changed = [name for name in ("forward", "left", "turn") if getattr(found, name) != getattr(asked, name)]
    assert [text.split()[0] for text in why] == changed
    assert ABLE.allowed(found) == (found, ())
    T = ABLE.haste(found) * ABLE.gait.period
    assert abs(found.forward) * QUICK * ABLE.gait.period <= ABLE.reach.forward + 1e-9
    assert abs(found.forward) * T <= ABLE.reach.forward + 1e-9
    assert ABLE.haste(found) <= 1.0
    assert abs(found.left) * 2.0 * T <= ABLE.reach.most - ABLE.width + 1e-9


@settings(max_examples=80)
@given(speeds, speeds)
def test_velocities_change_by_bounded_steps_and_arrive(now: Command, asked: Command) -> None:
    paces = ABLE.paces(now, asked, most=200)
    assert paces[-1] == asked
    for one, other in zip([now, *paces], paces, strict=False):
        assert math.hypot(other.forward - one.forward, other.left - one.left) <= ABLE.change + 1e-9
        assert abs(other.turn - one.turn) <= TURNS + 1e-9


def test_fast_walks_take_quicker_steps_not_longer_ones() -> None:
    fastest, _ = ABLE.allowed(Command(10.0, 0.0, 0.0))
    assert fastest.forward > 1.3 * ABLE.reach.forward / ABLE.gait.period
    assert ABLE.haste(fastest) < 0.75 < ABLE.haste(Command(0.05, 0.0, 0.0))


@pytest.mark.parametrize("share", [1.1, 1.3])
@pytest.mark.parametrize("aside", [False, True])
def test_steps_longer_than_comfortable_become_as_much_quicker(share: float, aside: bool) -> None:
    """A step within the gait's time would take ``share`` of the comfortable part of the reach."""
    T, reach = ABLE.gait.period, ABLE.reach
    most = 0.5 * (reach.most - ABLE.width) if aside else reach.forward
    speed = -share * COMFORT * most / T
    assert ABLE.haste(Command(left=speed) if aside else Command(forward=speed)) == pytest.approx(1.0 / share)
