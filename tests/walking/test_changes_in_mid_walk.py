"""Stacks that change over some time while a robot walks: contacts are taken up and let go by their measured load."""

from __future__ import annotations

from typing import Any

import numpy as np
import pytest

pytest.importorskip("mujoco")

from hqp.declare.reference import Reference

from .test_walker import Walked

OVER = 0.05
"""Of every change of stack [s]."""


@pytest.mark.slow
@pytest.mark.parametrize(("name", "jump"), [("talos", 25.0), ("g1", 25.0)])
def test_a_walk_bears_changes_that_take_time(name: str, jump: float, monkeypatch: pytest.MonkeyPatch) -> None:
    """Without the loads both fall within three steps."""
    course = Walked.of(name, sensed=False)
    walker, session = course.walker, course.walker.session
    change, step, walk = session.change, session.step, walker.step
    loads: list[float] = []

    def felt(state: Any, *references: Reference, **more: Any) -> Any:
        contacts = zip((foot.name for foot in walker.feet), loads, strict=True)
        return step(state, *references, *(Reference(n).loaded(f) for n, f in contacts if n in session), **more)

    def walked(state: Any, given: Any) -> Any:
        loads[:] = given
        return walk(state, given)

    monkeypatch.setattr(session, "change", lambda stack: change(stack, OVER))
    monkeypatch.setattr(session, "step", felt)
    monkeypatch.setattr(walker, "step", walked)
    course.run(1.1)
    walker.go(forward=0.2)
    course.run(0.1)
    course.jumps.clear()  # of the start
    course.run(3.9)
    assert course.plant.com()[0] > 0.5
    assert max(course.jumps) < jump
    assert np.mean([course.statuses[s] for s in ("OPTIMAL", "CONTACT_LOST")]) * 2 > 0.98 * course.statuses.total()
