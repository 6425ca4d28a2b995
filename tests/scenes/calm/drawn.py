"""Random loops: robot, rate, gains, tasks and targets, so that calm does not depend on selected scenes."""

from __future__ import annotations

from collections import Counter
from collections.abc import Callable, Iterator, Sequence
from itertools import chain
from typing import Any

import numpy as np

from hqp import PD, Level, P, Stack, markdown
from hqp.declare.law import Law
from hqp.tasks import Com, JointLimits, Orientation, Position, Posture, TorqueLimits
from tests.scenes.calm import goals
from tests.scenes.calm.loop import figures, run
from tests.scenes.calm.robots import ROBOTS, subject
from tests.scenes.calm.scenes import DT, Scene, Targets, both, circle, still
from tests.scenes.calm.variants import EXACT, PRICED, Variant

SECONDS = 6.0
PERIODS = (0.001, 0.002, 0.002, 0.005, 0.01)
"""[s], drawn from."""

DISTANCES = (0.1, 0.3, 0.6, 1.2)
"""Distance of a target from the hand's start [m], in any direction."""

ALIKE = 0.05
"""Allowed relative difference of the median accelerations of exact and priced levels, for paths that need them."""

Record = dict[str, Any]


def scene(seed: int, formulation: str) -> Scene:
    """Scene of a seed: base and posture have no speed limit, CoM and hands may have one."""
    rng = np.random.default_rng(seed)
    who = subject(str(rng.choice(ROBOTS)))
    dt, speed = float(rng.choice(PERIODS)), None if rng.random() < 0.5 else 0.5

    def law(gain: float, limited: bool = True) -> Law:
        most = {"max_velocity": speed} if limited and speed else {}
        return P(gain, **most) if formulation == "velocity" else PD(gain * gain, 2.0 * gain, **most)

    gain = float(rng.choice((2.0, 5.0, 10.0)))
    turned = rng.random() < 0.4
    hands = who.hands if rng.random() < 0.3 else who.hands[:1]
    together = rng.random() < 0.5
    reaching, targets = list[list[Any]](), list[Targets]()
    for k, frame in enumerate(hands):
        task = Position(frame=frame, law=law(gain), name=f"hand {k}" if k else "hand")
        own = [task, Orientation(frame=frame, law=law(gain), name=f"turn {k}")] if turned else [task]
        reaching.append(own)
        way = rng.standard_normal(3)
        place = who.robot.state(who.robot.home).position(frame)
        place = place + float(rng.choice(DISTANCES)) / float(np.linalg.norm(way)) * way
        targets.append((circle if rng.random() < 0.25 else still)(task, place))
    levels = [Level(Com(axes="xy", law=law(float(rng.choice((2.0, 5.0)))), name="com"))] if who.contacts else []
    levels += [Level(*chain(*reaching))] if together else [Level(*own) for own in reaching]
    base, posture = float(rng.choice((1.0, 2.0, 5.0, 10.0))), float(rng.choice((0.5, 1.0, 3.0, 10.0)))
    if who.base is not None and rng.random() < 0.8:
        levels.append(Level(Orientation(frame=who.base, law=law(base, False), name="base")))
    levels.append(Level(Posture(law=law(posture, False), name="posture")))
    hard = [*who.contacts, JointLimits(), *([TorqueLimits()] if formulation == "torque" else [])]
    above = (*(c.name for c in who.contacts), *(("com",) if who.contacts else ()))
    name = f"{dt * 1e3:g} ms, {len(hands)} x {'pose' if turned else 'position'}, gains {gain:g}, {base:g}, {posture:g}"
    return Scene(name, who, formulation, Stack(*levels, subject_to=hard), both(*targets), above=above, dt=dt)


def loops(
    formulation: str, seeds: Sequence[int], variant: Variant = PRICED, draw: Callable[[int, str], Scene] = scene
) -> Iterator[Record]:
    """Figures and misses of each seed; limits on changes of command scale with the period over 2 ms."""
    for seed in seeds:
        drawn = draw(seed, formulation)
        found = figures(run(drawn, variant, round(SECONDS / drawn.dt)))
        judged = {**found, "jump": float(found["jump"]) * min(1.0, DT / drawn.dt)}
        missed = list(goals.misses(formulation, judged))
        asked = missed == ["acceleration_p50"] and _asks(drawn, float(found["acceleration_p50"]))
        yield {
            "robot": drawn.subject.robot.name, "formulation": formulation, "scene": f"seed {seed}: {drawn.name}",
            "variant": "drawn", **found, "misses": missed, "asked": asked,
        }  # fmt: skip


def _asks(drawn: Scene, median: float) -> bool:
    """Return true if the exact answer has the same median acceleration: the path needs it."""
    exact = figures(run(drawn, EXACT, round(SECONDS / drawn.dt)))
    return abs(float(exact["acceleration_p50"]) - median) <= ALIKE * median


def table(records: Sequence[Record]) -> str:
    """A row for each formulation: number of loops, misses by goal, and statuses of their ticks."""
    rows = []
    for formulation in dict.fromkeys(r["formulation"] for r in records):
        own = [r for r in records if r["formulation"] == formulation]
        missed = Counter(goal for r in own for goal in r["misses"])
        others = sum("OPTIMAL" not in r["statuses"].split(" ")[0] or "," in r["statuses"] for r in own)
        rows.append((
            formulation, str(len(own)), str(sum(not r["misses"] for r in own)), str(sum(r["asked"] for r in own)),
            ", ".join(f"{goal} {count}" for goal, count in missed.most_common()) or "none", str(others),
        ))  # fmt: skip
    told = [
        f"- {r['robot']}, {r['formulation']}, {r['scene']}: {', '.join(r['misses'])}"
        + ", as the path asks" * r["asked"]
        for r in records
        if r["misses"]
    ]
    head = (
        "formulation",
        "loops",
        "all goals held",
        "median as the path asks",
        "missed, loops",
        "loops with ticks not OPTIMAL",
    )
    return markdown.table(head, rows) + "\n" + "".join(f"\n{line}" for line in told) + "\n"
