"""Random hierarchies by family, to test solvers: ``FAMILIES[name](numpy.random.default_rng(seed))`` draws one.

Each family is hard in a way of its own; ``hqp.certificate`` judges the answers.
"""

from __future__ import annotations

from collections.abc import Callable

import numpy as np
from numpy.random import Generator

from hqp.arrays import Mat, Vec
from hqp.problem import Hierarchy, Rows, Selection

FAMILIES: dict[str, Callable[[Generator], Hierarchy]] = {}


def family(make: Callable[[Generator], Hierarchy]) -> Callable[[Generator], Hierarchy]:
    """Register a family under its function's name."""
    FAMILIES[make.__name__] = make
    return make


def equality(A: Mat | Selection, b: Vec) -> Rows:
    """The level A x = b."""
    return Rows(A, b, b)


def low_rank(rng: Generator, m: int, n: int, rank: int) -> Mat:
    """A random (m, n) of the given rank."""
    return rng.normal(size=(m, rank)) @ rng.normal(size=(rank, n))


def bounds(n: int, limit: float) -> Rows:
    """-limit <= x <= limit."""
    return Rows(Selection(np.arange(n)), np.full(n, -limit), np.full(n, limit))


def inequalities(rng: Generator, m: int, n: int) -> Rows:
    """Half-spaces, boxes and a left-out row, cutting where x is of order one."""
    A = rng.normal(size=(m, n))
    centre, width = rng.normal(size=m), rng.uniform(0.1, 2.0, size=m)
    lower, upper = centre - width, centre + width
    kind = rng.integers(0, 4, size=m)
    lower[(kind == 0) | (kind == 3)] = -np.inf
    upper[(kind == 1) | (kind == 3)] = np.inf
    return Rows(A, lower, upper)


@family
def random_equalities(rng: Generator) -> Hierarchy:
    n = int(rng.integers(4, 16))
    sizes = rng.integers(1, 6, size=rng.integers(1, 5))
    return Hierarchy(tuple(equality(rng.normal(size=(m, n)), rng.normal(size=m)) for m in sizes))


@family
def rank_deficient(rng: Generator) -> Hierarchy:
    n = int(rng.integers(5, 14))
    common = rng.normal(size=(2, n))
    levels = []
    for _ in range(4):
        m = int(rng.integers(2, 6))
        A = low_rank(rng, m, n, int(rng.integers(1, m + 1)))
        A[0] = rng.normal(size=2) @ common
        levels.append(equality(A, rng.normal(size=m)))
    return Hierarchy(tuple(levels))


@family
def conflicting(rng: Generator) -> Hierarchy:
    n = int(rng.integers(3, 8))
    A = rng.normal(size=(3, n))
    opposed = equality(np.vstack([A, A[0], -2.0 * A[1]]), rng.normal(size=5))
    return Hierarchy((equality(A, rng.normal(size=3)), opposed, equality(rng.normal(size=(2 * n, n)), np.ones(2 * n))))


@family
def duplicated_rows(rng: Generator) -> Hierarchy:
    n = 8
    A, b = rng.normal(size=(4, n)), rng.normal(size=4)
    twice = np.vstack([A, A])
    limits = Rows(np.vstack([A[:2], A[:2]]), np.full(4, -0.3), np.full(4, 0.3))
    return Hierarchy((limits, equality(twice, np.concatenate([b, b])), equality(twice[2:6], rng.normal(size=4))))


@family
def bounds_active(rng: Generator) -> Hierarchy:
    n = int(rng.integers(6, 20))
    levels = [bounds(n, 0.3)]
    levels += [equality(rng.normal(size=(m, n)), rng.normal(size=m)) for m in (3, 2, n)]
    return Hierarchy(tuple(levels), constraints=1)


@family
def middle_inequality(rng: Generator) -> Hierarchy:
    n = int(rng.integers(5, 12))
    return Hierarchy(
        (
            bounds(n, 2.0),
            equality(rng.normal(size=(2, n)), rng.normal(size=2)),
            inequalities(rng, 6, n),
            equality(rng.normal(size=(3, n)), 3.0 * rng.normal(size=3)),
            inequalities(rng, 4, n),
            equality(np.eye(n), rng.normal(size=n)),
        )
    )


@family
def mixed_levels(rng: Generator) -> Hierarchy:
    n = int(rng.integers(4, 10))
    levels = []
    for _ in range(4):
        rows, m = inequalities(rng, 3, n), int(rng.integers(1, 4))
        b = rng.normal(size=m)
        A = np.vstack([np.asarray(rows.A), low_rank(rng, m, n, max(1, m - 1))])
        levels.append(Rows(A, np.concatenate([rows.lower, b]), np.concatenate([rows.upper, b])))
    return Hierarchy(tuple(levels))


@family
def infeasible_constraints(rng: Generator) -> Hierarchy:
    n = 6
    A = rng.normal(size=(2, n))
    crossed = Rows(np.vstack([A, A]), np.array([1.0, 1.0, -np.inf, -np.inf]), np.array([np.inf, np.inf, 0.0, 0.0]))
    return Hierarchy((bounds(n, 0.5), crossed, equality(rng.normal(size=(n, n)), rng.normal(size=n))), constraints=2)


@family
def degenerate_vertex(rng: Generator) -> Hierarchy:
    n = 5
    corner = np.full(n, 0.5)
    A = rng.normal(size=(2 * n, n))
    A *= np.sign(A @ corner)[:, None]
    through = Rows(A, np.full(2 * n, -np.inf), A @ corner)  # more planes than variables meet in one point
    pull = rng.uniform(0.5, 3.0, size=2 * n) @ A
    return Hierarchy((through, equality(pull[None, :], np.array([100.0])), equality(np.eye(n), rng.normal(size=n))))


@family
def empty_level(rng: Generator) -> Hierarchy:
    n = 6
    nothing = equality(np.zeros((0, n)), np.zeros(0))
    left_out = Rows(rng.normal(size=(2, n)), np.full(2, -np.inf), np.full(2, np.inf))
    task = equality(rng.normal(size=(3, n)), rng.normal(size=3))
    return Hierarchy((nothing, task, nothing, left_out, equality(rng.normal(size=(2, n)), rng.normal(size=2)), nothing))


@family
def zero_rows(rng: Generator) -> Hierarchy:
    n = 5
    A = rng.normal(size=(3, n))
    A[1] = 0.0
    return Hierarchy((equality(A, np.ones(3)), equality(np.zeros((2, n)), np.ones(2)), equality(np.eye(n), np.ones(n))))


@family
def dynamics(rng: Generator) -> Hierarchy:
    """Accelerations in a box and forces without one, bound by equations; limits on both, most of them in the way."""
    base, joints, forces = 2, 6, 6
    n = base + joints + forces
    limited = Selection(np.arange(base, base + joints))
    M = rng.normal(size=(base + joints, base + joints))
    M = M @ M.T + np.eye(base + joints)
    J = rng.normal(size=(forces // 2, base + joints))
    both = np.hstack((M, -np.vstack((J, rng.normal(size=J.shape))).T))
    motion = equality(both[:base], rng.normal(size=base))
    contact = equality(np.hstack((J, np.zeros((len(J), forces)))), rng.normal(size=len(J)))
    torque, cone = both[base:], np.hstack((np.zeros((forces, base + joints)), rng.normal(size=(forces, forces))))
    limit = np.full(joints, rng.uniform(1.0, 20.0))
    top = [motion, contact, Rows(torque, -limit, limit), Rows(cone, np.full(forces, -np.inf), np.ones(forces))]
    physics = Rows(*(np.concatenate([getattr(part, name) for part in top]) for name in ("A", "lower", "upper")))
    tasks = [equality(10.0 * rng.normal(size=(m, n)), 100.0 * rng.normal(size=m)) for m in (3, 2)]
    box = Rows(limited, np.full(joints, -5.0), np.full(joints, 5.0))
    return Hierarchy((box, physics, *tasks, equality(np.eye(n), rng.normal(size=n))), constraints=2)


@family
def rows_of_rounding(rng: Generator) -> Hierarchy:
    """Rows that are zero up to rounding, with nonzero targets, as of a frame that no joint moves in some direction."""
    n = 6
    A = rng.normal(size=(4, n))
    A[rng.integers(0, 4)] = 3e-16 * rng.normal(size=n)
    still = equality(3e-16 * rng.normal(size=(2, n)), rng.normal(size=2))
    reach = equality(A, 3.0 * rng.normal(size=4))
    return Hierarchy(
        (bounds(n, 0.5), reach, still, equality(rng.normal(size=(3, n)), rng.normal(size=3))), constraints=1
    )


@family
def levels_of_rounding(rng: Generator) -> Hierarchy:
    n = 5
    A = rng.normal(size=(2, n))
    A[0] *= 1e-16
    still = equality(1e-16 * rng.normal(size=(2, n)), rng.normal(size=2))
    return Hierarchy((equality(A, rng.normal(size=2)), still, equality(rng.normal(size=(2, n)), rng.normal(size=2))))


@family
def one_variable(rng: Generator) -> Hierarchy:
    limit = Rows(np.array([[2.0]]), np.array([-1.0]), np.array([rng.uniform(0.1, 1.0)]))
    wish = equality(np.array([[1.0], [-1.0]]), rng.normal(size=2))
    return Hierarchy((limit, wish)) if rng.random() < 0.5 else Hierarchy((wish, limit))


@family
def scaled_levels(rng: Generator) -> Hierarchy:
    n = 10
    levels = []
    for k in range(4):
        scale = 10.0 ** rng.uniform(-3.0, 3.0)
        m = 3 if k < 3 else n
        levels.append(equality(scale * rng.normal(size=(m, n)), scale * rng.normal(size=m)))
    A, b = rng.normal(size=(5, n)), rng.uniform(0.1, 0.5, size=5)
    scale = 10.0 ** rng.uniform(-3.0, 3.0)
    levels.insert(1, Rows(scale * A, -scale * b, scale * b))
    return Hierarchy(tuple(levels))


@family
def scaled_equalities(rng: Generator) -> Hierarchy:
    n = 12
    levels = []
    for m in (4, 3, 4, 2):
        scale = 10.0 ** rng.uniform(-3.0, 3.0)
        levels.append(equality(scale * low_rank(rng, m, n, 2), scale * rng.normal(size=m)))
    return Hierarchy(tuple(levels))


@family
def with_metric(rng: Generator) -> Hierarchy:
    n = 8
    root = rng.normal(size=(n, n))
    levels = (bounds(n, 1.0), equality(rng.normal(size=(3, n)), rng.normal(size=3)))
    return Hierarchy(levels, metric=root @ root.T + 0.1 * np.eye(n), origin=rng.normal(size=n))


@family
def singular_metric(rng: Generator) -> Hierarchy:
    n = 9
    root = rng.normal(size=(n, 4))
    levels = (equality(rng.normal(size=(3, n)), rng.normal(size=3)),)
    return Hierarchy(levels, metric=root @ root.T, origin=rng.normal(size=n) if rng.random() < 0.5 else None)


@family
def with_origin(rng: Generator) -> Hierarchy:
    n = 7
    levels = (equality(low_rank(rng, 3, n, 2), rng.normal(size=3)),)
    return Hierarchy(levels, origin=rng.normal(size=n))


@family
def selections(rng: Generator) -> Hierarchy:
    n = 9
    some = rng.permutation(n)[:4]
    pinned = Rows(Selection(some, rng.uniform(0.5, 2.0, size=4)), np.full(4, 0.2), np.full(4, 0.2))
    wish = Rows(Selection(np.arange(n), rng.uniform(0.5, 2.0, size=n)), *(rng.normal(size=n),) * 2)
    return Hierarchy((bounds(n, 0.8), pinned, equality(rng.normal(size=(3, n)), rng.normal(size=3)), wish))


@family
def nothing_but_selections(rng: Generator) -> Hierarchy:
    n = 4
    return Hierarchy((bounds(n, 0.5), Rows(Selection(np.array([1, 3])), np.ones(2), np.ones(2))), n=n)


@family
def whole_body_size(rng: Generator) -> Hierarchy:
    n = 38
    feet = equality(low_rank(rng, 14, n, 12), 0.1 * rng.normal(size=14))
    hand = equality(rng.normal(size=(3, n)), rng.normal(size=3))
    posture = equality(np.eye(n)[6:], 0.3 * rng.normal(size=n - 6))
    return Hierarchy((bounds(n, 0.4), feet, hand, posture), constraints=1)
