"""Changes of stack in a file give the numbers of Python's session, to the last bit, with its notes."""

from __future__ import annotations

from pathlib import Path
from typing import Any

import numpy as np
import pytest

import hqp
import hqp.tasks as t
from hqp import Level, Stack
from hqp.errors import DeclarationError
from hqp.export.loaded import LoadedSession
from hqp.loop.file import text
from hqp.solvers.lexicographic import kernel
from tests.scenes.changes import lifted, smooth
from tests.scenes.one_loop import DT, Loop
from tests.scenes.stacks import FORMULATIONS

pytestmark = pytest.mark.skipif(not kernel(), reason="no native kernel here")

HELD: tuple[tuple[Any, dict[str, str]], ...] = (
    (t.Position, {"frame": "tool0", "name": "hand"}),
    (t.Orientation, {"frame": "tool0", "name": "turn"}),
    (t.Posture, {}),
)


class Pair(Loop):
    """All three give the same bits, and the same notes."""

    def step(self, *references: hqp.Reference, bad: bool = False) -> hqp.Tick:
        tick, found, worlds = self.answers(*references, bad=bad)
        where = f"tick {self.ticks}"
        if worlds is not None:
            for k in self.changed:
                np.testing.assert_array_equal(worlds.x[k], tick.x, err_msg=f"{where} of world {k}")
                assert worlds.statuses()[k] is tick.status
        np.testing.assert_array_equal(found.x, tick.x, err_msg=where)
        np.testing.assert_array_equal(found.command, tick.command, err_msg=where)
        assert (found.status, found.held, found.transition) == (tick.status, tick.held, tick.transition), where
        told = tuple(note for note in tick.notes if not note.detail.startswith("requested "))
        assert set(found.notes) == set(told), where
        self.advance(tick, bad=bad)
        return tick


def arm() -> tuple[Any, dict[str, Stack], t.Position]:
    robot = hqp.robots.load("ur5")
    hand = t.Position(frame="tool0", name="hand")
    turn, posture, limits = t.Orientation(frame="tool0", name="turn"), t.Posture(name="posture"), [t.JointLimits()]
    whole = Stack(Level(hand), Level(turn), Level(posture), subject_to=limits)
    swapped = Stack(Level(turn), Level(hand), Level(posture), subject_to=limits)
    return robot, {"": whole, "rest": whole.without("hand"), "swapped": swapped}, hand


def humanoid(level: str) -> tuple[Any, dict[str, Stack], list[Any]]:
    robot = hqp.robots.load("g1")
    feet = [t.FixedContact(frame=sole) for sole in robot.landmarks["soles"]]
    hand, com = t.Position(frame=robot.landmarks["palms"][0], name="hand"), t.Com(name="com")
    forces = [t.FrictionCone(contact=foot.name, mu=0.7) for foot in feet] if level == "torque" else []
    whole = Stack(
        Level(com), Level(hand), Level(t.Posture(name="posture")), subject_to=[t.JointLimits(), *feet, *forces]
    )
    return robot, {"": whole, "free": whole.without("hand"), "one foot": lifted(whole, robot)}, [com, hand]


@pytest.mark.long
@pytest.mark.parametrize("level", FORMULATIONS)
def test_changes_on_an_arm(level: str) -> None:
    robot, stacks, hand = arm()
    loop = Pair(robot, stacks, FORMULATIONS[level]())
    start = robot.state().position("tool0")
    goal = hand.at(start + [0.1, -0.1, 0.1])
    for name, over in (("rest", 0.02), ("swapped", 0.03), ("", 0.0), ("swapped", 0.04), ("", 0.02), ("rest", 0.0)):
        loop.change(name, over)
        for k in range(50):
            loop.step(*([goal] if k % 30 < 25 else []), bad=k == 7)
    assert loop.run.line.transition is None


@pytest.mark.long
@pytest.mark.parametrize("level", FORMULATIONS)
def test_a_change_in_the_midst_of_others(level: str) -> None:
    robot, stacks, hand = arm()
    loop = Pair(
        robot, stacks, FORMULATIONS[level](), rates=hqp.RateLimits(velocity=5.0, acceleration=200.0, torque=400.0)
    )
    goal = hand.at(robot.state().position("tool0") + [0.1, -0.1, 0.1])
    for name, over in (
        ("rest", 0.2),
        ("", 0.2),
        ("swapped", 0.1),
        ("rest", 0.2),
        ("swapped", 0.1),
        ("", 0.0),
        ("rest", 0.1),
    ):
        loop.change(name, over)
        for k in range(12):
            loop.step(*([goal] if k % 10 < 7 else []))
    assert loop.deepest == 3
    assert [loop.step(goal) for _ in range(400)][-1].transition == 1.0


@pytest.mark.parametrize("level", ["velocity", "acceleration", pytest.param("torque", marks=pytest.mark.long)])
def test_a_foot_is_released_and_taken_up(level: str) -> None:
    robot, stacks, (com, hand) = humanoid(level)
    loop = Pair(robot, stacks, FORMULATIONS[level]())
    state = robot.state()
    left = state.position(robot.landmarks["soles"][0])
    middle = np.array(state.com())
    over, palm = np.array([*left[:2], 0.97 * middle[2]]), hand.at(state.position(hand.frame) + [0.03, 0.0, 0.03])

    def go(ticks: int, first: float, last: float) -> hqp.Tick:
        shares = [smooth(first + (last - first) * k / max(ticks - 1, 1)) for k in range(ticks)]
        return [loop.step(com.at((1.0 - h) * middle + h * over), palm) for h in shares][-1]

    loop.change("free", 0.05)
    go(30, 0.0, 0.0)
    loop.change("", 0.05)
    go(300, 0.0, 1.0)
    loop.change("one foot", 0.1)
    seen = [go(1, 1.0, 1.0).transition for _ in range(120)]
    assert seen[0] < 1.0
    assert seen[-1] == 1.0
    loop.change("", 0.1)
    assert go(150, 1.0, 1.0).transition == 1.0


@pytest.mark.long
@pytest.mark.parametrize(("load", "quick"), [(None, False), (5.0, True)])
def test_a_foot_that_was_measured_to_bear_little_is_let_go(load: float | None, quick: bool) -> None:
    robot, stacks, (com, _) = humanoid("torque")
    soles = [t.CenterOfPressure(contact=f, rectangle=(-0.03, 0.05, -0.01, 0.01)) for f in robot.landmarks["soles"]]
    whole = Stack(*stacks[""].levels, subject_to=[*stacks[""].subject_to, *soles])
    loop = Pair(robot, {"": whole, "one foot": lifted(whole, robot)}, FORMULATIONS["torque"]())
    foot, goal = whole.find(robot.landmarks["soles"][1], t.FixedContact), com.at(robot.state().com())
    for _ in range(20):
        loop.step(goal)
    loop.change("one foot", 0.02)
    tick = loop.step(goal, *([foot.at()] if load is None else [foot.at().loaded(load)]))
    assert (f"{foot.name} bears nothing" in {account.element for account in tick.explain().accounts}) is not quick
    told = [note.detail for _ in range(3 if quick else 30) for note in loop.step(goal).notes]
    assert any("cannot be released: it still carries" in detail for detail in told) is not quick


def test_names_and_durations_that_are_none_are_refused(tmp_path: Path) -> None:
    robot, stacks, _ = arm()
    run = hqp.Controller(stacks[""], deadline=np.inf).session(robot, DT)
    run.export(tmp_path / "plan.hqp", stacks={"rest": stacks["rest"]})
    file = hqp.load(tmp_path / "plan.hqp")
    assert file.stacks == ("", "rest")
    assert file.names == ("hand", "turn", "posture")
    with pytest.raises(DeclarationError, match="no stack 'elsewhere'; allowed: rest"):
        file.change("elsewhere")
    for over in (-1.0, np.nan, np.inf):
        with pytest.raises(DeclarationError, match="allowed 0 or above"):
            file.change("rest", over)
    file.change("rest")
    with pytest.raises(DeclarationError, match="the stack at work does not have it"):
        file.step(robot.home, targets={"hand": [0.4, 0.1, 0.5]})
    with pytest.raises(DeclarationError, match="bad name"):
        run.export(tmp_path / "plan.hqp", stacks={"": stacks["rest"]})


def test_reset_returns_to_the_first_stack() -> None:
    robot, stacks, _ = arm()
    run = hqp.Controller(stacks[""], deadline=np.inf).session(robot, DT)
    file = LoadedSession(text(run, stacks={"rest": stacks["rest"]}))
    goal = {"hand": robot.state().position("tool0") + 0.1}

    def loop() -> list[Any]:
        sent = []
        for k in range(60):
            if k in (10, 30):
                file.change("rest" if k == 10 else "", 0.05)
            sent.append(file.step(robot.home, targets=goal if k < 10 or k > 32 else {}).x)
        return sent

    first = loop()
    file.change("rest", 1.0)
    file.step(robot.home)
    file.reset()
    np.testing.assert_array_equal(first, loop())


def resident() -> int:
    """Memory of this process [pages]."""
    return int(Path("/proc/self/statm").read_text("ascii").split()[1])


@pytest.mark.long
@pytest.mark.skipif(not Path("/proc/self/statm").exists(), reason="memory is read from /proc")
def test_changes_leave_no_memory_behind() -> None:
    robot, stacks, _ = arm()
    file = Pair(robot, stacks, FORMULATIONS["velocity"]()).file
    q, v, goal = robot.home, np.zeros(robot.nv), {"hand": robot.state().position("tool0")}
    used = []
    for _ in range(3):
        for k in range(400):
            file.change(("swapped", "")[k % 2], 3 * DT)
            for _ in range(5):
                assert file.step(q, v, goal).status.usable
        used.append(resident())
    assert used[2] - used[1] < 20, used


@pytest.mark.parametrize("over", [0.0, 0.02])
@pytest.mark.parametrize("rests", ["stop", "bad states"])
def test_changes_at_rest_pass_on_no_hold_value_that_an_element_lacks(rests: str, over: float) -> None:
    """A hand that has no goal yet stays where it is; it does not return to home."""
    robot = hqp.robots.load("ur5")
    hand, turn, posture = (kind(law=hqp.P(5.0), **frame) for kind, frame in HELD)
    free = Stack(Level(hand), Level(posture), subject_to=[t.JointLimits()])
    turned = Stack(Level(turn), Level(posture), subject_to=[t.JointLimits()])
    pair = Pair(robot, {"": free, "turned": turned}, hqp.Velocity())
    goal = hand.at(robot.state(robot.home).position("tool0") + [0.2, 0.2, -0.1])
    for _ in range(100):
        pair.step(goal)
    if rests == "stop":
        pair.run.stop(), pair.file.stop(), pair.batch.stop([0, 2])
    for _ in range(3):
        pair.change("turned", over)
        for _ in range(20):
            pair.step(bad=rests == "bad states")
    pair.run.resume(), pair.file.resume(), pair.batch.resume([0, 2])
    before = robot.state(pair.q).rotation("tool0").copy()
    for _ in range(60):
        pair.step()
    moved = np.abs(robot.state(pair.q).rotation("tool0") - before).max()
    assert moved < 0.1 * np.abs(before - robot.state(robot.home).rotation("tool0")).max()


@pytest.mark.parametrize("level", FORMULATIONS)
@pytest.mark.parametrize(("over", "when"), [(0.0, 2), (0.02, 2), (0.3, 2), (0.3, -5)])
def test_a_robot_comes_to_rest_as_without_a_change(level: str, over: float, when: int) -> None:
    """States are bad from tick 60 on; the stack changes that many ticks later, or before."""
    robot = hqp.robots.load("ur5")
    hand, turn, posture = (kind(**frame) for kind, frame in HELD)
    stacks = {
        name: Stack(Level(task), Level(posture), subject_to=[t.JointLimits()])
        for name, task in (("", hand), ("turned", turn))
    }
    goal = hand.at(robot.state(robot.home).position("tool0") + [0.2, 0.2, -0.1])
    commands = []
    for changes in (True, False):
        pair = Pair(robot, stacks, FORMULATIONS[level]())
        commands.append([])
        for i in range(140):
            if changes and i == 60 + when:
                pair.change("turned", over)
            commands[-1].append(pair.step(goal, bad=i >= 60).command.copy())
    changed, alone = (np.array(one[60:]) for one in commands)
    assert np.abs(alone).max() > 0.1
    np.testing.assert_allclose(changed, alone, atol=0.02 * np.abs(alone).max() if when < 0 else 1e-12)
