"""The filter behind a policy: time of a tick on G1, and hostile commands on five robots with limits judged outside."""

from __future__ import annotations

import argparse
import math
import time
import warnings
from collections.abc import Iterator
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any

import coal
import numpy as np
import pinocchio as pin

import hqp
from benchmarks.reports import report
from hqp.policies import PolicyFilters
from hqp.robots import Robot
from hqp.tasks import CollisionAvoidance
from hqp.tasks.collision_scene import scene
from tests.scenes.hostile import DT, KINDS, Plant, hostile

ROBOTS = ("g1", "anymal", "ur5", "xarm7", "kinova")
MARK, END = "<!-- tables: python -m benchmarks filter --page docs/policy-filter.md -->", "<!-- end -->"
"""Marks in the page around the generated tables."""
CLEARANCE = 0.01
"""Clearance of the pairs [m]."""
BEYOND = 0.05
"""Largest distance that is measured [m]."""
JUDGED = 60
"""Hostile ticks between two judgements of the distances."""


def add_arguments(parser: argparse.ArgumentParser) -> None:
    """Options of this part."""
    parser.add_argument("--ticks", type=int, default=100_000, help="hostile ticks of each robot, by default 100 000")
    parser.add_argument("--page", type=Path, metavar="FILE", help="write the tables there, in a page of the docs, too")


def run(arguments: argparse.Namespace) -> int:
    """Measure, show, write; returns 1 if a limit of a joint is passed."""
    with warnings.catch_warnings():
        warnings.simplefilter("ignore")
        times = report.table(
            ("commands", "collision pairs", "tick p10 [us]", "p50", "of it the stack, p50"),
            list(_times(500 if arguments.quick else 3000)),
        )
        ticks = 3000 if arguments.quick else arguments.ticks
        found = [_hostile(name, kind, ticks // len(KINDS)) for name in ROBOTS for kind in KINDS]
    edge = report.table(
        ("commands", "joints at a limit", "a world [us]", "of the speed within"),
        list(_edge(5 if arguments.quick else 30)),
    )
    text = "\n".join((times, edge, report.table(HEADER, [one.row() for one in found])))
    report.section(arguments.output, "filter", text)
    if arguments.page is not None:
        report.into_page(arguments.page, MARK, text, END)
    return int(any(one.over > 1e-6 or one.fast > 1.0 + 1e-6 or one.torque > 1.0 + 1e-6 for one in found))


def _declared(kind: str, collision: CollisionAvoidance | None) -> hqp.PolicyFilter:
    gains: dict[str, Any] = {"kp": 60.0, "kd": 2.0} if kind == "positions" else {}
    return hqp.PolicyFilter(command=kind, collision=collision, **gains)  # type: ignore[arg-type]


def _times(ticks: int) -> Iterator[tuple[str, ...]]:
    """Small motions of all joints of G1, commands that pass."""
    robot = hqp.robots.load("g1")
    every, rng = scene(CollisionAvoidance(), robot), np.random.default_rng(0)
    chosen = sorted(rng.permutation(len(every.pairs))[:40].tolist())
    names = tuple((every.name(i), every.name(j)) for i, j in (every.pairs[k] for k in chosen))
    phases = rng.uniform(0.0, 6.0, robot.actuated.size)
    for kind in KINDS:
        for count, pairs in (("none", None), ("40", CollisionAvoidance(pairs=names)), ("all", CollisionAvoidance())):
            session = _declared(kind, pairs).session(robot, DT, deadline=math.inf)
            inner, stack, whole = session.session.step, list[float](), list[float]()

            def step(*given: Any, inner: Any = inner, stack: list[float] = stack, **more: Any) -> Any:
                start = time.perf_counter()
                tick = inner(*given, **more)
                stack.append(time.perf_counter() - start)
                return tick

            session.session.step = step  # type: ignore[method-assign]
            plant = Plant(robot, kind, session)
            middle = robot.state(robot.home).angles[robot.actuated] if kind == "positions" else 0.0
            for k in range(ticks):
                command = middle + 0.05 * np.sin(2.0 * math.pi * k * DT + phases)
                start = time.perf_counter()
                tick = session.tick(plant.q, plant.v, command)
                whole.append(time.perf_counter() - start)
                plant.move(tick.command)
            low, half = 1e6 * np.percentile(whole, (10, 50))
            known = str(len(every.pairs)) if count == "all" else count
            yield kind, known, f"{low:.0f}", f"{half:.0f}", f"{1e6 * np.percentile(stack, 50):.0f}"


def _edge(ticks: int, worlds: int = 64) -> Iterator[tuple[str, ...]]:
    """Batch on one thread: commands that push drawn joints of G1, near their limits, beyond them."""
    robot, rng = hqp.robots.load("g1"), np.random.default_rng(0)
    own = robot.actuated
    top, low = robot.upper[own] - 0.004, robot.lower[own] + 0.004
    pushes = {"positions": np.full(own.size, 0.5), "velocities": np.full(own.size, 3.0)}
    for kind in KINDS:
        filters = PolicyFilters(_declared(kind, None).session(robot, DT, deadline=math.inf), worlds, threads=1)
        push, within = pushes.get(kind, 0.5 * robot.effort_limit[own]), 0.0
        for count in (0, 3, 15, own.size):
            filters.reset()
            Q, V = np.tile(robot.home, (worlds, 1)), np.zeros((worlds, robot.nv))
            above = rng.uniform(size=(worlds, own.size)) < 0.5
            chosen = rng.uniform(size=above.shape).argsort(axis=1) < count
            Q[:, -own.size :] = np.where(chosen, np.where(above, top, low), Q[:, -own.size :])
            C = np.where(chosen, np.where(above, push, -push), 0.0)
            C = C + Q[:, -own.size :] if kind == "positions" else C
            spent = []
            for _ in range(ticks):
                start = time.process_time()
                filters.step(Q, V, C + 1e-3 * rng.normal(size=C.shape))
                spent.append(1e6 * (time.process_time() - start) / worlds)
            here = float(np.median(spent))
            within = within or here
            yield kind, str(count), f"{here:.0f}", f"{within / here:.2f}"


HEADER = (
    "robot",
    "commands",
    "ticks",
    "changed",
    "not solved",
    "over a range [rad]",
    "largest speed / limit",
    "torque / limit",
    "least distance of the shapes of a pair [mm]",
    "judged configurations with a touch",
)


@dataclass
class Hostile:
    """One run; over: beyond a range [rad, m].  fast, torque: largest share of a limit.  least: distance [m]."""

    robot: str
    kind: str
    ticks: int
    changed: int = 0
    unsolved: int = 0
    over: float = -math.inf
    fast: float = 0.0
    torque: float = 0.0
    least: float = math.inf
    touches: int = 0
    judged: int = field(default=0)

    def row(self) -> tuple[str, ...]:
        """Cells of the table."""
        return (
            self.robot, self.kind, str(self.ticks), str(self.changed), str(self.unsolved),
            f"{max(self.over, 0.0):.1e}",
            f"{self.fast:.6f}", "" if self.kind == "velocities" else f"{self.torque:.6f}",
            f"{1e3 * self.least:.1f}" if self.least < BEYOND else "above 50", f"{self.touches} of {self.judged}",
        )  # fmt: skip


def _hostile(name: str, kind: str, ticks: int) -> Hostile:
    """Run hostile commands."""
    robot, rng = hqp.robots.load(name), np.random.default_rng(0)
    collision = CollisionAvoidance(clearance=CLEARANCE)
    session = _declared(kind, collision).session(robot, DT, deadline=math.inf)
    plant, own = Plant(robot, kind, session), robot.actuated
    found = Hostile(name, kind, ticks)
    judge, servos = Shapes(robot, collision), plant.servos
    for i in range(ticks):
        angles, v = robot.state(plant.q).angles[own], plant.v[own]
        tick = session.tick(plant.q, plant.v, hostile(rng, kind, robot, i))
        found.changed += bool(tick.limited)
        found.unsolved += not tick.tick.status.solved
        if kind != "velocities":
            tau = tick.command if kind == "torques" else servos.torque(tick.command, angles, v)
            found.torque = max(found.torque, float((np.abs(tau) / servos.effort).max()))
        plant.move(tick.command)
        angles = robot.state(plant.q).angles[own]
        found.over = max(found.over, float(np.maximum(robot.lower[own] - angles, angles - robot.upper[own]).max()))
        found.fast = max(found.fast, float((np.abs(plant.v[own]) / robot.velocity_limit[own]).max()))
        if i % JUDGED == 0:
            distance = judge.least(plant.q)
            found.least, found.judged = min(found.least, distance), found.judged + 1
            found.touches += distance <= 0.0
    return found


class Shapes:
    """Least distance by coal of the file's shapes of the links of pairs with rows."""

    def __init__(self, robot: Robot, element: CollisionAvoidance) -> None:
        self._robot, self._data, own = robot, robot.model.createData(), scene(element, robot)
        self._pairs = sorted({(own.body(i), own.body(j)) for i, j in own.pairs})
        self._geometry = robot.geometry
        self._placed = pin.GeometryData(self._geometry)
        self._of: dict[int, list[int]] = {}
        for k, item in enumerate(self._geometry.geometryObjects):
            self._of.setdefault(int(item.parentJoint), []).append(k)
        self._far = [self._size(k) for k in range(len(self._geometry.geometryObjects))]

    def _size(self, k: int) -> tuple[Any, float]:
        shape = self._geometry.geometryObjects[k].geometry
        shape.computeLocalAABB()
        return np.array(shape.aabb_center), float(shape.aabb_radius)

    def least(self, q: Any) -> float:
        """Distance [m], 0 for a touch; pairs whose balls are farther than 5 cm are left out."""
        pin.updateGeometryPlacements(self._robot.model, self._data, self._geometry, self._placed, q)
        items, found = self._geometry.geometryObjects, BEYOND
        for one, two in self._pairs:
            for a in self._of.get(one, ()):
                for b in self._of.get(two, ()):
                    A, B = self._placed.oMg[a], self._placed.oMg[b]
                    (p, r), (s, t) = self._far[a], self._far[b]
                    if np.linalg.norm(A.act(p) - B.act(s)) - r - t > found:
                        continue
                    here, there = (coal.Transform3s(M.rotation, M.translation) for M in (A, B))
                    distance = coal.distance(
                        items[a].geometry, here, items[b].geometry, there, coal.DistanceRequest(), coal.DistanceResult()
                    )
                    found = min(found, max(float(distance), 0.0))
        return found
