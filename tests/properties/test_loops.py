"""Random stacks on many robots, each for some ticks in a closed loop: judge every answer."""

from __future__ import annotations

import math
from collections.abc import Callable
from functools import cache, partial

import numpy as np
import pytest
from numpy.random import Generator

import hqp
from hqp import PD, Level, P, Stack, Status, certificate
from hqp.declare.element import Element
from hqp.declare.law import Law
from hqp.robots import Robot
from hqp.tasks import Com, FixedContact, JointLimits, Orientation, Pose, Position, Posture

ROBOTS = ("talos", "g1", "icub", "romeo", "cbi", "tiago", "panda", "ur5", "solo12", "anymal", "kinova", "xarm7")
STACKS, TICKS = 40, 25

load = cache(hqp.robots.load)


def element(rng: Generator, robot: Robot, law: Callable[[], Law], name: str) -> Element:
    frames = list(robot.frame_names)
    frame = frames[rng.integers(len(frames))]
    kinds: list[Callable[[], Element]] = [
        lambda: Position(frame=frame, law=law(), name=name),
        lambda: Orientation(frame=frame, law=law(), name=name),
        lambda: Pose(frame=frame, law=law(), name=name),
        lambda: FixedContact(frame=frame, name=name),
        lambda: Com(axes=("xy", "xyz", "z")[rng.integers(3)], law=law(), name=name),
        lambda: Posture(law=law(), name=name),
    ]
    return kinds[rng.integers(len(kinds))]()


def draw(rng: Generator, robot: Robot, order: int) -> Stack:
    """Up to five levels of random elements, possibly conflicting or singular, mostly under joint limits."""

    def law() -> Law:
        return P(rng.uniform(0.5, 20.0)) if order == 1 else PD(rng.uniform(1.0, 400.0))

    levels = [
        Level(*(element(rng, robot, law, f"{i}_{j}") for j in range(rng.integers(1, 3))))
        for i in range(rng.integers(1, 6))
    ]
    acceleration = float(rng.choice([20.0, 200.0, 2000.0])) if rng.random() < 0.6 else None
    return Stack(*levels, subject_to=[JointLimits(acceleration=acceleration)] if rng.random() < 0.8 else [])


@pytest.mark.parametrize("seed", [0, *(pytest.param(seed, marks=pytest.mark.slow) for seed in range(1, 6))])
def test_no_answer_is_called_optimal_that_is_not(seed: int) -> None:
    rng = np.random.default_rng(seed)
    solved = 0
    for _ in range(STACKS):
        robot = load(ROBOTS[rng.integers(len(ROBOTS))])
        order = int(rng.integers(1, 3))
        stack = draw(rng, robot, order)
        formulation = hqp.Velocity() if order == 1 else hqp.Acceleration()
        session = hqp.Controller(stack, formulation, deadline=np.inf, price=0).session(
            robot, dt=float(rng.choice([0.001, 0.002, 0.01]))
        )
        q, v = robot.random_configuration(rng, rng.uniform(0.1, 1.0)), np.zeros(robot.nv)
        start = robot.state(q, v)
        reach = {e.name: e.value(start) + rng.normal(0.0, 0.5, 3) for e in stack if isinstance(e, Position)}
        for _ in range(TICKS):
            goals = [stack.find(name, Position).at(goal) for name, goal in reach.items()]
            tick = session.step(robot.state(q, v), *goals)
            if tick.status is Status.INVALID_STATE:  # a state outside the accepted bounds
                break
            assert tick.solution is not None
            if robot.couplings and tick.solution.status is Status.CONSTRAINTS_VIOLATED:
                break  # a random configuration violates its couplings, and the window limits the return
            assert tick.solution.status in (Status.OPTIMAL, Status.RANK_UNCERTAIN), tick.solution.detail
            if tick.solution.status is Status.OPTIMAL:
                verdict = certificate(session.problem, tick.solution.x)
                assert verdict.ok, f"{robot}, {stack}: {verdict}"
                solved += 1
            q, v = tick.advance()
            if np.abs(v).max() > 1e3:
                break
    assert solved > 0.8 * STACKS * TICKS


def test_a_posture_in_three_levels_runs_no_stages_within_reach() -> None:
    """A base at rest is met, even if its terms are small compared with the rounding of the arm's."""
    robot = load("talos")
    names = robot.joint_names
    keys = ("torso", "head"), ("arm", "gripper"), ("leg",)
    parts = [[name for name in names if name.startswith(key)] for key in keys]
    law = partial(P, max_velocity=0.4)
    hand = Position(frame=robot.landmarks["palms"][1], law=law(5.0), name="hand")
    stack = Stack(
        Level(*(FixedContact(frame=frame) for frame in robot.landmarks["soles"]), name="feet"),
        Level(Com(axes="xy", law=law(5.0)), name="com"),
        Level(hand, name="hand"),
        Level(Orientation(frame="base_link", law=law(2.0)), name="base"),
        *(Level(Posture(joints=part, law=law(1.0), name=str(i)), name=str(i)) for i, part in enumerate(parts)),
        subject_to=[JointLimits()],
    )
    session = hqp.Controller(stack, hqp.Velocity(), deadline=math.inf).session(robot, 0.002)
    q, v, staged = robot.home.copy(), np.zeros(robot.nv), 0
    start = robot.state(q).position(hand.frame)
    for i in range(300):
        t = 0.002 * i
        goal = start + 0.05 * np.array([np.sin(t), 1.0 - np.cos(t), 0.5 * np.sin(2.0 * t)])
        tick = session.step(robot.state(q, v), hand.at(goal))
        assert tick.status is Status.OPTIMAL
        staged += tick.solution is not None and tick.solution.stage_points is not None
        q, v = tick.advance()
    assert staged < 15, f"{staged} of 300 ticks ran stages"
