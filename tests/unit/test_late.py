"""A late tick continues the motion of the previous solutions: calm scenes stay calm with cut ticks and end alike."""

from __future__ import annotations

import dataclasses
import math
from collections.abc import Sequence

import numpy as np
import pytest

import hqp
from hqp import PD, Hierarchy, Level, Reference, Rows, Selection, Solution, Stack, Status
from hqp._session import CutAnswers
from hqp.arrays import Mat, Vec
from hqp.lab.measures import MOST_REVERSALS
from hqp.loop.guards import largest_change
from hqp.problem import Motion, Stats
from hqp.solvers.base import finish
from hqp.solvers.lexicographic import Lexicographic
from hqp.tasks import Com, FixedContact, FrictionCone, JointLimits, Position, Posture, TorqueLimits
from hqp.tolerances import VIOLATION_TOLERANCE
from tests.scenes.altered import Altered, Answers
from tests.scenes.calm.loop import NOTICEABLE, limits
from tests.scenes.calm.scenes import DT, FORMULATIONS, Scene, scenes
from tests.scenes.overloaded import no_worse

SOLVER = Lexicographic()
FROM, TO, TICKS = 20, 700, 1200


class Stopped:
    """Solver that stops too early: it ignores prices and, in every second tick, the lower levels."""

    def __init__(self) -> None:
        self.cuts = 0

    def __call__(self, problem: Hierarchy, found: Solution) -> Solution:
        """Return the solution so far, with TIME_LIMIT."""
        self.cuts += 1
        exact = problem.exact()
        if self.cuts % 2:
            exact = dataclasses.replace(exact, levels=exact.levels[:3], stacked=None, n=problem.n)
        x = SOLVER.solve(exact).x
        return finish(problem, x, Status.TIME_LIMIT, Stats(0, 0, 0.0, 0.0))


class Loop:
    """Scene on the exact integrator; a share of its ticks is cut."""

    def __init__(self, scene: Scene) -> None:
        robot, self.answers = scene.subject.robot, Answers()
        solver = Altered(answers=self.answers)
        controller = hqp.Controller(scene.stack, FORMULATIONS[scene.formulation], solver, deadline=math.inf)
        self.scene, self.robot, self.run = scene, robot, controller.session(robot, scene.dt)
        self.stopped = Stopped()

    def go(self, share: float) -> Mat:
        """Commands of all ticks."""
        rng, commands = np.random.default_rng(0), []
        q, v = self.robot.home.copy(), np.zeros(self.robot.nv)
        for i in range(TICKS):
            cut = FROM <= i < TO and rng.uniform() < share
            self.answers.alter = self.stopped if cut else None
            tick = self.run.step(self.robot.state(q, v), *self.scene.targets(i * self.scene.dt))
            assert (tick.status is Status.TIME_LIMIT) == cut
            commands.append(tick.command.copy())
            q, v = tick.advance()
        return np.array(commands)


def most_reversals(commands: Mat, scale: Vec) -> float:
    """Noticeable reversals per second of the worst joint, counted as in tests.scenes.calm."""
    change = np.diff(commands, axis=0)
    noticed = np.abs(change) > NOTICEABLE * scale
    turned = (change[1:] * change[:-1] < 0.0) & noticed[1:] & noticed[:-1]
    return float(turned.sum(axis=0).max()) / (len(change) * DT)


def made(robot: str, kind: str) -> Scene:
    return scenes(robot, kind, {})["beyond"]()


HEAVY = pytest.mark.slow
CASES = [
    pytest.param(robot, kind, marks=() if (robot, kind) in (("talos", "velocity"), ("ur5", "torque")) else HEAVY)
    for robot in ("talos", "g1", "ur5")
    for kind in FORMULATIONS
]


@pytest.mark.long
@pytest.mark.parametrize("share", [0.05, 0.4])
@pytest.mark.parametrize(("robot", "kind"), CASES)
def test_ticks_that_are_cut_leave_commands_calm(robot: str, kind: str, share: float) -> None:
    scene = made(robot, kind)
    calm, busy, scale = Loop(scene).go(0.0), Loop(scene).go(share), limits(scene)
    assert most_reversals(busy[FROM:TO], scale) <= MOST_REVERSALS
    step = np.abs(np.diff(busy[FROM:], axis=0)).max()
    assert step <= np.abs(np.diff(calm[FROM:], axis=0)).max() + 2.0 * largest_change(kind, DT)
    if share < 0.1:  # one second after the last cut
        assert np.all(np.abs(busy[-1] - calm[-1]) <= NOTICEABLE * scale)


@pytest.mark.parametrize(("name", "most"), [("cbi", 15), ("g1", 15), ("talos", 15), ("g1", 4), ("talos", 8)])
def test_a_robot_is_held_up_until_its_first_search_has_ended(name: str, most: int) -> None:
    """Both hands far out of reach: a search of 80 to 300 working sets, a few per tick; some never end."""
    robot, few = hqp.robots.load(name), Lexicographic(max_iterations=most)
    soles, hands = robot.landmarks["soles"], robot.landmarks["palms"]
    tasks = [Com(axes="xy", law=PD(9.0)), *[Position(frame=hand, law=PD(25.0)) for hand in hands], Posture(law=PD(1.0))]
    stands = [FixedContact(frame=sole) for sole in soles]
    cones = [FrictionCone(contact=sole, mu=0.6) for sole in soles]
    stack = Stack(*map(Level, tasks), subject_to=[*stands, *cones, JointLimits(), TorqueLimits()])
    session = hqp.Controller(stack, hqp.Torque(), solver=few, deadline=math.inf).session(robot, DT)
    goals = [robot.state().position(hand) + [2.0, 1.0, 0.5] for hand in hands]
    q, v, cut, torques = robot.home.copy(), np.zeros(robot.nv), 0, []
    for i in range(60):
        tick = session.step(
            robot.state(q, v), *[Reference(hand, goal) for hand, goal in zip(hands, goals, strict=True)]
        )
        cut += tick.status is Status.ITERATION_LIMIT
        torques.append(tick.command.copy())
        q, v = tick.advance()
        if cut == i + 1:  # all ticks so far
            np.testing.assert_allclose(torques[-1], torques[0], atol=1e-9)
            assert np.abs(v).max() < 1e-9
    assert 0 < cut < 30 or most < 15
    assert np.abs(v).max() < 3.0


class Sent:
    """Commands sent for solutions of a hierarchy."""

    def __init__(self, problem: Hierarchy, joints: Sequence[int], most: float) -> None:
        self.n = problem.n
        sentences = [status.value for status in Status]
        self.outgoing = CutAnswers(problem, list(joints), most, VIOLATION_TOLERANCE, sentences, DT)

    def instead(self, cut: Vec, last: Vec, tick: int) -> Vec:
        """Command in place of a cut solution."""
        x, status = np.empty(self.n), Status.TIME_LIMIT
        assert self.outgoing.instead(cut, last, tick, x) == [("solver", status.severity, status.value)]
        return x


def late(problem: Hierarchy, cut: Vec, last: Vec, ahead: Vec, joints: Sequence[int], most: float) -> Vec:
    """Command in place of a cut solution, if the previous solutions lead from ``last`` to ``ahead``."""
    sent = Sent(problem, joints, most)
    sent.outgoing.solved(np.zeros(problem.n), 1)
    sent.outgoing.solved(ahead - last, 2)
    return sent.instead(cut, last, 3)


def drawn(rng: np.random.Generator, prices: bool) -> tuple[Hierarchy, Vec]:
    """Hierarchy below a box, and a last solution near its optimum."""
    n = 6
    levels = [Rows(Selection(np.arange(n)), np.full(n, -1.0), np.full(n, 1.0))]
    for m in (2, 3, 3):
        b = rng.normal(size=m)
        levels.append(Rows(rng.normal(size=(m, n)), b, b))
    price = np.array([0.0, 0.0, 0.1, 0.1]) if prices else None
    problem = Hierarchy(tuple(levels), constraints=2, prices=price)
    return problem, SOLVER.solve(problem).x + rng.normal(0.0, 1e-2, n)


@pytest.mark.parametrize("prices", [False, True])
def test_nothing_gets_worse_than_by_staying(prices: bool) -> None:
    rng, moved, found = np.random.default_rng(1), 0, 0
    for _ in range(300):
        problem, last = drawn(rng, prices)
        ahead, cut = last + rng.normal(0.0, 3e-3, 6), last + rng.normal(0.0, 0.3, 6)
        x = late(problem, cut, last, ahead, range(6), 0.02)
        here = problem.boxed(last)
        moved += not np.array_equal(x, here)
        on = problem.boxed(here + (ahead - here) * min(1.0, 0.02 / np.abs(ahead - here).max()))
        found += not np.array_equal(x, here) and not np.allclose(x, on)
        assert np.abs(x - here).max() <= 0.02 * (1.0 + 1e-9)
        assert not problem.slacks(x)[0].any()
        assert no_worse(problem, x, last)
    assert moved > 100  # both continued and cut solutions occur
    assert 20 < found < moved


def test_a_cut_answer_is_taken_where_much_is_at_stake() -> None:
    problem = Hierarchy((Rows(np.eye(3), np.ones(3), np.ones(3)),))
    last = np.array([0.5, 0.5, 0.5])
    ahead = last + 1e-4
    assert np.allclose(late(problem, np.ones(3), last, ahead, range(3), 0.02), last + 0.02)
    assert np.allclose(late(problem, last + 2e-4, last, ahead, range(3), 0.02), ahead)  # the next tick has it
    assert np.allclose(late(problem, -np.ones(3), last, last - 1e-4, range(3), 0.02), last)  # both are worse


def test_the_trend_is_that_of_solved_answers() -> None:
    rows = Rows(np.zeros((1, 1)), np.zeros(1), np.zeros(1))  # every x is optimal
    sent, last = Sent(Hierarchy((rows,)), range(1), math.inf), np.array([3.0])

    def after(tick: int) -> float:
        return float(sent.instead(last, last, tick)[0])

    longest = CutAnswers.LONGEST
    assert after(1) == 0.0  # without a solution the command decays to rest
    sent.outgoing.solved(np.array([1.0]), 1)
    assert after(2) == 3.0
    sent.outgoing.solved(np.array([2.0]), 5)  # four ticks later
    assert after(6) == pytest.approx(3.25)
    assert after(5 + longest) == pytest.approx(3.25)
    assert after(6 + longest) == 3.0
    sent.outgoing.solved(np.array([4.0]), 5)  # twice in one tick: no rate
    assert after(6) == pytest.approx(3.25)
    sent.outgoing.rest(last, 6, np.empty(1))
    assert after(7) == 0.0


def test_what_a_price_saves_counts() -> None:
    A = np.array([[1.0, 0.0], [0.0, 1e-3]])
    rows = Rows(A, np.ones(2), np.ones(2))
    dear, free = Hierarchy((rows,), prices=np.array([0.1])), Hierarchy((rows,))
    still, far = np.array([1.0, 0.0]), np.array([1.0, 100.0])  # misses by a tenth less, with a hundred times the motion
    for problem, found in ((free, far), (dear, still)):
        np.testing.assert_array_equal(late(problem, far, still, still, range(2), math.inf), found)
    moved = dataclasses.replace(dear, motion=Motion(np.array([1.0, 1e-2]), np.array([0.0, 1.0])))
    np.testing.assert_array_equal(late(moved, far, still, still, range(2), math.inf), far)  # up to motion without cost
