"""Stacks that change over some time while a robot walks: measured loads attach and release contacts."""

from __future__ import annotations

from dataclasses import replace
from typing import Any

import numpy as np
import pytest

pytest.importorskip("mujoco")

from hqp.declare.reference import Reference
from hqp.declare.stack import Level, Stack

from .test_walker import Walked

OVER = 0.05
"""Duration of every change of stack [s]."""


def only(stack: Stack, phase: str) -> Stack:
    """The stack of one phase, declared without phases."""
    out = stack.out_of(phase)
    gone = {
        e.name
        for e in stack
        if e.name in out or out & {getattr(e, "contact", None), *(getattr(e, "contacts", None) or ())}
    }
    kept = {e.name: replace(e, when=()) for e in stack if e.name not in gone}
    levels = [
        Level(*own, name=level.name, price=level.price)
        for level in stack.levels
        if (own := [kept[e.name] for e in level if e.name in kept])
    ]
    return Stack(*levels, subject_to=[kept[e.name] for e in stack.subject_to if e.name in kept])


@pytest.mark.slow
@pytest.mark.parametrize(("name", "jump"), [("talos", 25.0), ("g1", 25.0)])
def test_a_walk_bears_changes_that_take_time(name: str, jump: float, monkeypatch: pytest.MonkeyPatch) -> None:
    """Without the loads both fall within three steps."""
    course = Walked.of(name, sensed=False)
    walker, session = course.walker, course.walker.session
    step, walk, whole = session.step, walker.step, walker.stacks.stack
    stacks = {phase: only(whole, phase) for phase in whole.phases()}
    session.change(stacks["both"])
    loads: list[float] = []
    current = "both"

    def felt(state: Any, *references: Reference, phase: str, **named: Any) -> Any:
        nonlocal current
        if phase != current:
            current = phase
            session.change(stacks[phase], OVER)
        contacts = zip((foot.name for foot in walker.feet), loads, strict=True)
        given = (r for r in references if r.name in session)
        return step(state, *given, *(Reference(n).loaded(f) for n, f in contacts if n in session), **named)

    def walked(state: Any, given: Any, **named: Any) -> Any:
        loads[:] = given
        return walk(state, given, **named)

    monkeypatch.setattr(session, "step", felt)
    monkeypatch.setattr(walker, "step", walked)
    course.run(1.1)
    walker.go(forward=0.2)
    course.run(0.1)
    course.jumps.clear()  # jumps at the start
    course.run(3.9)
    assert course.plant.com()[0] > 0.5
    assert max(course.jumps) < jump
    assert np.mean([course.statuses[s] for s in ("OPTIMAL", "CONTACT_LOST")]) * 2 > 0.98 * course.statuses.total()
