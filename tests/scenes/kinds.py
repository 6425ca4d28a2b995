"""Kinds of random hierarchies on which active sets have failed: scales, near-parallel rows, vertices, sequences.

A kind is a function of a random generator that returns a sequence of problems of one shape, to be solved in order in
one workspace; most are of length one.
"""

from __future__ import annotations

import zlib
from collections.abc import Callable

import numpy as np
from numpy.random import Generator

from hqp import Hierarchy, Rows, Selection
from hqp.arrays import Mat, Vec
from hqp.lab.problem_families import FAMILIES
from tests.scenes import random_hierarchies

Kind = Callable[[Generator], list[Hierarchy]]
KINDS: dict[str, Kind] = {}


def kind(make: Kind) -> Kind:
    """Register a kind under its function's name."""
    KINDS[make.__name__] = make
    return make


def rows(A: Mat, b: Vec, rng: Generator, share: float) -> Rows:
    """A x = b, a share of the rows one- or two-sided instead."""
    m = len(b)
    lower, upper, draw = b.copy(), b.copy(), rng.random(m)
    loose = draw < share
    side = rng.integers(0, 3, size=m)
    lower[loose & (side == 0)] = -np.inf
    upper[loose & (side == 1)] = np.inf
    both = loose & (side == 2)
    upper[both] += rng.uniform(0.0, 2.0, size=int(both.sum()))
    return Rows(A, lower, upper)


def box(rng: Generator, n: int) -> Rows:
    """Two-sided bounds on some variables, sometimes with a corner at zero."""
    index = np.sort(rng.permutation(n)[: rng.integers(1, n + 1)])
    limit = rng.uniform(0.1, 2.0, size=index.size)
    lower = np.where(rng.random(index.size) < 0.2, 0.0, -limit)
    return Rows(Selection(index), lower, limit)


def finish(rng: Generator, n: int, levels: list[Rows]) -> Hierarchy:
    """The levels, some with a posture, a metric or an origin."""
    if rng.random() < 0.4:
        target = rng.normal(size=n)
        levels = [*levels, Rows(np.eye(n), target, target)]
    metric = origin = None
    if rng.random() < 0.1:
        root = rng.normal(size=(n, int(rng.integers(1, n + 1))))
        metric = root @ root.T
        metric = (metric + metric.T) / 2.0
    if rng.random() < 0.1:
        origin = rng.normal(size=n)
    return Hierarchy(tuple(levels), int(rng.integers(0, len(levels) + 1)), metric, origin)


@kind
def plain(rng: Generator) -> list[Hierarchy]:
    """Full-rank levels of ordinary scale."""
    n = int(rng.integers(1, 30))
    levels = [box(rng, n)] if rng.random() < 0.5 else []
    for _ in range(int(rng.integers(1, 6))):
        m = int(rng.integers(1, max(2, n // 2)))
        levels.append(rows(rng.normal(size=(m, n)), rng.normal(size=m), rng, float(rng.choice([0.0, 0.5, 1.0]))))
    return [finish(rng, n, levels)]


@kind
def near_parallel(rng: Generator) -> list[Hierarchy]:
    """Rows that repeat earlier ones up to 1e-3 to 1e-12."""
    n = int(rng.integers(2, 12))
    levels, seen = [], rng.normal(size=(1, n))
    for _ in range(int(rng.integers(2, 6))):
        m = int(rng.integers(1, 5))
        A = rng.normal(size=(m, n))
        for i in range(m):
            if rng.random() < 0.6:
                A[i] = rng.choice([-1.0, 1.0, 0.5]) * seen[rng.integers(len(seen))]
                A[i] += 10.0 ** rng.uniform(-12.0, -3.0) * rng.normal(size=n)
        seen = np.vstack([seen, A])
        levels.append(rows(A, rng.normal(size=m), rng, float(rng.choice([0.0, 0.5, 1.0]))))
    return [finish(rng, n, levels)]


@kind
def row_scales(rng: Generator) -> list[Hierarchy]:
    """Rows of one level with norms that differ by up to 1e12."""
    n = int(rng.integers(2, 15))
    levels = [box(rng, n)] if rng.random() < 0.4 else []
    for _ in range(int(rng.integers(1, 5))):
        m = int(rng.integers(1, 6))
        scale = 10.0 ** rng.uniform(-6.0, 6.0, size=m)
        A, b = rng.normal(size=(m, n)), rng.normal(size=m)
        levels.append(rows(scale[:, None] * A, scale * b, rng, float(rng.choice([0.0, 0.5, 1.0]))))
    return [finish(rng, n, levels)]


@kind
def zero_rows(rng: Generator) -> list[Hierarchy]:
    """Zero rows among rows of one level with norms that differ by up to 1e12; all goals can be met."""
    n, levels = int(rng.integers(2, 9)), []
    for _ in range(int(rng.integers(1, 5))):
        m = int(rng.integers(2, 7))
        A = rng.normal(size=(m, n)) * 10.0 ** rng.uniform(-6.0, 6.0, size=(m, 1))
        b = A @ rng.normal(size=n) * float(rng.choice([0.0, 1.0, 1.0]))
        none = rng.random(m) < 0.3
        A[none], b[none] = 0.0, rng.choice([0.0, 1e-3, 1.0], size=int(none.sum()))
        levels.append(rows(A, b, rng, float(rng.choice([0.0, 0.5, 1.0]))))
    return [finish(rng, n, levels)]


@kind
def level_scales(rng: Generator) -> list[Hierarchy]:
    """Levels with norms that differ by up to 1e12."""
    n = int(rng.integers(2, 15))
    levels = [box(rng, n)] if rng.random() < 0.4 else []
    for _ in range(int(rng.integers(1, 6))):
        m = int(rng.integers(1, 6))
        scale = 10.0 ** rng.uniform(-6.0, 6.0)
        A, b = rng.normal(size=(m, n)), rng.normal(size=m)
        levels.append(rows(scale * A, scale * b, rng, float(rng.choice([0.0, 0.5, 1.0]))))
    return [finish(rng, n, levels)]


@kind
def vertex(rng: Generator) -> list[Hierarchy]:
    """More constraints through one point than variables, the levels below pulling beyond it; solved twice."""
    n = int(rng.integers(2, 15))
    corner = rng.normal(size=n) if rng.random() < 0.7 else np.zeros(n)
    levels = []
    for _ in range(int(rng.integers(1, 3))):
        m = int(rng.integers(n, 3 * n + 1))
        A = rng.normal(size=(m, n)) if rng.random() < 0.6 else rng.integers(-2, 3, size=(m, n)).astype(float)
        levels.append(Rows(A, np.full(m, -np.inf), A @ corner))
    for _ in range(int(rng.integers(1, 4))):
        m = int(rng.integers(1, n + 1))
        A = rng.normal(size=(m, n))
        b = A @ corner if rng.random() < 0.2 else 3.0 * rng.normal(size=m)
        levels.append(rows(A, b, rng, float(rng.choice([0.0, 0.3, 1.0]))))
    return [finish(rng, n, levels)] * 2


@kind
def cone_apex(rng: Generator) -> list[Hierarchy]:
    """Contact forces in friction pyramids pulled out at the apex, equations of motion among them; drifting targets."""
    contacts, motion = int(rng.integers(1, 7)), int(rng.integers(3, 12))
    n = motion + 3 * contacts
    friction = rng.uniform(0.2, 1.0)
    cone = np.zeros((5 * contacts, n))
    for c in range(contacts):
        at = motion + 3 * c
        for i, (sx, sy) in enumerate(((1, 0), (-1, 0), (0, 1), (0, -1))):
            cone[5 * c + i, at : at + 3] = sx, sy, -friction
        cone[5 * c + 4, at + 2] = -1.0
    J = rng.normal(size=(motion, 3 * contacts))
    M = rng.normal(size=(motion, motion))
    base = min(6, motion)
    dynamics = np.hstack((M @ M.T + np.eye(motion), -J))[:base]
    task = np.hstack((rng.normal(size=(3, motion)), np.zeros((3, 3 * contacts))))
    limits = np.hstack((M @ M.T + np.eye(motion), -J))[base:]
    load, wish = rng.normal(size=base) * 5.0, 10.0 * rng.normal(size=3)
    drift, made = 0.01 * rng.normal(size=base), []
    for tick in range(3):
        b = load + tick * drift
        physics = Rows(
            np.vstack((dynamics, cone, limits)),
            np.concatenate((b, np.full(len(cone), -np.inf), np.full(len(limits), -8.0))),
            np.concatenate((b, np.zeros(len(cone)), np.full(len(limits), 8.0))),
        )
        made.append(
            Hierarchy((physics, Rows(task, wish, wish), Rows(np.eye(n), np.zeros(n), np.zeros(n))), constraints=1)
        )
    return made


@kind
def integers(rng: Generator) -> list[Hierarchy]:
    """Small integers everywhere: exact ties, dependent rows, degenerate vertices."""
    n = int(rng.integers(1, 10))
    levels = [Rows(Selection(np.arange(n)), np.full(n, -1.0), np.full(n, 1.0))] if rng.random() < 0.5 else []
    for _ in range(int(rng.integers(1, 6))):
        m = int(rng.integers(1, 8))
        A, b = rng.integers(-2, 3, size=(m, n)).astype(float), rng.integers(-2, 3, size=m).astype(float)
        levels.append(rows(A, b, rng, float(rng.choice([0.0, 0.5, 1.0]))))
    return [finish(rng, n, levels)] * 2


@kind
def duplicates(rng: Generator) -> list[Hierarchy]:
    """Duplicate rows, in one level and the next, at the same or another bound, or with the opposite sign."""
    n = int(rng.integers(1, 12))
    pool = rng.normal(size=(int(rng.integers(1, 8)), n))
    levels = [box(rng, n)] if rng.random() < 0.5 else []
    for _ in range(int(rng.integers(2, 6))):
        pick = rng.integers(0, len(pool), size=int(rng.integers(1, 8)))
        A = pool[pick] * rng.choice([-1.0, 1.0, 2.0], size=(pick.size, 1))
        b = A @ np.ones(n) if rng.random() < 0.5 else rng.normal(size=pick.size)
        levels.append(rows(A, b, rng, float(rng.choice([0.0, 0.5, 1.0]))))
    return [finish(rng, n, levels)]


@kind
def conflicts(rng: Generator) -> list[Hierarchy]:
    """Levels that contradict one another under bounds, singular by small singular values."""
    n = int(rng.integers(3, 14))
    levels = [box(rng, n)]
    first = rng.normal(size=(int(rng.integers(1, 4)), n))
    for k in range(int(rng.integers(2, 6))):
        A = first if k % 2 == 0 else rng.normal(size=(int(rng.integers(1, 4)), n))
        if rng.random() < 0.4:
            U, s, V = np.linalg.svd(A, full_matrices=False)
            s[-1] *= 10.0 ** rng.uniform(-10.0, 0.0)
            A = (U * s) @ V
        levels.append(rows(A.copy(), 3.0 * rng.normal(size=len(A)), rng, float(rng.choice([0.0, 0.5]))))
    return [finish(rng, n, levels)]


@kind
def many_levels(rng: Generator) -> list[Hierarchy]:
    """Up to 20 levels, empty ones and rows left out among them."""
    n = int(rng.integers(2, 40))
    levels = [box(rng, n)] if rng.random() < 0.5 else []
    for _ in range(int(rng.integers(5, 20))):
        m = int(rng.integers(0, 4))
        level = rows(rng.normal(size=(m, n)), rng.normal(size=m), rng, float(rng.choice([0.0, 0.5])))
        if m and rng.random() < 0.1:
            level.lower[0], level.upper[0] = -np.inf, np.inf
        levels.append(level)
    return [finish(rng, n, levels)]


@kind
def large(rng: Generator) -> list[Hierarchy]:
    """Up to 200 variables."""
    n = int(rng.integers(40, 201))
    levels = [box(rng, n)]
    for _ in range(int(rng.integers(1, 5))):
        m = int(rng.integers(1, 40))
        levels.append(rows(rng.normal(size=(m, n)), rng.normal(size=m), rng, float(rng.choice([0.0, 0.3]))))
    return [finish(rng, n, levels)]


@kind
def tiny(rng: Generator) -> list[Hierarchy]:
    """At most four variables, few rows: also judged by enumeration."""
    n = int(rng.integers(1, 5))
    levels = []
    for _ in range(int(rng.integers(1, 4))):
        m = int(rng.integers(1, 4))
        A = rng.normal(size=(m, n)) if rng.random() < 0.5 else rng.integers(-2, 3, size=(m, n)).astype(float)
        levels.append(rows(A, rng.normal(size=m), rng, float(rng.choice([0.3, 1.0]))))
    return [Hierarchy(tuple(levels))]


@kind
def sequence(rng: Generator) -> list[Hierarchy]:
    """A whole-body stack with rows and targets that drift, as in a control loop, under bounds."""
    n = int(rng.integers(6, 25))
    sizes = [int(rng.integers(1, 5)) for _ in range(int(rng.integers(2, 5)))]
    A = [rng.normal(size=(m, n)) for m in sizes]
    b = [3.0 * rng.normal(size=m) for m in sizes]
    speed = 10.0 ** rng.uniform(-4.0, -1.0)
    turn, pull = [rng.normal(size=a.shape) for a in A], [rng.normal(size=m) for m in sizes]
    limit = rng.uniform(0.2, 1.0, size=n)
    share = float(rng.choice([0.0, 0.5]))
    pattern = [rng.random(m) < share for m in sizes]
    made = []
    for tick in range(6):
        levels = [Rows(Selection(np.arange(n)), -limit, limit)]
        for a, d, c, p, loose in zip(A, turn, b, pull, pattern, strict=True):
            target = c + tick * speed * p
            levels.append(Rows(a + tick * speed * d, np.where(loose, -np.inf, target), target))
        levels.append(Rows(Selection(np.arange(n)), np.zeros(n), np.zeros(n)))
        made.append(Hierarchy(tuple(levels), constraints=1))
    return made


@kind
def families(rng: Generator) -> list[Hierarchy]:
    """One of the families of the conformance suite."""
    return [FAMILIES[list(FAMILIES)[rng.integers(len(FAMILIES))]](rng)]


@kind
def mixture(rng: Generator) -> list[Hierarchy]:
    """One of tests.scenes.random_hierarchies."""
    return [random_hierarchies.hierarchy(int(rng.integers(2**31)), largest=60)]


def problem(kind: str, seed: int) -> list[Hierarchy]:
    """The sequence of problems that a kind makes of a seed."""
    return KINDS[kind](np.random.default_rng([zlib.crc32(kind.encode()), seed]))
