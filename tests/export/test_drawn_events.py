"""Drawn events in any order: a session, its file and its batch send the same commands.

Events are bad states, stops, resumptions, changes of stack in the midst of others, and goals within and out of reach.
"""

from __future__ import annotations

from typing import Any

import numpy as np
import pytest

import hqp
import hqp.tasks as t
from hqp import Level, Stack
from hqp.export.loaded import LoadedSession
from hqp.loop.file import text
from hqp.solvers.lexicographic import kernel
from tests.scenes.stacks import FORMULATIONS

pytestmark = pytest.mark.skipif(not kernel(), reason="no native kernel here")

DT = 0.002
ROUNDING = 1e-9
"""Share of the largest command: a stack that returns continues from other sets of active rows."""
SHARE = 1e-6
"""Share of a transition: answers that are nearly the same choose it."""


class Loop:
    """A session, a file and two worlds of a batch on the same states, references and events."""

    def __init__(self, robot: Any, stacks: dict[str, Stack], formulation: Any) -> None:
        self.robot, self.stacks = robot, stacks
        self.run = hqp.Controller(stacks[""], formulation, deadline=np.inf).session(robot, DT)
        others = {name: stack for name, stack in stacks.items() if name}
        self.file = LoadedSession(text(self.run, stacks=others))
        self.batch = hqp.Batch(self.run.controller, robot, 2, DT, threads=1, stacks=others)
        self.q, self.v = robot.home.copy(), np.zeros(robot.nv)
        self.ticks = self.deepest = 0

    def change(self, name: str, over: float) -> None:
        self.run.change(self.stacks[name], over)
        self.file.change(name, over)
        self.batch.change(name, over)

    def stop(self) -> None:
        self.run.stop("drawn")
        self.file.stop("drawn")
        self.batch.stop([0, 1], "drawn")

    def resume(self) -> None:
        self.run.resume()
        self.file.resume()
        self.batch.resume([0, 1])

    def step(self, targets: dict[str, np.ndarray], *, bad: bool) -> None:
        q = np.full_like(self.q, np.nan) if bad else self.q
        known = {name: value for name, value in targets.items() if name in self.run}
        tick = self.run.step(
            self.robot.state(q, self.v), *[hqp.Reference(name, value) for name, value in known.items()]
        )
        found = self.file.step(q, self.v, known)
        many = self.batch.step(
            np.tile(q, (2, 1)), np.tile(self.v, (2, 1)), {name: np.tile(value, (2, 1)) for name, value in known.items()}
        )
        where, size = f"tick {self.ticks}", ROUNDING * max(1.0, float(np.abs(tick.x).max()))
        np.testing.assert_allclose(found.x, tick.x, rtol=0.0, atol=size, err_msg=f"file, {where}")
        np.testing.assert_allclose(many.x, np.tile(tick.x, (2, 1)), rtol=0.0, atol=size, err_msg=f"batch, {where}")
        assert (found.status, found.held) == (tick.status, tick.held), where
        assert abs(found.transition - tick.transition) < SHARE, where
        assert set(many.statuses()) == {tick.status}, where
        transition = self.run.line.transition
        self.deepest = max(self.deepest, 0 if transition is None else transition.depth)
        self.ticks += 1
        if not bad:
            self.q, self.v = tick.advance()
        if np.abs(self.v).max() > 30.0:  # an arm at torque level with a goal far out of reach
            self.q, self.v = self.robot.home.copy(), np.zeros(self.robot.nv)


def scene(rng: np.random.Generator, level: str, name: str) -> tuple[Loop, str, np.ndarray]:
    robot = hqp.robots.load(name)
    soles = robot.landmarks.get("soles") or ()
    palm = (robot.landmarks.get("palms") or (robot.frame_names[-1],))[0]
    feet = [t.FixedContact(frame=sole, name=sole) for sole in soles]
    cones = [t.FrictionCone(contact=foot.name, mu=0.7) for foot in feet] if level == "torque" else []
    com = t.Com(axes="xy" if soles else "xyz", name="com")
    tasks = [t.Position(frame=palm, name="hand"), t.Orientation(frame=palm, name="turn"), com]
    posture = Level(t.Posture(name="posture"))

    def stack() -> Stack:
        chosen = rng.permutation(3)[: rng.integers(1, 4)]
        return Stack(*[Level(tasks[k]) for k in chosen], posture, subject_to=[*feet, *cones, t.JointLimits()])

    loop = Loop(robot, {"": stack(), "a": stack(), "b": stack()}, FORMULATIONS[level]())
    return loop, "hand", robot.state().position(palm)


def drawn(seed: int, level: str, name: str, ticks: int) -> Loop:
    rng = np.random.default_rng(seed)
    loop, hand, home = scene(rng, level, name)
    targets: dict[str, np.ndarray] = {}
    for _ in range(ticks):
        event, bad = rng.random(), False
        if event < 0.07:
            loop.change(str(rng.choice(["", "a", "b"])), float(rng.choice([0.0, 0.02, 0.1, 0.2])))
        elif event < 0.10:
            loop.stop()
        elif event < 0.16:
            loop.resume()
        elif event < 0.20:
            targets = {hand: home + rng.normal(size=3) * float(rng.choice([0.05, 0.3, 2.0]))}
        elif event < 0.21:
            targets = {hand: np.full(3, np.nan)}
        elif event < 0.23:
            targets = {}
        elif event < 0.26:
            bad = True
        loop.step(targets, bad=bad)
    return loop


@pytest.mark.parametrize("seed", range(4))
@pytest.mark.parametrize("level", FORMULATIONS)
def test_drawn_events(level: str, seed: int) -> None:
    drawn(seed, level, "ur5" if seed % 2 else "panda", 120)


def test_an_inner_blend_that_moves_a_motor_by_its_cap() -> None:
    """Rounding decides whether its command lies within the cap of the outer blend: both ways give one command."""
    robot = hqp.robots.load("panda")
    hand, com, posture = t.Position(frame=robot.frame_names[-1], name="hand"), t.Com(name="com"), t.Posture()
    first = Stack(Level(com), Level(hand), Level(posture), subject_to=[t.JointLimits()])
    loop = Loop(robot, {"": first, "b": Stack(Level(hand), Level(posture), subject_to=[t.JointLimits()])}, hqp.Torque())
    goal = {"hand": np.array([0.30805203, -0.02655129, 0.51410895])}

    def go(ticks: int, targets: dict[str, np.ndarray]) -> None:
        for _ in range(ticks):
            loop.step(targets, bad=False)

    loop.change("", 0.02)
    go(5, {})
    loop.stop()
    go(37, {})
    loop.change("b", 0.02)
    go(7, {})
    go(4, goal)
    loop.resume()
    go(20, goal)


@pytest.mark.slow
@pytest.mark.parametrize("name", ["ur5", "panda", "g1"])
@pytest.mark.parametrize("level", FORMULATIONS)
def test_many_drawn_events(level: str, name: str) -> None:
    deepest = max(drawn(seed, level, name, 150).deepest for seed in range(100, 120))
    assert deepest == 3
