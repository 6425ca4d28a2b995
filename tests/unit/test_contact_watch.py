"""Measured loads reveal contacts that the stack assumes but that do not exist."""

from __future__ import annotations

import numpy as np
import pytest

import hqp
from hqp import Level, P, Stack, Status
from hqp.errors import DeclarationError
from hqp.tasks import Com, FixedContact, Posture

LEFT, RIGHT = FixedContact(frame="l_sole"), FixedContact(frame="r_sole")
STACK = Stack(Level(LEFT, RIGHT, Com(axes="xy", law=P(2.0))), Level(Posture(law=P(1.0))))


@pytest.fixture
def session() -> hqp.Session:
    return hqp.Controller(STACK, hqp.Velocity()).session(hqp.robots.load("cbi"), dt=0.002)


def step(session: hqp.Session, *loads: float | None) -> hqp.Tick:
    references = [foot.at().loaded(x) for foot, x in zip((LEFT, RIGHT), loads, strict=False) if x is not None]
    return session.step(session.robot.state(), *references)  # type: ignore[attr-defined]


def test_a_contact_without_load_for_a_while_is_lost_and_named(session: hqp.Session) -> None:
    for _ in range(9):
        assert step(session, 300.0, 0.0).status is Status.OPTIMAL  # 18 ms: it may bounce
    tick = step(session, 300.0, 0.0)
    assert tick.status is Status.CONTACT_LOST
    assert [(n.element, n.status) for n in tick.notes] == [("r_sole", Status.CONTACT_LOST)]
    assert "20 ms" in tick.notes[0].detail
    assert tick.status.usable
    assert np.array_equal(tick.command, tick.solution.x[6:])  # the command still is that of the stack
    assert step(session, 300.0, 250.0).status is Status.OPTIMAL


def test_a_missing_or_nan_load_is_no_measurement(session: hqp.Session) -> None:
    for load in [0.0] * 5 + [None, float("nan")] * 20:
        assert step(session, 300.0, load).status is Status.OPTIMAL
    for _ in range(4):
        step(session, 300.0, 0.0)
    assert step(session, 300.0, 0.0).status is Status.CONTACT_LOST


def test_a_contact_that_leaves_the_stack_is_judged_no_more(session: hqp.Session) -> None:
    for _ in range(12):
        tick = step(session, 300.0, 0.0)
    assert tick.status is Status.CONTACT_LOST
    session.change(Stack(Level(LEFT, Com(axes="xy", law=P(2.0))), Level(Posture(law=P(1.0)))))
    assert step(session, 300.0).status is Status.OPTIMAL


def test_a_load_for_what_is_no_contact_is_refused(session: hqp.Session) -> None:
    com = STACK.find("com", Com)
    with pytest.raises(DeclarationError, match="not a contact"):
        session.step(session.robot.state(), com.at().loaded(3.0))  # type: ignore[attr-defined]
