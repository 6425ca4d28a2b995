"""Drawn events in any order: a session, its file and its batch send the same commands.

Events are bad states, stops, resumptions, changes of stack in the midst of others, and goals within and out of reach.
"""

from __future__ import annotations

import numpy as np
import pytest

import hqp
import hqp.tasks as t
from hqp import Level, Stack
from hqp.solvers.lexicographic import kernel
from tests.scenes.one_loop import Loop
from tests.scenes.stacks import FORMULATIONS

pytestmark = pytest.mark.skipif(not kernel(), reason="no native kernel here")

ROUNDING = 1e-9
"""Share of the largest command: a stack that returns continues from other sets of active rows."""
SHARE = 1e-6
"""Share of a transition: answers that are nearly the same choose it."""


class Drawn(Loop):
    """All three send the same commands, but for rounding."""

    def step(self, targets: dict[str, np.ndarray], *, bad: bool) -> None:
        tick, found, worlds = self.answers(*[hqp.Reference(*item) for item in targets.items()], bad=bad)
        assert worlds is not None
        where, size = f"tick {self.ticks}", ROUNDING * max(1.0, float(np.abs(tick.x).max()))
        np.testing.assert_allclose(found.x, tick.x, rtol=0.0, atol=size, err_msg=f"file, {where}")
        assert (found.status, found.held) == (tick.status, tick.held), where
        assert abs(found.transition - tick.transition) < SHARE, where
        for k in self.changed:
            np.testing.assert_allclose(worlds.x[k], tick.x, rtol=0.0, atol=size, err_msg=f"world {k}, {where}")
            assert worlds.statuses()[k] is tick.status, where
        self.advance(tick, bad=bad)
        if np.abs(self.v).max() > 30.0:  # an arm at torque level with a goal far out of reach
            self.q, self.v = self.robot.home.copy(), np.zeros(self.robot.nv)


def scene(rng: np.random.Generator, level: str, name: str) -> tuple[Drawn, str, np.ndarray]:
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

    loop = Drawn(robot, {"": stack(), "a": stack(), "b": stack()}, FORMULATIONS[level]())
    return loop, "hand", robot.state().position(palm)


def drawn(seed: int, level: str, name: str, ticks: int) -> Drawn:
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
    loop = Drawn(robot, {"": first, "b": first.without("com")}, hqp.Torque())
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
