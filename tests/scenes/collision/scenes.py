"""Scenes with a blocked hand: by the torso, a table, the other hand; and one that starts inside."""

from __future__ import annotations

import math
from collections.abc import Callable
from dataclasses import dataclass, replace
from functools import partial

import numpy as np

from hqp import Level, Stack, shapes
from hqp.arrays import Vec
from hqp.declare.reference import Reference
from hqp.tasks import CollisionAvoidance, Position
from tests.scenes.calm.loop import Run, figures
from tests.scenes.calm.robots import Subject, subject
from tests.scenes.calm.scenes import DT, FORMULATIONS, Scene, default_stack, law
from tests.scenes.calm.variants import PRICED
from tests.scenes.collision.original import Original

TORSO = {"talos": "torso_2_link", "g1": "torso_link", "cbi": "chest", "panda": "panda_link1"}
"""Links that block the hand."""
WALK, STAY = 1.5, 1.5
"""Times of the goal's motion and of its rest [s]."""
DEPTH = 0.15
"""Depth of the goal below the table's top [m]."""
THICK = 0.3
"""Thickness of the table: a block that no hand passes [m]."""
REACH = 0.02
"""Distance beyond the clearance up to which a run measures its pairs [m]."""
INSIDE = 0.08
"""Radius of the ball around a hand's start [m]."""


@dataclass(frozen=True)
class Blocked:
    """A scene, its collision avoidance, and the moving bodies of its world."""

    scene: Scene
    avoid: CollisionAvoidance
    world: tuple[Reference, ...] = ()


@dataclass(frozen=True, eq=False)
class Outcome:
    """A run, and by tick the least distance minus clearance of any pair, with the name of the pair [m].

    surface: least value for the file's own shapes by coal, over the inspected ticks [m].
    """

    run: Run
    margin: Vec
    names: tuple[str, ...]
    surface: float = math.inf

    def figures(self) -> dict[str, float | str]:
        """Figures of a calm loop, with the least margin [m] and the fastest exit from a collision [m/s]."""
        inside = np.flatnonzero(self.margin[:-1] < -1e-4)
        out = (self.margin[inside + 1] - self.margin[inside]) / DT
        return {
            **figures(self.run),
            "margin": float(self.margin.min()),
            "margin_end": float(self.margin[-1]),
            "surface": self.surface,
            "way_out": float(np.max(out, initial=0.0)),
            "nearest": self.names[int(self.margin.argmin())],
        }


def scenes(name: str, formulation: str) -> dict[str, Callable[[], Blocked]]:
    """Makers of the scenes of one robot by name."""
    who = subject(name)
    home = who.robot.state(who.robot.home)
    start = home.position(who.hands[0])
    found: dict[str, Callable[[], Blocked]] = {}
    if name in TORSO:
        goal = home.position(TORSO[name])
        found["torso"] = partial(_blocked, "torso", who, formulation, start, goal)
    down, away = (0.2, 0.1) if name == "talos" else (0.12, 0.0)  # its hand hangs down, its knees are ahead
    top = start[2] - down
    table = shapes.box("table", (0.4, 1.2, THICK), (*(start[:2] + (0.3 + away) * who.ahead[:2]), top - 0.5 * THICK))
    below = start + [0.0, 0.0, top - start[2] - DEPTH] + (0.25 + away) * who.ahead
    found["table"] = partial(_blocked, "table", who, formulation, start, below, (table,))
    if len(who.hands) > 1:
        goal = home.position(who.hands[1])
        found["other hand"] = partial(_blocked, "other hand", who, formulation, start, goal, holds=True)
    ball = shapes.sphere("ball", INSIDE, tuple(start.tolist()))
    found["inside"] = partial(_blocked, "inside", who, formulation, start, start, (ball,))
    return found


def _blocked(
    name: str,
    who: Subject,
    formulation: str,
    start: Vec,
    goal: Vec,
    world: tuple[shapes.Shape, ...] = (),
    holds: bool = False,
) -> Blocked:
    avoid = CollisionAvoidance(world=world)
    hand = Position(frame=who.hands[0], law=law(formulation, 5.0), name="hand")
    other = Level(Position(frame=who.hands[-1], law=hand.law, name="other hand"), name="other hand")
    stack = default_stack(who, formulation, {}, *((other,) if holds else ()), Level(hand, name="hand"))
    stack = Stack(*stack.levels, subject_to=[*stack.subject_to, avoid])
    above = (*(c.name for c in who.contacts), *(("com",) if who.contacts else ()), *(("other hand",) if holds else ()))

    def at(t: float) -> tuple[Reference, ...]:
        return (hand.at(start + min(1.0, t / WALK) * (goal - start)),)

    return Blocked(Scene(name, who, formulation, stack, at, above=above), avoid)


def run(
    blocked: Blocked, ticks: int = round((WALK + STAY) / DT), every: int = 1, coal_every: int | None = None
) -> Outcome:
    """Execute the commands exactly for ``ticks`` periods; compute distances in each ``every``-th.

    coal_every: compute distances of the file's own shapes by coal in each ``coal_every``-th, a multiple of ``every``.
    """
    scene, avoid = blocked.scene, blocked.avoid
    robot = scene.subject.robot
    twin = robot.copy()  # it has its own slots
    judge = replace(avoid, influence=avoid.clearance + REACH)
    session = PRICED.of(scene.stack, FORMULATIONS[scene.formulation]).session(robot, DT)
    data, margin, names = Run.empty(scene, ticks), np.full(ticks, math.inf), [""] * ticks
    q, v = robot.home.copy(), np.zeros(robot.nv)
    original, surface = None if coal_every is None else Original(avoid, twin), math.inf
    start = robot.state(q)
    feet = {foot: start.position(foot) for foot in scene.subject.feet}
    com, joints = start.com()[:2], robot.actuated
    for i in range(ticks):
        if i % every == 0:
            near = [n for n in judge.near(twin.state(q)) if n is not None]
            if original is not None and i % coal_every == 0:  # type: ignore[operator]
                surface = min(surface, original.margin(near))
            least = min(near, key=lambda n: n.distance - n.clearance, default=None)
            name = "" if least is None else _name(judge, twin, least.pair)
            reach = math.inf if least is None else least.distance - least.clearance
        margin[i], names[i] = reach, name
        goals = scene.targets(i * DT)
        state = robot.state(q, v)
        data.error[i] = np.linalg.norm(state.position(scene.subject.hands[0]) - goals[0].value)
        data.contact[i] = max((np.linalg.norm(state.position(f) - p) for f, p in feet.items()), default=0.0)
        data.com[i] = np.linalg.norm(state.com()[:2] - com) if feet else 0.0
        tick = session.step(state, *goals)
        data.commands[i] = tick.command
        data.statuses[tick.status.name] = data.statuses.get(tick.status.name, 0) + 1
        places, solution = session.program.places, tick.solution
        assert solution is not None
        rows = [solution.residuals[places[n].level][places[n].part] for n in scene.above if n in places]
        data.above[i] = max((float(np.abs(w).max(initial=0.0)) for w in rows), default=0.0)
        q, next_v = tick.advance()
        data.accelerations[i] = (next_v - v)[joints] / DT
        v = next_v
    return Outcome(data, margin, tuple(names), surface)


def _name(avoid: CollisionAvoidance, robot: object, pair: int) -> str:
    from hqp.tasks.collision_scene import scene

    own = scene(avoid, robot)  # type: ignore[arg-type]
    return " - ".join(own.name(k) for k in own.pair(pair))
