"""Arms above hqp's walker in MuJoCo: Talos, whose walker has a session of its own and takes the arms as measured."""

from __future__ import annotations

import argparse
import math
import time
import warnings
from pathlib import Path
from typing import Any

import numpy as np
import pinocchio as pin

import hqp
from benchmarks.policies.arms import PUSHES, Course, Motion, drawn_push, table
from benchmarks.policies.filter import Shapes
from benchmarks.reports import report
from hqp.robots.on_mujoco import Plane, Plant
from hqp.walking import Walker
from hqp.walking.course import FALLEN

DT, EVERY = 0.002, 2
"""Period of the walker [s], and its periods in one of the arms."""
REACHES = (0.05, 0.1, math.inf)
MARK, END = "<!-- tables: python -m benchmarks talos --page docs/upper-body.md -->", "<!-- end -->"
"""Marks in the page around the generated table."""
PUSHED = 0.1
"""Duration of a push [s]."""
GOALS = 4
"""Number of ways of the hands."""
PLACE = (0.15, 0.6, -0.1, 0.6)
"""Least and largest x, and z, of drawn places of hands over the base [m]."""


def add_arguments(parser: argparse.ArgumentParser) -> None:
    """Options of this part."""
    parser.add_argument("--motions", type=int, default=6, help="drawn motions of each reach, by default 6")
    parser.add_argument("--only", nargs="*", default=None, metavar="NAME", help='such as "reach 0.05"')
    parser.add_argument("--first", type=int, default=0, help="seed of the first motion")
    parser.add_argument("--page", type=Path, metavar="FILE", help="write the table there, in a page of the docs, too")


def run(arguments: argparse.Namespace) -> int:
    """Run the motions, show, write."""
    warnings.simplefilter("ignore")
    count = 2 if arguments.quick else arguments.motions
    names: dict[str, float | None] = {"the walker's own": None, **{f"reach {r:g}": r for r in REACHES}}
    names = {name: reach for name, reach in names.items() if arguments.only is None or name in arguments.only}
    found: dict[str, list[Motion]] = {name: [] for name in names}
    for seed in range(arguments.first, arguments.first + count):
        for name, reach in names.items():
            one = motion(seed, reach)
            found[name].append(one)
            text = f"{seed} {name}: {'fell' if one.fell else 'stands'}, {one.touches} touches, {one.fast:.1f} rad/s"
            report.console.print(text)
    text = table(found)
    report.section(arguments.output, "talos", text)
    if arguments.page is not None:
        report.into_page(arguments.page, MARK, text, END)
    return 0


def drawn(robot: Any, hands: tuple[str, ...], columns: Any, rng: np.random.Generator) -> Course:
    """Places of both hands over the base: those at home, then of drawn joints, in front, one in five too far away."""
    data, base = robot.model.createData(), robot.landmarks["base"][0]
    found: list[list[pin.SE3]] = [[] for _ in hands]
    for k in range(GOALS + 1):
        for side, hand in enumerate(hands):
            while True:
                angles = np.array(robot.state(robot.home).angles)
                if k:
                    span = 0.15 * (robot.upper - robot.lower)[columns]
                    angles[columns] = rng.uniform(robot.lower[columns] + span, robot.upper[columns] - span)
                q = robot.configuration(angles)
                pin.framesForwardKinematics(robot.model, data, q)
                place = data.oMf[robot.frame(base)].actInv(data.oMf[robot.frame(hand)])
                x, _, z = place.translation
                if k == 0 or (PLACE[0] < x < PLACE[1] and PLACE[2] < z < PLACE[3]):
                    break
            if k and rng.uniform() < 0.2:
                place.translation = place.translation * (1.35, 1.35, 1.0)
            found[side].append(place)
    return Course(found)


def motion(seed: int, reach: float | None) -> Motion:
    """Seeds that three divides stand and are pushed, others walk; 0 to 2 kg in each hand, unknown to the walker.

    reach: limit of UpperBody [m], None for the arms of the walker.
    """
    rng = np.random.default_rng(seed)
    masses, walks = rng.uniform(0.0, 2.0, 2), seed % 3 != 0
    velocity = rng.uniform(0.1, 0.3), 0.0, rng.uniform(-0.15, 0.15)
    robot, other = (hqp.robots.load("talos", rotors=True) for _ in range(2))
    walker = Walker(other, dt=DT, deadline=math.inf)
    hands = tuple(robot.landmarks["palms"][:2])
    legs = tuple(name for name in robot.joint_names if name.startswith(("leg", "torso")))
    declared = hqp.UpperBody(
        legs=legs, hands=hands, reach=reach or math.inf, joint_speed=2.5, output="torques", bandwidth=30.0
    )
    arms, found = declared.session(robot, DT * EVERY, deadline=math.inf), Motion()
    apart: Any = arms.session.stack.find("collision")
    judge, own = Shapes(robot, apart), robot.actuated
    taken = np.isin(own, arms.columns)
    course = drawn(robot, hands, arms.columns, rng)

    def edit(spec: Any) -> None:
        for hand, mass in zip(hands, masses, strict=True):
            carrier = spec.body(robot.model.frames[robot.model.frames[robot.frame(hand)].parentFrame].name)
            load = (carrier or spec.body(hand)).add_body()
            load.mass, load.inertia, load.explicitinertial = mass, [1e-3] * 3, True

    plant = Plant(robot, terrain=Plane(friction=0.6), watched=[foot.frame for foot in walker.feet], edit=edit)
    plant.reset(walker.start)
    base, tau, force = robot.landmarks["base"][0], np.zeros(own.size), np.zeros(3)
    for k in range(round(course.length / DT)):
        q, v = plant.state()
        if k * DT == 1.0 and walks:
            walker.go(*velocity)
        command = walker.step(other.state(q, v), plant.measure().contacts.load).command.copy()
        place, turned = plant.place(base)
        heading = pin.utils.rotate("z", math.atan2(turned[1, 0], turned[0, 0]))
        pelvis = pin.SE3(heading, np.array(place))
        aims = course.goals(k * DT, pelvis, velocity if walks and k * DT > 1.0 else np.zeros(3))
        if reach is not None and k % EVERY == 0:
            start, state = time.process_time(), robot.state(q, v)
            goals = [
                arms.over_base(state, hand, aim.place.homogeneous, aim.velocity, aim.base)
                for hand, aim in zip(arms.hands, aims, strict=True)
            ]
            tick = arms.step(state, *goals, loads=masses.tolist())
            found.cpu.append(time.process_time() - start)
            found.ticks, found.unsolved = found.ticks + 1, found.unsolved + (not tick.tick.status.solved)
            tau[taken] = tick.torques
        if reach is not None:
            command[taken] = tau[taken]
        if not walks and k and k % round(PUSHES / DT) == 0:
            force = np.append(pin.computeTotalMass(robot.model) / PUSHED * drawn_push(rng), 0.0)
        if k % round(PUSHES / DT) < round(PUSHED / DT):
            plant.push(base, force)
        plant.step(command, steps=round(DT / plant.timestep))
        found.fast = max(found.fast, float(np.abs(plant.state()[1][arms.columns]).max()))
        if k % 25 == 0:
            if k * DT > 1.0:
                found.errors += [
                    float(np.linalg.norm(plant.place(h)[0] - aim.world.translation))
                    for h, aim in zip(hands, aims, strict=True)
                ]
            found.judged += 1
            found.touches += judge.least(plant.state()[0]) <= 0.0
            ground = min(plant.place(foot.frame)[0][2] for foot in walker.feet)
            if not plant.com()[2] - ground > FALLEN * walker.height:
                found.fell = True
                break
    return found
