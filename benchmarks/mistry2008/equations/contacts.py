"""Eqs. (7) to (11) and conditions 2 and 3: when contacts make a floating base's tasks controllable."""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass

import numpy as np
import pinocchio as pin

from benchmarks.mistry2008.equations.algebra import largest, pinv, projector, rank, right_inverse
from benchmarks.mistry2008.equations.levels import Evaluated, paper_levels, solve, states
from benchmarks.reports.checks import Check, at_most, exactly, seen_to_fail
from hqp import solvers
from hqp.arrays import Mat, Vec
from hqp.declare.element import Element
from hqp.errors import ProblemError
from hqp.floating_base import base_rank, base_velocity, generalized_velocity
from hqp.robots import Robot
from hqp.tasks import EdgeContact, FixedContact, PointContact, Position
from tests.scenes.mistry2008 import roles

SEED = 7


@dataclass(frozen=True)
class Case:
    """A contact situation of Figs. 3 and 4: places by kind, rank of J_C^xb, and whether condition 2 can hold."""

    text: str
    rank: int
    points: tuple[str, ...] = ()
    edges: tuple[str, ...] = ()
    faces: tuple[str, ...] = ()
    independent: bool = True

    def contacts(self) -> list[Element]:
        """The library's contacts, at frames named after the places."""
        return [
            *(PointContact(frame=place, name=f"point {place}") for place in self.points),
            *(EdgeContact(frame=place, axis="x", name=f"edge {place}") for place in self.edges),
            *(FixedContact(frame=place, name=f"face {place}") for place in self.faces),
        ]


_LEFT = ("left", "left along", "left across", "left corner")
_RIGHT = ("right", "right along", "right across", "right corner")

CASES = (
    Case("one point", 3, points=("left",)),
    Case("two points", 5, points=("left", "right across")),
    Case("one edge", 5, edges=("left",)),
    Case("two collinear edges", 5, edges=("left", "right on line")),
    Case("three collinear points", 5, points=("left", "right on line", "hand on line")),
    Case("edge and a point on its line", 5, edges=("left",), points=("right on line",)),
    Case("two parallel edges, offset", 6, edges=("left", "right parallel")),
    Case("two skew edges", 6, edges=("left", "right skew")),
    Case("three points", 6, points=("left", "right on line", "hand off line")),
    Case("edge and a point off its line", 6, edges=("left",), points=("right parallel",)),
    Case("one foot, 6 rows", 6, faces=("left",)),
    Case("one foot as three points, 9 rows", 6, points=_LEFT[:3], independent=False),
    Case("one foot as four corners, 12 rows", 6, points=_LEFT, independent=False),
    Case("two feet, 12 rows", 6, faces=("left", "right")),
    Case("two feet as eight corners, 24 rows", 6, points=(*_LEFT, *_RIGHT), independent=False),
)


def with_places(robot: Robot, q: Vec, rng: np.random.Generator) -> Robot:
    """The robot with frames that stand, at q, as the cases need them: on one line, beside it, skew to it."""
    model = robot.model.copy()
    names = roles(robot)
    state = robot.state(q)
    axes = np.linalg.qr(rng.standard_normal((3, 3)))[0]
    axes[:, 2] *= np.linalg.det(axes)  # x: the line's direction
    along, across = axes[:, 0], axes[:, 1]
    skewed = axes @ np.array([[0.6, 0.0, -0.8], [0.0, 1.0, 0.0], [0.8, 0.0, 0.6]])
    left, right = state.position(names.left), state.position(names.right)
    hand = state.position(names.hand)

    def add(name: str, body: str, point: Vec, rotation: Mat) -> None:
        frame = model.frames[model.getFrameId(body)]
        in_world = pin.SE3(rotation, point)
        robot.state(q).kinematics()
        local = robot.data.oMi[frame.parentJoint].actInv(in_world)
        model.addFrame(pin.Frame(name, frame.parentJoint, 0, local, pin.FrameType.OP_FRAME))

    for name, body, origin in (("left", names.left, left), ("right", names.right, right)):
        add(name, body, origin, axes)
        add(f"{name} along", body, origin + 0.2 * along, axes)
        add(f"{name} across", body, origin + 0.1 * across, axes)
        add(f"{name} corner", body, origin + 0.2 * along + 0.1 * across, axes)
    add("right on line", names.right, left + 0.3 * along, axes)
    add("right parallel", names.right, left + 0.3 * across, axes)
    add("right skew", names.right, left + 0.3 * across, skewed)
    add("hand on line", names.hand, left - 0.5 * along, axes)
    add("hand off line", names.hand, hand, axes)
    return Robot(model, name=robot.name, home=robot.home, landmarks=robot.landmarks)


def checks(robot: Robot, count: int) -> Iterator[Check]:
    """Every row on one robot at ``count`` random states."""
    yield from _inverse(robot, count)
    yield from _condition_three(robot, max(3, count // 4))
    yield from _base_from_joints(robot, count)


def _inverse(robot: Robot, count: int) -> Iterator[Check]:
    """Eqs. (7) to (9) through the solver `nullspace` on the one level [J_C; J]."""
    nullspace = solvers.load("nullspace")
    inverse, task, feet = [], [], []
    for levels in paper_levels(robot, count, SEED):
        A = np.concatenate((levels.J_C, levels.J_B))
        target = np.concatenate((np.zeros(12), levels.x_B))
        x = solve(nullspace, [(A, target)])
        inverse.append(largest(x - right_inverse(A) @ target) / (1.0 + largest(x)))
        inverse.append(largest(right_inverse(A) - pinv(A)) / (1.0 + largest(pinv(A))))
        task.append(largest(levels.J_B @ x - levels.x_B) / (1.0 + largest(x)))
        feet.append(largest(levels.J_C @ x) / (1.0 + largest(x)))
    yield at_most("M(7)", "the solver's inverse = right inverse = pinv by SVD, relative", robot.name, 1e-10, inverse)
    yield at_most("M(8)", "J qd = xd, relative", robot.name, 1e-11, task)
    yield at_most("M(9)", "J_C qd = 0, relative", robot.name, 1e-11, feet)


def _condition_three(robot: Robot, count: int) -> Iterator[Check]:
    rng = np.random.default_rng([SEED, 3])
    ranks: dict[str, list[int]] = {case.text: [] for case in CASES}
    smallest: dict[str, float] = {}
    refused, dependent, ambiguous, free, reached = [], [], [], [], []
    nullspace = solvers.load("nullspace")
    for q, v in states(robot, count, SEED):
        placed = with_places(robot, q, rng)
        unlike = 0
        for case in CASES:
            contacts = case.contacts()
            library = Evaluated(placed, [*contacts, Position(frame="hand off line", name="task")])
            *rows, J = library.at(q)
            J_C = np.concatenate(rows)
            ranks[case.text].append(base_rank(J_C))
            sigma = np.linalg.svd(J_C[:, :6], compute_uv=False)
            if case.rank == 6:
                smallest[case.text] = min(smallest.get(case.text, 1.0), sigma[5] / sigma[0])
            unlike += int(rank(J_C) < J_C.shape[0])
            refused.append(int(_refuses(J_C, v) != (case.rank < 6)))
            if not case.independent:
                target = rng.standard_normal(3)
                A = np.concatenate((J_C, J))
                x = solve(nullspace, [(A, np.concatenate((np.zeros(J_C.shape[0]), target)))])
                reached.append(max(largest(J @ x - target), largest(J_C @ x)) / (1.0 + largest(x)))
        dependent.append(unlike)
        two = Evaluated(
            placed, [*CASES[1].contacts(), Position(frame="left", name="on"), Position(frame="hand off line")]
        )
        first, second, on, off = two.at(q)
        motion = projector(np.concatenate((first, second))[:, :6])
        ambiguous.append(largest(on[:, :6] @ motion))
        free.append(largest(off[:, :6] @ motion))
    name = robot.name
    for case in CASES:
        note = f"smallest sigma_6/sigma_1 {smallest[case.text]:.1e}" if case.text in smallest else ""
        yield exactly("M cond 3", f"rank of the base block: {case.text}", name, case.rank, ranks[case.text], note)
    yield exactly("M cond 3", "base_velocity refuses exactly the under-constrained cases", name, 0, refused)
    yield exactly("M cond 2", "cases of 15 whose J_C has dependent rows (condition 2 fails)", name, 3, dependent)
    yield at_most("M cond 2", "in these the task is reached all the same (M5), relative", name, 1e-11, reached)
    text = "two points: a task point on their line is determined though the rank is 5 (M6)"
    yield at_most("M cond 3", text, name, 1e-12, ambiguous)
    yield seen_to_fail("M cond 3", "two points: a task point off their line", name, 1e-12, free)


def _refuses(J_C: Mat, v: Vec) -> bool:
    try:
        base_velocity(J_C, v[6:])
    except ProblemError:
        return True
    return False


def _base_from_joints(robot: Robot, count: int) -> Iterator[Check]:
    """Eqs. (10), (11) read as a vertical stack (M4); with k > 6 only joints in the closed chains' subspace count."""
    rng = np.random.default_rng([SEED, 11])
    one, both, arbitrary = [], [], []
    for levels in paper_levels(robot, count, SEED + 1):
        foot, feet = levels.J_C[:6], levels.J_C
        joints = rng.standard_normal(robot.nv - 6)
        one.append(largest(foot @ generalized_velocity(foot, joints)))
        consistent = projector(feet) @ rng.standard_normal(robot.nv)
        both.append(largest(generalized_velocity(feet, consistent[6:]) - consistent))
        arbitrary.append(largest(feet @ generalized_velocity(feet, joints)))
    name = robot.name
    yield at_most("M(10),(11)", "one foot: J_C [-J_Cb^+ J_Cr; I] qd_r = 0 for any qd_r", name, 1e-11, one)
    yield at_most("M(10),(11)", "two feet: qd rebuilt from its joint part", name, 1e-11, both)
    yield seen_to_fail("M(11)", "two feet and qd_r outside the closed chains", name, 1e-11, arbitrary, "erratum M4")
