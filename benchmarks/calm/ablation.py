"""Numbers of the law: each with another value, and a scene that becomes worse."""

from __future__ import annotations

import math
from collections.abc import Callable, Iterator, Mapping, Sequence
from dataclasses import dataclass, field, replace
from functools import partial
from typing import Any, ClassVar

import numpy as np

import hqp
from benchmarks.reports import report
from hqp import PD, Level, P, Stack, certificate
from hqp.problem import Hierarchy, Shape, Solution, Status
from hqp.solvers.base import Solver, Workspace
from hqp.tasks import Com, JointLimits, Orientation, Position, Posture
from tests.scenes import stacks
from tests.scenes.calm import arrival, continuity, distance, drawn
from tests.scenes.calm.loop import figures, run
from tests.scenes.calm.robots import subject
from tests.scenes.calm.scenes import FORMULATIONS, scenes
from tests.scenes.calm.variants import PRICED, Variant, changed, solver_of
from tests.scenes.priced import FOUND, OF_A_LOOP, in_a_loop, is_unsure

Record = dict[str, Any]
Scene = Callable[[Variant], float]


@dataclass(frozen=True)
class WithEta(Solver):
    """Solver with another eta."""

    solver: Solver
    eta: float
    name: ClassVar[str] = "with eta"
    priced: ClassVar[bool] = True

    def workspace(self, shape: Shape) -> Workspace:
        """Create the workspace of the wrapped solver."""
        return _Work(self.solver.workspace(shape), self.eta)


class _Work:
    def __init__(self, work: Workspace, eta: float) -> None:
        self.work, self.eta = work, eta

    def solve(self, problem: Hierarchy) -> Solution:
        """Solve the problem with the other eta."""
        return self.work.solve(replace(problem, eta=self.eta))

    def reset(self) -> None:
        """Start cold."""
        self.work.reset()


def restless(formulation: str, name: str, gain: float, dt: float, figure: str, variant: Variant) -> float:
    """A figure of the acceleration [rad/s^2] of 5 s with a hand out of reach, base and posture without speed limit."""

    def law(k: float, **most: float) -> hqp.Law:
        return P(k, **most) if formulation == "velocity" else PD(k * k, 2.0 * k, **most)

    who = subject(name)
    robot, hand = who.robot, Position(frame=who.hands[0], law=law(5.0, max_velocity=0.5), name="hand")
    stack = Stack(
        Level(Com(axes="xy", law=law(2.0))), Level(hand),
        Level(Orientation(frame=who.base or "", law=law(2.0), name="base")), Level(Posture(law=law(gain))),
        subject_to=[*who.contacts, JointLimits()],
    )  # fmt: skip
    session = variant.of(stack, FORMULATIONS[formulation]).session(robot, dt)
    q, v = robot.home.copy(), np.zeros(robot.nv)
    goal, found = robot.state(q).position(hand.frame) + np.array((0.3, -0.3, 0.9)), []
    for _ in range(round(5.0 / dt)):
        q, after = session.step(robot.state(q, v), hand.at(goal)).advance()
        found.append(np.abs(after - v)[robot.actuated].max() / dt)
        v = after
    share = {"median": 0.5, "p99": 0.99}[figure]
    return float(np.quantile(found[round(1.0 / dt) :], share))


def chosen(name: str, formulation: str, scene: str, figure: str, variant: Variant) -> float:
    """A figure of a chosen scene."""
    return float(figures(run(scenes(name, formulation, {})[scene](), variant))[figure])


def of_seed(seed: int, figure: str, variant: Variant) -> float:
    """A figure of a drawn loop at velocity level."""
    one = drawn.scene(seed, "velocity")
    return float(figures(run(one, variant, round(drawn.SECONDS / one.dt)))[figure])


def lost(names: Sequence[str], count: int, variant: Variant) -> float:
    """Number of goals that exact levels reach and priced levels do not reach in time."""
    found = [r for name in names for r in arrival.measure(name, range(count), variant)]
    return float(sum(r["exact"] < math.inf <= r["priced"] for r in found))


def steepest(family: str, variant: Variant) -> float:
    """The 99th percentile of dx / ddata of 200 neighbours."""
    return continuity.measure(family, 200, _made(variant)).slope[1]


def wrong(variant: Variant) -> float:
    """Number of problems of tests.scenes.priced whose loop ends, without doubt, at an answer without certificate."""
    found = (in_a_loop(_made(variant), *named) for named in (*((*one, True) for one in FOUND), *OF_A_LOOP))
    return float(sum(
        not is_unsure(answer) and not certificate(case, answer.x, 1e-8, answer.stage_points).ok
        for case, answer in found
    ))  # fmt: skip


def unsure(variant: Variant) -> float:
    """Number of doubtful ends of loops over 80 problems around a vertex, a third of them at zero."""
    return float(sum(is_unsure(in_a_loop(_made(variant), "vertex", seed, False)[1]) for seed in range(80)))


def unsure_steps(_: Variant) -> float:
    """Number of doubtful ticks among 1000 of CBi's walk at 0.2 m/s, torques in MuJoCo."""
    from hqp.walking import Walker
    from hqp.walking.course import Course

    robot = hqp.robots.load("cbi", rotors=True)
    course = Course(Walker(robot, dt=0.002, deadline=math.inf), sensors=None, delay=0.0)
    course.walker.go(forward=0.2)
    return float(sum(course.step().status is Status.RANK_UNCERTAIN for _ in range(1000)))


def apart(name: str, ticks: int, variant: Variant) -> float:
    """Dependence of an answer at the edge of friction cones on the ticks before it."""
    session, given = stacks.scene(name, "torque")
    q, v, found = session.robot.home.copy(), np.zeros(session.robot.nv), 0.0
    for i in range(ticks):
        tick = session.step(session.robot.state(q, v), *given(i))
        found = max(found, float(np.abs(tick.x - _made(variant).solve(session.problem).x).max()))
        q, v = tick.advance()
    return found


def _made(variant: Variant) -> Solver:
    return variant.solver if isinstance(variant.solver, Solver) else hqp.solvers.load(variant.solver)


def left(name: str, variant: Variant) -> float:
    """Excess over the least distance after 20 s [mm]."""
    (found, *_) = distance.measure([name], variant)
    return 1e3 * float(found["off"] - found["least"])


@dataclass(frozen=True)
class Ablation:
    """Another value of a number and a scene that shows the difference; a smaller figure is better."""

    number: str
    other: str
    scene: str
    figure: Scene
    change: Mapping[str, Any] = field(default_factory=dict)
    eta: float | None = None


_PRICE = "hqp.declare.price."
ABLATIONS: tuple[Ablation, ...] = (
    Ablation(
        "eta 1e-4", "1e-2", "distance over the least, CBi after 20 s [mm]", partial(left, "cbi"),
        {f"{_PRICE}ETA": 1e-2}, 1e-2,
    ),
    Ablation("eta 1e-4", "1e-2", "neighbours of *deep*, p99 of the slope", partial(steepest, "deep"), {}, 1e-2),
    Ablation("eta 1e-4", "1e-7", "neighbours of *small*, p99 of the slope", partial(steepest, "small"), {}, 1e-7),
    Ablation(
        "TURNING[1]", "none", "G1, posture 10/s, out of reach: p99 of acceleration [rad/s^2]",
        partial(restless, "velocity", "g1", 10.0, 0.002, "p99"), {f"{_PRICE}TURNING[1]": math.inf},
    ),
    Ablation(
        "TURNING[1]", "a hundredth", "drawn loop 467: reversals a second",
        partial(of_seed, 467, "reversals"), {f"{_PRICE}TURNING[1]": hqp.declare.price.TURNING[1] / 100.0},
    ),
    Ablation(
        "TURNING[2]", "none", "G1, posture kp 100, out of reach: p99 of acceleration [rad/s^2]",
        partial(restless, "acceleration", "g1", 10.0, 0.002, "p99"), {f"{_PRICE}TURNING[2]": math.inf},
    ),
    Ablation(
        "LONGEST_TAU[1] 0.05 s", "0.005 s", "Talos, edge: p99 of acceleration [rad/s^2]",
        partial(chosen, "talos", "velocity", "edge", "acceleration_p99"),
        {f"{_PRICE}LONGEST_TAU[1]": 0.005},
    ),
    Ablation(
        "LONGEST_TAU[1] 0.05 s", "0.5 s", "distance over the least, Talos after 20 s [mm]", partial(left, "talos"),
        {f"{_PRICE}LONGEST_TAU[1]": 0.5, f"{_PRICE}GAIN_TIME": math.inf},
    ),
    Ablation(
        "LONGEST_TAU[2] 0.1 s", "0.01 s", "Talos, edge, acceleration: p99 [rad/s^2]",
        partial(chosen, "talos", "acceleration", "edge", "acceleration_p99"), {f"{_PRICE}LONGEST_TAU[2]": 0.01},
    ),
    Ablation(
        "GAIN_TIME 0.1", "no rule", "24 goals of UR5 and of G1: lost", partial(lost, ("ur5", "g1"), 24),
        {f"{_PRICE}GAIN_TIME": math.inf},
    ),
    Ablation(
        "REST_TIME 1.4", "no rest (1e9)", "UR5, beyond, acceleration: median acceleration [rad/s^2]",
        partial(chosen, "ur5", "acceleration", "beyond", "acceleration_p50"), {f"{_PRICE}REST_TIME": 1e9},
    ),
    Ablation(
        "ACCURATE 1e-8", "none", "named problems: sure of a wrong answer", wrong,
        {"hqp.solvers.stages.ACCURATE": 1e9},
    ),
    Ablation(
        "RESTING 1e-4", "0", "80 problems around a vertex: unsure of their answer", unsure,
        {"hqp.solvers.stages.RESTING": 0.0},
    ),
    Ablation(
        "ROUNDED 1e-11", "1e-14", "1000 ticks of CBi's walk: unsure of their answer", unsure_steps,
        {"hqp.solvers.stages.ROUNDED": 1e-14},
    ),
    Ablation(
        "SOFTNESS 1e-5", "1e-11", "50 ticks of G1's feet at the edge of their cones: warm beside cold [N m]",
        partial(apart, "g1", 50), {"hqp.solvers.lexicographic.SOFTNESS": 1e-11},
    ),
)  # fmt: skip
"""Changes one by one: constants in ``change``, or the problem's ``eta``."""


def measure(solver: str = "") -> Iterator[Record]:
    """Measure each figure with the law's value and with the other one."""
    given = solver_of(solver or "lexicographic")
    made = hqp.solvers.load(given) if isinstance(given, str) else given
    for one in ABLATIONS:
        kept = one.figure(replace(PRICED, solver=made))
        with changed(one.change):
            other = made if one.eta is None else WithEta(made, one.eta)
            without = one.figure(replace(PRICED, solver=other))
        yield {"number": one.number, "other": one.other, "scene": one.scene, "kept": kept, "without": without}


def misses(records: Sequence[Record]) -> Iterator[str]:
    """Numbers without a scene that is worse by a tenth without them."""
    for number in dict.fromkeys(r["number"] for r in records):
        own = [r for r in records if r["number"] == number]
        if not any(r["without"] > 1.1 * r["kept"] + 1e-9 for r in own):
            yield f"{number}: no scene is worse without it"


def table(records: Sequence[Record]) -> str:
    """A row for each scene."""
    rows = [(r["number"], r["other"], r["scene"], f"{r['kept']:.3g}", f"{r['without']:.3g}") for r in records]
    return report.table(("number", "other value", "scene, smaller is better", "as it is", "with the other"), rows)
