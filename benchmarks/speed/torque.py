"""Torque ticks at 1 kHz through every solver: Dreamer on its wheels, Talos in double support, split into parts."""

from __future__ import annotations

import argparse
from collections.abc import Mapping
from dataclasses import replace
from functools import partial
from typing import TypeAlias

import numpy as np

import hqp
from benchmarks.reports import report, solver_sets
from benchmarks.reports.checks import write_json
from benchmarks.speed import ticks, timing
from benchmarks.speed.ticks import Goals, Ticks
from hqp import PD, Level, Stack, native, robots, solvers
from hqp.arrays import Vec
from hqp.robots import Robot
from hqp.tasks import (
    CenterOfPressure,
    Com,
    FixedContact,
    FrictionCone,
    Orientation,
    Position,
    Posture,
    TorqueLimits,
)
from tests.scenes import sentis2012

GOALS_US = {"dreamer": 200.0, "talos": 400.0}
"""Goals of the native solver's median tick [us]."""

Scene: TypeAlias = tuple[Robot, Stack, Goals, Position]


def add_arguments(parser: argparse.ArgumentParser) -> None:
    """Options of this part."""
    timing.add_counts(parser)


def run(arguments: argparse.Namespace) -> int:
    """Measure, show, write; return 1 if a solved answer is wrong.  Times depend on the machine and fail nothing."""
    count = arguments.ticks or (200 if arguments.quick else 2000)
    names = [name for name in arguments.solvers or solver_sets.every() if solvers.load(name).metric]
    scenes = (dreamer(), talos())

    def through(scene: Scene, name: str, solver: solvers.Solver, count: int) -> Ticks:
        return ticks.measure(*scene, hqp.Torque(), name, solver, count, 1e-3)

    runs = timing.each("torque", [partial(through, scene) for scene in scenes], names, count)
    records = [r.record() for r in runs]
    if arguments.json is not None:
        write_json(arguments.json, records)
    reached = [
        timing.goal(f"whole torque tick on {r.robot} (lexicographic)", GOALS_US[r.robot], r.median, "us")
        for r in runs
        if r.solver == "lexicographic"
    ]
    text = report.table(timing.HEADER, map(timing.cells, records))
    goals = report.table(timing.GOAL_HEADER, reached)
    for shown in (text, goals):
        report.console.print(shown, markup=False, soft_wrap=True)
    report.section(
        arguments.output,
        "torque",
        f"{count} ticks of 1 kHz, one BLAS thread, garbage collection off, {native.describe()}. Times in us, medians "
        "where not said otherwise. Kinematics, inertia, bias forces and drifts count as rows; *floor* is Pinocchio's "
        f"kinematics alone; *gap*: largest certificate gap of every {ticks.JUDGED}th tick; *late*: over 1 ms. Solvers "
        "marked (limits ignored) take no inequalities: they do less.",
        *(f"{robot.name}: `{stack}`" for robot, stack, *_ in scenes),
        text,
        goals,
    )
    wrong = [
        f"{r.solver} on {r.robot}: every tick solved, but the certificate's gap is {r.gap:.1e}"
        for r in runs
        if timing.wrong(r)
    ]
    return report.conclude(arguments.output, "torque", [*timing.summary(runs), *report.goals_of(reached)], wrong)


def dreamer() -> Scene:
    """Eqs. (48) to (59): balance, hand, posture, goals that move with the base."""
    robot = robots.load("dreamer")
    law = PD(400.0, 40.0, max_acceleration=2.5)
    com, hand = replace(sentis2012.COM, law=law), sentis2012.HAND
    stack = sentis2012.paper_stack([TorqueLimits()], com=com)
    at_home = robot.state()
    centre, place = com.value(at_home), hand.value(at_home)

    def goals(t: float) -> Mapping[str, Vec]:
        reach = 0.05 * np.array([np.sin(3.0 * t), np.cos(3.0 * t) - 1.0, np.sin(2.0 * t)])
        return {com.name: centre, hand.name: place + reach}

    return robot, stack, goals, hand


def talos() -> Scene:
    """Both feet with friction and centre of pressure; CoM, hand and pelvis, posture; torque limits."""
    robot = robots.load("talos")
    soles, palm, base = robot.landmarks["soles"], robot.landmarks["palms"][0], robot.landmarks["base"][0]
    com, hand = Com(name="com", law=PD(50.0)), Position(frame=palm, law=PD(80.0))
    limits = [TorqueLimits()]
    for sole in soles:
        rectangle = (-0.1, 0.1, -0.05, 0.05)
        limits += [FrictionCone(contact=sole, mu=0.6), CenterOfPressure(contact=sole, rectangle=rectangle)]
    stack = Stack(
        Level(com, name="balance"),
        Level(hand, Orientation(frame=base, law=PD(50.0)), name="hand and pelvis"),
        Level(Posture(law=PD(30.0)), name="posture"),
        subject_to=[*(FixedContact(frame=s) for s in soles), *limits],
    )
    at_home = robot.state()
    centre, place = com.value(at_home), hand.value(at_home)

    def goals(t: float) -> Mapping[str, Vec]:
        sway = np.array([0.0, 0.03 * np.sin(1.5 * t), 0.0])
        reach = 0.05 * np.array([np.sin(3.0 * t), 0.0, np.cos(3.0 * t) - 1.0])
        return {com.name: centre + sway, hand.name: place + reach}

    return robot, stack, goals, hand
