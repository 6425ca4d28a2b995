"""The page in a real browser: it shows the robot, a target is dragged, the loop is hardly slower."""

from __future__ import annotations

import threading
import time
from collections.abc import Iterator
from typing import Any

import numpy as np
import pytest

import hqp
from hqp import Level, P, Stack
from hqp.tasks import CollisionAvoidance, Com, FixedContact, JointLimits, Orientation, Position, Posture
from tests.browser.chromium import arrow, drag, shoot, tab_at, wait_for
from tests.counting import calls

DT = 0.002
CALLS, PICTURE = 20, 600
"""Function calls that the view may add to a tick, without and with a picture; a call takes some 0.1 us."""

REACH = np.array([0.12, 0.05, 0.15])
pytestmark = pytest.mark.browser


class Loop(threading.Thread):
    """A robot that executes every command, at 500 Hz next to its page."""

    def __init__(self) -> None:
        super().__init__(daemon=True)
        self.robot = robot = hqp.robots.load("g1")
        left, right = robot.landmarks["soles"]
        feet = [FixedContact(frame=left, name="left_foot"), FixedContact(frame=right, name="right_foot")]
        self.hand = Position(frame="right_wrist_yaw_link", law=P(5.0, max_velocity=0.5), name="right_hand")
        stack = Stack(
            Level(*feet, Com(axes="xy", law=P(2.0)), name="balance"),
            Level(CollisionAvoidance(name="no_collision"), name="safety"),
            Level(self.hand, name="hand"),
            Level(Orientation(frame="pelvis", law=P(2.0)), name="base"),
            Level(Posture(law=P(1.0)), name="posture"),
            subject_to=[JointLimits()],
        )
        self.session = hqp.Controller(stack).session(robot, DT)
        self.view = hqp.view(self.session, control=True)
        self.q, self.v = robot.home.copy(), np.zeros(robot.nv)
        self.goal: Any = None
        self.home = self.position()
        self.counted: dict[bool, list[int]] | None = None
        self.tick: Any = None
        self.going = True

    def run(self) -> None:
        due = time.perf_counter()
        while self.going:
            self.view.wait()
            references = () if self.goal is None else (self.hand.at(self.goal),)
            state = self.robot.state(self.q, self.v)
            if (counted := self.counted) is None:
                self.tick = self.view.step(state, *references)
            else:  # with and without in turn
                seen = self.session.count % 2 == 0
                counted[seen].append(calls(self.step, self.view if seen else self.session, state, references))
            self.q, self.v = self.tick.advance()
            due = max(due + DT, time.perf_counter())
            time.sleep(max(0.0, due - time.perf_counter()))

    def step(self, stepper: Any, state: Any, references: tuple[Any, ...]) -> None:
        self.tick = stepper.step(state, *references)

    def position(self) -> Any:
        return hqp.robots.load("g1").state(self.q).position("right_wrist_yaw_link")


@pytest.fixture(scope="module")
def page() -> Iterator[tuple[Loop, Any]]:
    loop = Loop()
    loop.start()
    try:
        with tab_at(loop.view.url) as tab:
            yield loop, tab
    finally:
        loop.going = False
        loop.join(timeout=5.0)
        loop.view.close()


def test_reachable(page: tuple[Loop, Any]) -> None:
    loop, tab = page
    loop.goal = loop.home + REACH
    wait_for(tab, "Every target is reached")
    tab.wait_for_timeout(1_000)
    shoot(tab, "reached")


def test_out_of_reach(page: tuple[Loop, Any]) -> None:
    loop, tab = page
    loop.goal = loop.home + [0.7, 0.0, 0.25]
    wait_for(tab, "right_hand stays")
    tab.wait_for_timeout(6_000)
    shoot(tab, "out_of_reach")
    assert "right_hand" in tab.inner_text("body")


def test_at_a_limit(page: tuple[Loop, Any]) -> None:
    """High above: knees and elbow reach the end of their range."""
    loop, tab = page
    loop.goal = loop.home + [0.1, 0.0, 1.2]
    wait_for(tab, "right_hand stays")
    wait_for(tab, "end of its range")
    tab.wait_for_timeout(6_000)
    shoot(tab, "at_a_limit")
    drag(tab, *arrow(tab, still=False), 0, 15)  # the target, above 2 m, is below the headline and not behind it
    tab.wait_for_timeout(1_000)
    assert "right_hand" in loop.view._dragged
    tab.click("text=Give targets back")


def test_in_collision(page: tuple[Loop, Any]) -> None:
    """Inside the pelvis: links stay apart, and the page names them."""
    loop, tab = page
    loop.goal = hqp.robots.load("g1").state().position("pelvis") + [0.0, 0.0, 0.02]
    wait_for(tab, "Kept apart")
    tab.wait_for_timeout(8_000)
    shoot(tab, "in_collision")


def test_a_target_is_dragged(page: tuple[Loop, Any]) -> None:
    loop, tab = page
    loop.goal = loop.home + REACH
    tab.wait_for_timeout(6_000)
    assert not loop.view._dragged
    x, y = arrow(tab)
    before = loop.position()
    drag(tab, x, y, 0, -55)
    tab.wait_for_timeout(4_000)
    assert "right_hand" in loop.view._dragged, "the drag did not arrive in the loop"
    assert loop.position()[2] > before[2] + 0.02  # along the arrow upwards
    shoot(tab, "dragged")
    tab.click("text=Give targets back")
    tab.wait_for_timeout(1_000)
    assert not loop.view._dragged


def test_the_loop_hardly_notices(page: tuple[Loop, Any]) -> None:
    """Function calls that the view adds to a tick: a count that does not depend on the load of the machine."""
    loop, tab = page
    loop.counted = {True: [], False: []}
    tab.wait_for_timeout(10_000)
    counted, loop.counted = loop.counted, None
    seen, alone = (np.array(counted[each]) for each in (True, False))
    assert min(seen.size, alone.size) > 100
    few, plain = np.percentile(seen, 10), np.median(alone)
    most = np.percentile(seen, 99)
    print(
        f"\nthe view adds {few - plain:.0f} calls to a tick of {plain:.0f}, {most - plain:.0f} where it takes a picture"
    )
    assert few - plain <= CALLS
    assert most - plain <= PICTURE


def test_pause_and_step(page: tuple[Loop, Any]) -> None:
    loop, tab = page
    tab.click("text=Pause")
    tab.wait_for_timeout(800)
    before = loop.session.count
    tab.wait_for_timeout(800)
    assert loop.session.count == before
    tab.click("text=Step")
    tab.wait_for_timeout(800)
    assert loop.session.count == before + 1
    tab.get_by_text("Run", exact=True).click()  # viser's notes may contain "running"
    tab.wait_for_timeout(800)
    assert loop.session.count > before + 10
