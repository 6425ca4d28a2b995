"""Parts of the calm command: text, records, and missed goals of each."""

from __future__ import annotations

import argparse
import importlib.util
from collections.abc import Callable, Iterator, Mapping, Sequence
from dataclasses import dataclass
from functools import partial
from typing import Any

import numpy as np

import hqp
from benchmarks.calm import ablation, tables
from benchmarks.reports import report
from tests.scenes.calm import arrival, continuity, distance, drawn, goals, references, straight
from tests.scenes.calm.families import FAMILIES
from tests.scenes.calm.loop import Run, figures
from tests.scenes.calm.loop import run as carry_out
from tests.scenes.calm.robots import ARMS, HUMANOIDS
from tests.scenes.calm.scenes import scenes
from tests.scenes.calm.variants import EXACT_LIMITED, VARIANTS, Variant, solver_of
from tests.scenes.calm.walking import SOLES, walking

MAIN = (*HUMANOIDS, *ARMS)
QUICK = ("talos", "ur5")
SHOWN = ("beyond",)
"""Scenes whose commands are drawn."""

Record = dict[str, Any]


@dataclass(frozen=True)
class Outcome:
    """Tables as text, their records, goals that were missed and promises that were broken, a line each."""

    text: str
    records: Sequence[Any]
    missed: Sequence[str] = ()
    broken: Sequence[str] = ()


@dataclass(frozen=True)
class Part:
    """Section of the page: title, introduction, measuring function."""

    title: str
    introduction: str
    measure: Callable[[argparse.Namespace], Outcome]


def variants(arguments: argparse.Namespace) -> list[Variant]:
    """Select the variants of the command line; priced ones run with its solver."""
    return [_with(VARIANTS[name], arguments.solver) for name in arguments.variants]


def priced(arguments: argparse.Namespace) -> Variant:
    """Variant with default prices and the command line's solver."""
    return _with(VARIANTS["priced"], arguments.solver)


def _with(variant: Variant, solver: str) -> Variant:
    return Variant(variant.name, solver_of(solver)) if solver and variant.name == "priced" else variant


def closed_loops(arguments: argparse.Namespace) -> Outcome:
    """The chosen scenes at all three levels."""
    robots = arguments.robots or (QUICK if arguments.quick else MAIN)
    wanted = set(arguments.scenes or (("within", "beyond") if arguments.quick else ()))
    records = [
        record
        for robot in robots
        for formulation in arguments.formulations
        for name in scenes(robot, formulation, {})
        if not wanted or name in wanted
        for record in _scene(robot, formulation, name, arguments)
    ]
    text = "\n".join(f"### {f}\n\n{tables.table(records, f)}" for f in arguments.formulations)
    return Outcome(text, records, *_told(records))


def _scene(robot: str, formulation: str, name: str, arguments: argparse.Namespace) -> Iterator[Record]:
    runs: dict[str, Run] = {}
    for variant in variants(arguments):
        scene = scenes(robot, formulation, variant.limits)[name]()
        runs[variant.name] = data = carry_out(scene, variant, arguments.ticks)
        record: Record = {
            "robot": robot, "formulation": formulation, "scene": name, "variant": variant.name, **figures(data)
        }  # fmt: skip
        record["misses"] = list(goals.misses(formulation, record))
        if scene.within and variant.name == "priced":  # the cost of the price alone
            alone = carry_out(scenes(robot, formulation, EXACT_LIMITED.limits)[name](), EXACT_LIMITED, arguments.ticks)
            same = figures(alone)
            record["ratio"] = float(record["error"]) / max(float(same["error"]), 1e-12)
            record["apart"] = float(np.abs(data.commands - alone.commands).max())
            if goals.loses(record, same):
                record["misses"].append("error")
        yield record
    if name in SHOWN and importlib.util.find_spec("matplotlib") is not None:
        from benchmarks.calm import plots

        plots.commands(runs, arguments.output / f"calm_{robot}_{formulation}_{name.replace(' ', '_')}.png")
    report.console.print(f"{robot}, {formulation}: {name}")


def walks(arguments: argparse.Namespace) -> Outcome:
    """A hand that walks away, torque control with friction."""
    records: list[Record] = []
    for robot in arguments.robots or MAIN:
        for variant in variants(arguments) if robot in SOLES else ():
            found = figures(carry_out(walking(robot, variant.limits), variant, arguments.ticks))
            records.append({
                "robot": robot, "formulation": "torque", "scene": "walking hand", "variant": variant.name, **found,
                "misses": list(goals.walking_misses(found)),
            })  # fmt: skip
    return Outcome(tables.walking_table(records), records, *_told(records))


def servos(arguments: argparse.Namespace) -> Outcome:
    """CBi under servos in MuJoCo."""
    if importlib.util.find_spec("mujoco") is None:
        return Outcome("MuJoCo is not installed.\n", [])
    from benchmarks.calm import servo

    records: list[Record] = []
    for variant in variants(arguments):
        found = servo.reaching(variant)
        records.append({
            "robot": "cbi", "formulation": "velocity", "scene": "servos", "variant": variant.name, **found,
            "misses": ["com"] if found["com"] > servo.COM else [],
        })  # fmt: skip
    return Outcome(tables.servo_table(records), records, *_told(records))


def drawn_loops(arguments: argparse.Namespace) -> Outcome:
    """Loops drawn at random."""
    seeds = range(arguments.seed, arguments.seed + arguments.drawn)
    records = [r for f in arguments.formulations for r in drawn.loops(f, seeds, priced(arguments))]
    return Outcome(drawn.table(records), records, *_told(records))


def disturbed_loops(arguments: argparse.Namespace) -> Outcome:
    """Drawn loops at 50 and 100 Hz, and with disturbed references."""
    seeds = range(arguments.seed, arguments.seed + arguments.drawn)
    draws = {kind: partial(references.disturbed, kind) for kind in references.DISTURBED}
    draws |= {f"{1.0 / dt:.0f} Hz": partial(references.slow, dt) for dt in (0.01, 0.02)}
    text, records = "", list[Record]()
    for kind, draw in draws.items():
        found = list(drawn.loops("velocity", seeds, priced(arguments), draw))
        text += f"### {kind}\n\n{drawn.table(found)}\n"
        records += found
    return Outcome(text, records, *_told(records))


def neighbours(arguments: argparse.Namespace) -> Outcome:
    """Neighbouring problems."""
    solver = priced(arguments).solver
    solver = hqp.solvers.load(solver) if isinstance(solver, str) else solver
    found = [continuity.measure(family, 100 if arguments.quick else arguments.count, solver) for family in FAMILIES]
    return Outcome(continuity.table(found), [vars(one) for one in found], [m for one in found for m in one.misses])


def arrivals(arguments: argparse.Namespace) -> Outcome:
    """Random poses."""
    count = 8 if arguments.quick else max(arguments.count // len(arrival.FRAMES), 1)
    seeds = range(arguments.seed, arguments.seed + count)
    robots = [name for name in arrival.FRAMES if not arguments.robots or name in arguments.robots]
    records = [r for name in robots for r in arrival.measure(name, seeds, priced(arguments))]
    return Outcome(arrival.table(records), records, list(arrival.misses(records)))


def straight_arms(arguments: argparse.Namespace) -> Outcome:
    """Nearly straight arms."""
    joints = (2, 3) if arguments.quick else tuple(straight.AXES)
    records = [r for f in arguments.formulations for r in straight.measure(f, joints, priced(arguments))]
    return Outcome(straight.table(records), records, list(straight.misses(records)))


def distances(arguments: argparse.Namespace) -> Outcome:
    """Least distances of a hand to its target."""
    names = [name for name in distance.AHEAD if not arguments.robots or name in arguments.robots]
    records = list(distance.measure(names, priced(arguments)))
    return Outcome(distance.table(records), records, list(distance.misses(records)))


def ablations(arguments: argparse.Namespace) -> Outcome:
    """Every number of the law with another value."""
    records = list(ablation.measure(arguments.solver))
    return Outcome(ablation.table(records), records, list(ablation.misses(records)))


def _told(records: Sequence[Record]) -> tuple[list[str], list[str]]:
    """Goals missed by priced levels, and promises broken."""
    missed, broken = list[str](), list[str]()
    for r in records:
        if r["misses"] and r["variant"] in ("priced", "drawn"):
            line = f"{r['robot']}, {r['formulation']}, {r['scene']}: {', '.join(r['misses'])}"
            (broken if goals.PROMISES & set(r["misses"]) else missed).append(line)
    return missed, broken


PARTS: Mapping[str, Part] = {
    "scenes": Part(
        "Closed loops",
        "CoM over the ground > hand > base orientation > posture, s.t. feet and joint limits (at torque level\n"
        "torque limits, too), on the exact integrator at 500 Hz; laws with at most 0.4 m/s. A target is half\n"
        "as far ahead as the hand gets (*within*), as far (*edge*), or one metre more (*beyond*), a step at t\n"
        "= 0 or a circle of 0.1 m at 3 rad/s; judged over the second 1.5 s. *exact*: `price=0` and position\n"
        "and speed limits alone. *error*: mean distance of the hand from its goal; *levels above*: the\n"
        "largest residual of contacts and CoM in their rows; times are CPU time of one `session.step` from\n"
        "Python.",
        closed_loops,
    ),
    "walking": Part("A hand that walks away", "Torque control with friction, 20 N on each foot.", walks),
    "servo": Part("CBi under position servos in MuJoCo", "A hand asked for one metre more than it reaches.", servos),
    "drawn": Part(
        "Loops drawn at random",
        "Ten robots, rates of 100 to 1000 Hz, one hand or two, with or without orientation, gains of 0.5 to\n"
        "10; half of them have a speed limit for hands and CoM, none for base and posture; targets are 0.1 to\n"
        "1.2 m away in any direction, a quarter of them circles. A median acceleration that the exact answer\n"
        "has itself, within 5 %, is what the path asks for.",
        drawn_loops,
    ),
    "references": Part(
        "Slow rates and disturbed references",
        "The drawn loops at velocity level with references at 30 Hz, with jumps of 0.2 m every half second,\n"
        "missing for 0.2 of every 0.7 s, and at 100 and 50 Hz.",
        disturbed_loops,
    ),
    "continuity": Part(
        "Neighbouring problems",
        "All data of levels above the posture moved by 1e-6: how often the answer changes by more than 0.01,\n"
        "and how steep it is. A hard level with a nearly lost row jumps with any definition that keeps it\n"
        "exact.",
        neighbours,
    ),
    "arrival": Part(
        "Goals within reach",
        "The poses of random configurations; gains of 5, 20, 100 and 1/dt at 2, 5 and 10 ms, half of the laws\n"
        "with at most 1 m/s and 1 rad/s, postures of 1 and 10/s, half of the starts singular. Reached: 1 mm\n"
        "and 1 mrad in 1.5 times the time of exact levels and 0.2 s more. What exact levels alone reach is\n"
        "reached *later*, within 10 s; or it ends at a *saddle* of the distance, from where the hand arrives\n"
        "once joints are moved by 1e-6 rad; or the hand *rests*. On a straight way: `hqp.reach` follows it in\n"
        "24 steps without a leap.",
        arrivals,
    ),
    "straight": Part(
        "Nearly straight arms",
        "Seconds until the hand is within 1 mm of a target on the arm's line, at 0.6 and 0.9 of its length.",
        straight_arms,
    ),
    "distance": Part(
        "How near a hand gets",
        "After 20 s; base and posture have no speed limit. The least distance is that of a search near the\n"
        "end (SLSQP).",
        distances,
    ),
    "ablation": Part(
        "Numbers of the law",
        "Each number with another value: the scene that is worse then.",
        ablations,
    ),
}  # fmt: skip
"""By name, in the order of the page."""
