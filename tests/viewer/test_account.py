"""Account of a tick on the page, without a browser: words, states, curves, HTML."""

from __future__ import annotations

import numpy as np
import pytest

import hqp
from hqp import Level, P, Stack
from hqp.tasks import Com, FixedContact, JointLimits, Position, Posture
from hqp.viewer import page
from hqp.viewer.account import Account, ElementView, LevelView, make_account
from hqp.viewer.channel import HEAD, Channel, Layout
from hqp.viewer.description import Member, describe_robot, describe_stack
from hqp.viewer.headline import make_headline
from hqp.viewer.history import History
from hqp.viewer.page import number, overlay, panel, sparkline
from hqp.viewer.session_view import View


class Recorded(View):
    """View without a served page: the test reads the channel."""

    def _start(self, host: str, port: int, title: str) -> None:
        self._channel.set_ready(1.0)

    def close(self) -> None:
        self._channel.close()


def run(offset: list[float], ticks: int = 200, closing: float = 0.0) -> tuple[Account, History]:
    robot = hqp.robots.load("cbi")
    hand = Position(frame="r_palm", law=P(5.0, max_velocity=0.5))
    stack = Stack(
        Level(FixedContact(frame="l_sole"), FixedContact(frame="r_sole"), Com(axes="xy"), name="balance"),
        Level(hand, name="hand"),
        Level(Posture(law=P(1.0)), name="posture"),
        subject_to=[JointLimits()],
    )
    view = Recorded(hqp.Controller(stack, deadline=np.inf).session(robot, 0.002), period=0.0)
    q, v = robot.home, np.zeros(robot.nv)
    goal = robot.state(q).position("r_palm") + offset
    history = History(view.description)
    for _ in range(ticks):
        q, v = view.step(robot.state(q, v), hand.at(goal)).advance()
    view._flush()
    history.add(view._channel.read(0))
    _, snapshot = view._channel.read_snapshot(0)
    view.close()
    state = robot.state(q, v)
    far = float(np.linalg.norm(state.position("r_palm") - goal))
    joints = (tuple(robot.joint_name(i) for i in range(robot.nv)), robot.lower, robot.upper, robot.velocity_limit)
    errors = {"r_palm": (far, f"{100 * far:.1f} cm")}
    motion = (state.angles, v)
    return make_account(view.description, snapshot, errors, joints, motion, {"r_palm": closing}), history


def test_within_reach_all_is_well() -> None:
    account, history = run([0.02, 0.0, 0.02], 1500)
    assert account.tone == "good"
    assert account.headline == "Every target is reached; posture gives way"
    assert account.levels[-1].state == "short"
    assert all(e.state == "met" for level in account.levels[:2] for e in level.elements)
    assert history.part(0).size == hqp.robots.load("cbi").nq
    curves = history.curves()
    assert np.nanmax(curves.norms[1]) < 1e-9  # the hand's level is met all the way
    assert curves.all_times.min() > 0.0


@pytest.mark.parametrize(
    ("letters", "count", "size"), [(10, 5, 18), (11, 5, 15), (16, 4, 15), (13, 5, 12), (19, 1, 15)]
)
def test_long_names_are_written_small(letters: int, count: int, size: int) -> None:
    level = LevelView(0, "level 1", (ElementView("n" * letters, "met", 0.0, "", ""),), "met", 0.0)
    assert f"font-size:{size}px;font-weight:650" in page._card(level, np.ones(4), count)


@pytest.mark.long
def test_out_of_reach_says_who_gives_way_to_whom() -> None:
    account, _ = run([2.0, 0.0, 0.5], 1500)
    assert account.tone == "warn", (account.headline, account.reason)
    assert account.headline.startswith("r_palm stays")
    views = {e.name: e for level in account.levels for e in level.elements}
    assert views["r_palm"].state == "short"
    assert views["l_sole"].state == "met"
    assert views["r_palm"].why
    text = overlay(account, run([0.0, 0.0, 0.0], 5)[1].curves(), "title", "20em")
    assert "r_palm stays" in text
    assert "≻" in text


def test_what_still_comes_nearer_does_not_stay_short() -> None:
    account, _ = run([2.0, 0.0, 0.5], 500, closing=0.45)
    assert account.headline.startswith("r_palm is on its way")
    account, _ = run([2.0, 0.0, 0.5], 5, closing=0.001)
    assert account.headline.startswith("r_palm stays")


def test_the_headline_says_what_the_cards_show() -> None:
    names = ("a", "b", "c", "d")
    members = {n: Member(n, "", 0, slice(0), "", 1.0, True, n == "a", "", ()) for n in names}

    def said(states: str, near: dict[str, bool], coming: set[str] | None = None) -> tuple[str, str, str]:
        words = {"m": "met", "w": "moving", "s": "short", "v": "violated"}
        views = [ElementView(n, words[x], 0.0, "5 cm", "") for n, x in zip(names, states, strict=True)]
        return make_headline(
            "OPTIMAL", [LevelView(0, "", tuple(views), "met", 0.0)], (), near, coming or set(), members
        )

    reached = {"b": True, "c": True}
    assert said("mmmm", reached)[0] == "Every target is reached"
    assert said("mmms", reached)[0] == "Every target is reached; d gives way"
    assert said("mmss", reached)[0] == "Every target is reached; c and d give way"
    assert said("msss", reached)[0] == "Every target is reached; b and 2 more give way"
    assert said("mmmm", {})[0] == "Every level is met"
    assert said("mmms", {})[0] == "d gives way"
    assert said("vmmm", reached)[0] == "a slips"
    assert said("mvmm", reached)[::2] == ("b does not hold", "bad")
    assert said("mwmm", {"b": False})[:2] == ("b is on its way, 5 cm to go", "every level above it holds")
    assert said("mswm", {"b": True, "c": False})[:2] == ("c is on its way, 5 cm to go", "b gives way")
    for states in ("msmm", "mssm"):
        assert said(states, {"b": False})[0] == "b stays 5 cm short of its target"
        assert "reach" not in " ".join(said(states, {"b": False}))


def test_the_page_escapes_names_and_draws_limits() -> None:
    account, history = run([0.0, 0.0, 0.0], 20)
    html = panel(account, history.curves(), 2000.0, "rad/s")
    assert "stroke" in html
    assert "over budget" in html
    assert "nan" not in html.lower().replace("nano", "")


def test_curves_show_the_largest_of_each_stretch() -> None:
    robot = hqp.robots.load("cbi")
    session = hqp.Controller(Stack(Level(Posture()))).session(robot, 0.002)
    stack = describe_stack(session.line, session.controller.formulation, 1)
    history = History(stack)
    slots = np.zeros((1000, HEAD + sum(stack.sizes) + 1))
    slots[:, 0], slots[:, 1], slots[:, 2] = np.arange(1000), 0.002 * np.arange(1000), 1
    slots[500, -2] = 3.0  # the last row of the only level
    history.add(slots)
    curves = history.curves()
    assert np.nanmax(curves.norms[0]) == pytest.approx(3.0)
    history.add(slots[:10] * 0 + 5.0)  # another stack
    assert history.status == 0


def test_a_changed_stack_is_described_anew() -> None:
    robot = hqp.robots.load("cbi")
    session = hqp.Controller(Stack(Level(Posture()))).session(robot, 0.002)
    view = Recorded(session)
    view.step(robot.state())
    session.change(Stack(Level(Com(axes="xy")), Level(Posture())))
    view.step(robot.state())
    assert view.description.version == 2
    assert [t.name for t in view.description.targets] == ["com"]
    view.close()


def test_a_held_tick_is_told_though_it_has_no_rows() -> None:
    robot = hqp.robots.load("cbi")
    view = Recorded(hqp.Controller(Stack(Level(Posture()))).session(robot, 0.002), period=0.0)
    page = Channel(view._channel.layout, view._channel.path)
    for v in (np.zeros(robot.nv), np.full(robot.nv, np.nan)):
        view._targets_due = 0.0
        view.step(robot.state(robot.home, v))
    _, snapshot = page.read_snapshot(0)
    view.close()
    joints = (tuple(robot.joint_name(i) for i in range(robot.nv)), robot.lower, robot.upper, robot.velocity_limit)
    account = make_account(view.description, snapshot, {}, joints, (robot.state().angles, np.zeros(robot.nv)))
    assert (account.headline, account.tone) == ("Invalid state", "bad")
    assert "nan" in account.reason.lower()


def test_dragged_targets_replace_references() -> None:
    robot = hqp.robots.load("cbi")
    hand = Position(frame="r_palm")
    view = Recorded(hqp.Controller(Stack(Level(hand))).session(robot, 0.002), control=True)
    there = robot.state().position("r_palm")
    page = Channel(view._channel.layout, view._channel.path)
    page.set_wanted(0, there + [0.1, 0.0, 0.0])
    view.step(robot.state(), hand.at(there))
    assert page.current(0, 3) == pytest.approx(there + [0.1, 0.0, 0.0])
    page.set_wanted(0, None)
    view._targets_due = 0.0  # the next update is due
    view.step(robot.state(), hand.at(there))
    assert page.current(0, 3) == pytest.approx(there)
    view.close()


def test_without_control_the_page_shows_and_nothing_else() -> None:
    robot = hqp.robots.load("cbi")
    hand = Position(frame="r_palm")
    view = Recorded(hqp.Controller(Stack(Level(hand))).session(robot, 0.002))
    there = robot.state().position("r_palm")
    page = Channel(view._channel.layout, view._channel.path)
    page.set_wanted(0, there + [0.1, 0.0, 0.0])
    page.set_paused(True)
    tick = view.step(robot.state(), hand.at(there))
    assert page.current(0, 3) == pytest.approx(there)
    assert abs(tick.command).max() < 1e-6
    assert not view.paused
    view.wait()  # returns
    view.close()


def test_shapes_of_a_robot_of_our_own() -> None:
    about = describe_robot(hqp.robots.load("cbi"))
    assert {shape.kind for shape in about.shapes} <= {"box", "cylinder", "sphere", "mesh", "capsule"}
    assert len(about.shapes) > 20


def test_numbers_and_empty_curves() -> None:
    assert [number(x) for x in (0.0, 1e-12, 2e-5, 0.1234, 123.4)] == ["0", "0", "2e-5", "0.123", "123"]
    assert "polyline" not in sparkline(np.full(5, np.nan), "red")
    assert Layout(3, 1).width == HEAD + 4


def test_targets_without_a_reference_are_shown_where_they_are_held() -> None:
    robot = hqp.robots.load("cbi")
    hand, chest = Position(frame="r_palm"), Position(frame="l_palm")
    view = Recorded(hqp.Controller(Stack(Level(hand), Level(chest))).session(robot, 0.002))
    page = Channel(view._channel.layout, view._channel.path)
    state = robot.state()
    there = state.position("r_palm")
    for references, wanted in (((), there), ((hand.at(there + 0.1),), there + 0.1), ((), there)):
        view._targets_due = 0.0
        view.step(state, *references)
        assert page.current(0, 3) == pytest.approx(wanted)
        assert page.current(1, 3) == pytest.approx(state.position("l_palm"))
    view.session.hold_values["r_palm"][:] = 99.0  # the caller owns it
    assert view.session.hold_values["r_palm"] == pytest.approx(there)
    view.close()
