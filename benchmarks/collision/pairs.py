"""Automatic collision pairs of six robots: count, excluded configurations, and time in a tick."""

from __future__ import annotations

import argparse
import math
import warnings
from collections import defaultdict
from pathlib import Path
from time import perf_counter
from typing import Any

import numpy as np

import hqp
from benchmarks.reports import report
from hqp.tasks import CollisionAvoidance, JointLimits, Posture, distances
from hqp.tasks.collision_scene import Scene, scene

ROBOTS = ("g1", "talos", "icub", "go2", "ur5", "panda")
MARK, END = "<!-- tables: python -m benchmarks pairs --page docs/results/collision.md -->", "<!-- end of pairs -->"
"""Marks in the page around the generated table."""
DT = 0.002
HEADER = (
    "robot",
    "capsules",
    "pairs",
    "violated at home",
    "first session [s]",
    "in a tick, p10 [us]",
    "most needless: share of the configurations apart that a pair excludes",
    "links that touch without a row, share of the configurations",
)


def add_arguments(parser: argparse.ArgumentParser) -> None:
    """Options of this part."""
    parser.add_argument("--page", type=Path, metavar="FILE", help="write the table there, in a page of the docs, too")


def run(arguments: argparse.Namespace) -> int:
    """Measure, show, write; returns 1 if a row is violated at home."""
    with warnings.catch_warnings():
        warnings.simplefilter("ignore")
        rows = [_row(name, 200 if arguments.quick else 1000) for name in ROBOTS]
    text = report.table(HEADER, rows)
    report.section(arguments.output, "pairs", text)
    if arguments.page is not None:
        report.into_page(arguments.page, MARK, text, END)
    return int(any(row[3] != "0" for row in rows))


def _row(name: str, count: int) -> tuple[str, ...]:
    robot, every = hqp.robots.load(name), CollisionAvoidance()
    start = perf_counter()
    own = scene(every, robot)
    first = perf_counter() - start
    near = every.near(robot.state(robot.home))
    bad = sum(n.distance < n.clearance for n in near if n is not None)
    needless, missing = _judged(robot, own, count)
    without, beside = _time(robot, ()), _time(robot, (every,))
    worst = max(needless.items(), key=lambda item: item[1], default=("", 0.0))
    told = ", ".join(f"{pair} {share:.1%}" for pair, share in sorted(missing.items(), key=lambda i: -i[1])[:6])
    return (
        name, str(own.links), str(len(own.pairs)), str(bad), f"{first:.1f}", f"{beside - without:.0f}",
        f"{worst[0]} {worst[1]:.0%}", told or "none",
    )  # fmt: skip


def _judged(robot: Any, own: Scene, count: int) -> tuple[dict[str, float], dict[str, float]]:
    """Share of the configurations with shapes apart that each pair excludes, and of those in which links touch whose
    capsules have no row, by coal on the shapes of the file."""
    rng, places = np.random.default_rng(11), defaultdict(list)  # another draw than the library's
    low = np.where(np.isfinite(robot.lower), robot.lower, -math.pi)
    high = np.where(np.isfinite(robot.upper), robot.upper, math.pi)
    bodies = sorted({c.body for c in robot.capsules})
    for q in (robot.home, *(robot.configuration(rng.uniform(low, high)) for _ in range(count))):
        robot.state(q).kinematics()
        for b in bodies:
            position, rotation = robot.bodies[b][5]
            places[b].append((position.copy(), rotation.copy()))
    ends = []
    for c in robot.capsules:
        p, R = (np.array(part) for part in zip(*places[c.body], strict=True))
        ends.append((p + R @ np.array(c.a), p + R @ np.array(c.b)))
    parents, shapes, capsules = [body[0] for body in robot.bodies], robot.contacts(), robot.capsules
    rows = {pair: float(c) for pair, c in zip(own.pairs, own.clearance, strict=True)}
    touching: dict[tuple[int, int], dict[int, bool]] = defaultdict(dict)
    guarded = {frozenset((own.body(i), own.body(j))) for i, j in rows}
    needless, missing = {}, {}
    for i in range(len(capsules)):
        for j in range(i + 1, len(capsules)):
            a, b = capsules[i].body, capsules[j].body
            if a == b or parents[a] == b or parents[b] == a:
                continue
            gap = distances.of_axes(*ends[i], *ends[j]) - capsules[i].radius - capsules[j].radius
            seen, near = touching[a, b], np.flatnonzero(gap < rows.get((i, j), 0.0))
            for n in {0, *near.tolist()} - seen.keys():
                seen[n] = shapes.touch(a, b, places[a][n], places[b][n])
            if (i, j) in rows:
                hits = sum(seen[n] for n in near.tolist())
                needless[f"{own.name(i)} - {own.name(j)}"] = (len(near) - hits) / (count + 1 - hits)
            elif frozenset((a, b)) not in guarded and not seen[0] and any(seen.values()):
                names = (own.name(k).rpartition("/")[0] or own.name(k) for k in (i, j))
                missing[" - ".join(names)] = sum(seen.values()) / (count + 1)
    return needless, missing


def _time(robot: Any, avoid: tuple[CollisionAvoidance, ...]) -> float:
    """Tenth percentile of a tick that follows a slow motion of the posture [us]."""
    own = robot.copy()
    posture = Posture()
    stack = hqp.Stack(hqp.Level(posture), subject_to=[JointLimits(), *avoid])
    session = hqp.Controller(stack, deadline=math.inf).session(own, DT)
    q, v, times = own.home, np.zeros(own.nv), []
    angles = own.state(own.home).angles[own.actuated] if posture.rows(own) == len(own.actuated) else None
    for k in range(2000):
        state = own.state(q, v)
        goal = () if angles is None else (posture.at(angles + 0.05 * math.sin(2.0 * DT * k)),)
        start = perf_counter()
        tick = session.step(state, *goal)
        times.append(perf_counter() - start)
        q, v = tick.advance()
    return float(1e6 * np.percentile(times, 10))
