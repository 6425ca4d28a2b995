"""Rates of change of commands in a transition are bounded, on robots with other shapes than those of test_change.py."""

from __future__ import annotations

from dataclasses import dataclass
from functools import cache
from typing import Any

import numpy as np
import pytest

import hqp
from hqp import Level, Stack, Status
from hqp.commands.arguments import formulation
from hqp.loop.guards import largest_change
from hqp.loop.tick import Tick
from hqp.tasks import Com, FixedContact, JointLimits, Orientation, PointContact, Position, Posture, TorqueLimits

LEVELS = ("velocity", "acceleration", "torque")
ROBOTS = {  # frames of contacts, hand, trunk
    "simple_humanoid": (("l_ankle", "r_ankle"), "r_wrist", "BODY"),
    "b1-z1": (("FL_foot", "FR_foot", "RL_foot", "RR_foot"), "gripperMover", "trunk"),
    "romeo": (("l_sole", "r_sole"), "r_wrist", "base_link"),
    "solo12": (("FL_FOOT", "FR_FOOT", "HL_FOOT", "HR_FOOT"), "", "base_link"),
    "go2": (("FL_foot", "FR_foot", "RL_foot", "RR_foot"), "", "base"),
    "ur10": ((), "tool0", ""),
    "panda": ((), "panda_hand", ""),
}

load = cache(hqp.robots.load)


@dataclass
class Made:
    """Robot with the tasks and constraints that a test picks from."""

    robot: Any
    tasks: list[Any]
    subject_to: list[Any]

    def stack(self, *picks: int) -> Stack:
        return Stack(*(Level(self.tasks[i]) for i in picks), Level(Posture()), subject_to=self.subject_to)


def made(name: str, level: str) -> Made:
    robot = load(name)
    feet, hand, trunk = ROBOTS[name]
    contact = FixedContact if len(feet) == 2 else PointContact
    tasks: list[Any] = [Com(name="com")] if feet else []
    tasks += [Position(frame=hand, name="hand"), Orientation(frame=hand, name="turn")] if hand else []
    tasks += [Orientation(frame=trunk, name="trunk")] if trunk else []
    limits = [TorqueLimits()] if level == "torque" else [JointLimits()]
    return Made(robot, tasks, [*(contact(frame=foot) for foot in feet), *limits])


class Run:
    """Closed loop on the exact integrator."""

    def __init__(self, name: str, level: str, first: Any, dt: float, **options: Any) -> None:
        self.made, self.level, self.dt = made(name, level), level, dt
        self.robot = self.made.robot
        controller = hqp.Controller(self.made.stack(*first), formulation(level), deadline=np.inf, **options)
        self.session = controller.session(self.robot, dt)
        self.q, self.v = self.robot.home.copy(), np.zeros(self.robot.nv)
        state = self.robot.state()
        self.goals = {t.name: np.array(t.value(state)) for t in self.made.tasks}
        self.ticks: list[Tick] = []

    def go(self, ticks: int, *, given: Any = None) -> Tick:
        """Run ticks with a reference for every task of the stack, or for the given ones only."""
        for _ in range(ticks):
            stack = self.session.stack
            names = [t.name for t in self.made.tasks if t.name in stack] if given is None else given
            goals = [t.at(self.goals[t.name]) for t in self.made.tasks if t.name in names]
            self.ticks.append(self.session.step(self.robot.state(self.q, self.v), *goals))
            self.q, self.v = self.ticks[-1].advance()
        return self.ticks[-1]

    def change(self, picks: Any, over: float, longest: int = 3000) -> float:
        """Run a transition to its end; return the largest change of a command per tick in units of the limit."""
        begin = len(self.ticks)
        self.session.change(self.made.stack(*picks), over)
        while self.go(1).transition < 1.0:
            assert len(self.ticks) - begin < longest, [n.detail for n in self.ticks[-1].notes]
        sent = np.array([tick.command for tick in self.ticks[begin - 1 :]])
        return float(np.abs(np.diff(sent, axis=0)).max()) / largest_change(self.level, self.dt)


@pytest.mark.parametrize("level", LEVELS)
@pytest.mark.parametrize("name", ["simple_humanoid", "b1-z1"])
def test_a_task_that_leaves_and_is_no_longer_named_does_not_jump(name: str, level: str) -> None:
    """The task fell back to its start: 0.1 rad/s, 19.9 rad/s^2 and 102 N m in one tick."""
    run = Run(name, level, (0, 1, 3), 0.002)
    run.goals["hand"] += [0.08, 0.05, -0.06]
    run.go(250)
    assert run.change((0, 3), 0.25) <= 1.0 + 1e-9
    run.go(20)
    assert run.change((0, 1, 3), 0.25) <= 1.0 + 1e-9
    assert run.ticks[-1].status in (Status.OPTIMAL, Status.CONSTRAINTS_VIOLATED)


def drawn(seed: int) -> tuple[Run, Any, float]:
    rng = np.random.default_rng(seed)
    name, level = list(ROBOTS)[seed % len(ROBOTS)], LEVELS[seed // len(ROBOTS) % len(LEVELS)]
    count = len(made(name, level).tasks)
    first, second = (rng.permutation(count)[: rng.integers(1, count + 1)].tolist() for _ in range(2))
    run = Run(name, level, first, float(rng.choice([0.001, 0.002, 0.004])))
    for task, goal in run.goals.items():
        if np.ndim(goal) == 1:
            goal += rng.uniform(-1.0, 1.0, goal.shape) * (0.02 if task == "com" else 0.08)
    run.go(int(rng.integers(1, 150)))
    return run, second, float(rng.choice([0.05, 0.25, 0.5]))


@pytest.mark.parametrize("level", LEVELS)
def test_an_element_that_is_no_longer_named_keeps_its_last_reference(level: str) -> None:
    """Keep the last reference, also if a second change begins before the first one ends."""
    sent = []
    for given in (["com", "hand", "trunk"], ["com", "trunk"]):
        run = Run("simple_humanoid", level, (0, 1, 3), 0.002)
        run.goals["hand"] += [0.08, 0.05, -0.06]
        run.go(150)
        run.session.change(run.made.stack(0, 3), 0.2)
        run.go(40, given=given)
        run.session.change(run.made.stack(3, 0), 0.2)
        run.go(40, given=given)
        sent.append([tick.command for tick in run.ticks])
    np.testing.assert_array_equal(*sent)


@pytest.mark.slow
@pytest.mark.parametrize("seed", range(33))
def test_drawn_transitions_are_bounded(seed: int) -> None:
    run, second, over = drawn(seed)
    assert run.change(second, over) <= 1.0 + 1e-9
