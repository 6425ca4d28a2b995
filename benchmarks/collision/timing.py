"""Time that collision avoidance adds to a tick: 0, 50, 200 and all pairs of Talos, turn by turn in one run."""

from __future__ import annotations

import math
from dataclasses import dataclass
from time import perf_counter

import numpy as np

import hqp
from hqp import Level, Stack
from hqp.arrays import Vec
from hqp.declare.element import Element
from hqp.tasks import CollisionAvoidance, Com, FixedContact, JointLimits, Position, Posture
from hqp.tasks.collision_scene import scene
from tests.scenes.calm.scenes import DT

PAIRS = (0, 50, 200, 10_000)
"""Requested numbers of pairs; the last requests all."""


@dataclass(frozen=True)
class Added:
    """Added time of a number of pairs.

    pairs, rows: numbers of the element.  near: most pairs near at once.  p10, p50: percentiles of a tick [us].
    added: median of a tick minus that without collision avoidance [us].
    """

    pairs: int
    rows: int
    near: int
    p10: float
    p50: float
    added_p10: float
    added_p50: float


def measure(ticks: int = 2000, name: str = "talos") -> list[Added]:
    """A hand that moves 3 cm to and fro within reach: CoM > hand > posture, s.t. feet, limits, collisions."""
    robot = hqp.robots.load(name)
    every = scene(CollisionAvoidance(), robot)
    names = [(every.name(i), every.name(j)) for i, j in every.pairs]
    rng, runs = np.random.default_rng(0), []
    hand = Position(frame=robot.landmarks["palms"][0])
    start = robot.state(robot.home).position(hand.frame)
    for count in PAIRS:
        avoid = _some(names, count, rng)
        hard: list[Element] = [*(FixedContact(frame=f) for f in robot.landmarks["soles"]), JointLimits()]
        stack = Stack(Level(Com(axes="xy")), Level(hand), Level(Posture()), subject_to=[*hard, *avoid])
        own = robot.copy()
        runs.append((own, hqp.Controller(stack, deadline=math.inf).session(own, DT), avoid))
    times, near = np.zeros((len(runs), ticks)), np.zeros(len(runs), dtype=int)
    states = [(own.home, np.zeros(own.nv)) for own, *_ in runs]
    for k in range(ticks):
        w = 2.0 * DT * k
        goal = hand.at(start + 0.03 * np.array([1.0 - math.cos(w), math.sin(w) ** 2, 1.0 - math.cos(w)]))
        for i, (own, session, avoid) in enumerate(runs):
            state = own.state(*states[i])
            begin = perf_counter()
            tick = session.step(state, goal)
            times[i, k] = 1e6 * (perf_counter() - begin)
            states[i] = tick.advance()
            for element in avoid:
                near[i] = max(near[i], int((scene(element, own).slots >= 0).sum()))
    return [_added(run, times[i], times[0], int(near[i])) for i, run in enumerate(runs)]


def _some(names: list[tuple[str, str]], count: int, rng: np.random.Generator) -> list[CollisionAvoidance]:
    if count == 0:
        return []
    if count >= len(names):
        return [CollisionAvoidance()]
    picked = sorted(rng.permutation(len(names))[:count].tolist())
    return [CollisionAvoidance(pairs=tuple(names[i] for i in picked))]


def _added(
    run: tuple[hqp.robots.Robot, hqp.Session, list[CollisionAvoidance]], own: Vec, bare: Vec, near: int
) -> Added:
    robot, _, avoid = run
    pairs, rows = (len(scene(avoid[0], robot).pairs), avoid[0].rows(robot)) if avoid else (0, 0)
    p10, p50 = np.percentile(own, (10, 50))
    low, middle = np.percentile(bare, (10, 50))
    return Added(pairs, rows, near, float(p10), float(p50), float(p10 - low), float(p50 - middle))
