"""The prioritised controller is a hierarchical least-squares problem in (qdd, tau, lambda): the table, case by case."""

from __future__ import annotations

from collections.abc import Callable, Iterator, Sequence

import numpy as np

import hqp
from benchmarks.reports.checks import Check, at_most, seen_to_fail
from benchmarks.sentis2012.equations.constraints import dynamics
from benchmarks.sentis2012.equations.ground import Ground, Snapshot, largest, relative
from benchmarks.sentis2012.equations.law import (
    Demand,
    compensated,
    orthogonal_projector,
    printed,
    prioritise,
    self_motion,
)
from benchmarks.sentis2012.equations.tasks import demands
from hqp import Hierarchy, Rows, Selection
from hqp.arrays import Mat, Vec
from hqp.solvers.base import Solver

SEED = 60
Case = Callable[[Snapshot], float]


def checks(ground: Ground, count: int) -> Iterator[Check]:
    """Every case on one slope at ``count`` random states of velocity norm one."""
    cases: list[tuple[str, Case]] = [
        ("(24)+(26) one task, Gauss: (qdd, tau, lambda)", lambda s: _full(s, demands(s)[1:2])),
        ("com > hand, Gauss: (qdd, tau, lambda)", lambda s: _full(s, demands(s)[:2])),
        ("com > hand > posture(9): (qdd, tau, lambda)", lambda s: _full(s, demands(s))),
        ("one task, Gauss: x = tau, metric phi*", lambda s: _reduced(s, demands(s)[1:2])),
        ("com > hand, Gauss: x = tau, metric phi*", lambda s: _reduced(s, demands(s)[:2])),
        ("com > hand > posture(9): x = tau, metric phi*", lambda s: _reduced(s, demands(s))),
        ("(27) with tau_0: last level |tau - tau_0| in phi*", _with_null_torque),
        ("hand > posture(12), erratum 9 corrected", _self_motion),
        ("condensed in qdd_act, metric phi*^-1 about -phi* h", _condensed),
        ("inactive torque bounds added", _bounded),
    ]
    found: list[list[float]] = [[] for _ in cases]
    nominal, own, shifted = [], [], []
    for s in ground.states(count, SEED):
        for (_, case), errors in zip(cases, found, strict=True):
            errors.append(case(s))
        nominal.append(_printed(s))
        own.append(_at_own_targets(s))
        shifted.append(_shifted(Snapshot(ground, s.q, 0.0 * s.v, s.rng)))
    for (text, _), errors in zip(cases, found, strict=True):
        yield at_most("S HQP", text, ground.label, 1e-8, errors, f"median {np.median(errors):.1e}")
    yield seen_to_fail(
        "S HQP erratum 18", "printed (57)-(59) at nominal targets, relative torque", ground.label, 1e-8, nominal
    )
    yield at_most("S HQP", "printed law vs HQP at its own accelerations", ground.label, 1e-8, own)
    yield at_most("S HQP", "printed law at rest vs HQP at shifted targets", ground.label, 1e-8, shifted)
    yield from _metrics(ground, count)


def lexicographic(levels: Sequence[tuple[Mat, Vec]], cut: float = 1e-11) -> Vec:
    """min ||A_0 x - b_0||, then the next in its null space, by SVD: independent of the library's solvers."""
    n = levels[0][0].shape[1]
    x, Z = np.zeros(n), np.eye(n)
    for A, b in levels:
        U, sizes, Vt = np.linalg.svd(A @ Z)
        rank = int(np.count_nonzero(sizes > cut * np.linalg.norm(A, 2)))
        x = x + Z @ (Vt[:rank].T @ ((U[:, :rank].T @ (b - A @ x)) / sizes[:rank]))
        Z = Z @ Vt[rank:].T
        if Z.shape[1] == 0:
            break
    return x


def _full(s: Snapshot, asked: Sequence[Demand]) -> float:
    """Level 0: eq. (2) and the constraints; then the tasks on qdd; last min (qdd - qdd_f)^T A (qdd - qdd_f)."""
    d = dynamics(s)
    nv, n, m = 19, 12, 7
    L = np.linalg.cholesky(s.A)
    # in y = L^T qdd eq. (2) is well scaled: y = L^-1 (U^T tau - J^T lambda - b - g)
    inverse = np.linalg.inv(L)
    motion = np.hstack((np.eye(nv), -inverse @ s.ground.U.T, inverse @ s.J.T))
    still = np.hstack((s.J @ inverse.T, np.zeros((m, n + m))))
    free = inverse @ -s.bias
    levels = [(np.vstack((motion, still)), np.concatenate((free, -s.dJ @ s.v)))]
    jacobians = {3: s.hand, 2: s.com, 9: s.posture}
    for task in asked:
        J, dJ = jacobians[task.a.size]
        levels.append((np.hstack((J @ inverse.T, np.zeros((task.a.size, n + m)))), task.a - dJ @ s.v))
    levels.append((np.hstack((np.eye(nv), np.zeros((nv, n + m)))), free))
    tau = lexicographic(levels)[nv : nv + n]
    paper = compensated(d.phi, d.h, asked, s.q_act)
    return relative(tau - paper, paper)


def hierarchy(phi: Mat, h: Vec, asked: Sequence[Demand], q_act: Vec, **extra: Vec) -> Hierarchy:
    """Levels J*_k phi* tau = a_k - dJ*_k q_act + J*_k phi* h with the metric phi*."""
    levels = []
    for task in asked:
        b = task.a - task.dJ @ q_act + task.J @ (phi @ h)
        levels.append(Rows(task.J @ phi, b, b))
    return Hierarchy(tuple(levels), metric=phi, **extra)  # type: ignore[arg-type]


def _solver() -> Solver:
    return hqp.solvers.load("nullspace")


def _reduced(s: Snapshot, asked: Sequence[Demand]) -> float:
    d = dynamics(s)
    paper = compensated(d.phi, d.h, asked, s.q_act)
    return relative(_solver().solve(hierarchy(d.phi, d.h, asked, s.q_act)).x - paper, paper)


def _with_null_torque(s: Snapshot) -> float:
    d, asked = dynamics(s), demands(s)[1:2]
    (step,) = prioritise(d.phi, [asked[0].J])
    tau_0 = 20.0 * s.rng.normal(size=12)
    paper = compensated(d.phi, d.h, asked, s.q_act) + step.N.T @ tau_0
    return relative(_solver().solve(hierarchy(d.phi, d.h, asked, s.q_act, origin=tau_0)).x - paper, paper)


def _self_motion(s: Snapshot) -> float:
    d, task = dynamics(s), demands(s)[1]
    v = s.rng.normal(size=12)
    paper, _ = self_motion(d.phi, d.h, task, v, s.q_act)
    posture = Demand(np.eye(12), np.zeros((12, 12)), v)
    return relative(_solver().solve(hierarchy(d.phi, d.h, [task, posture], s.q_act)).x - paper, paper)


def _condensed(s: Snapshot) -> float:
    d, asked = dynamics(s), demands(s)[:2]
    rows = tuple(Rows(t.J, b, b) for t in asked for b in (t.a - t.dJ @ s.q_act,))
    inverse = np.linalg.inv(d.phi)
    problem = Hierarchy(rows, metric=0.5 * (inverse + inverse.T), origin=-d.phi @ d.h)
    tau = inverse @ _solver().solve(problem).x + d.h
    paper = compensated(d.phi, d.h, asked, s.q_act)
    return relative(tau - paper, paper)


def _bounded(s: Snapshot) -> float:
    d, asked = dynamics(s), demands(s)
    paper = compensated(d.phi, d.h, asked, s.q_act)
    limit = np.full(12, 2.0 * largest(paper))
    plain = hierarchy(d.phi, d.h, asked, s.q_act)
    problem = Hierarchy((Rows(Selection(np.arange(12)), -limit, limit), *plain.levels), constraints=1, metric=d.phi)
    return relative(hqp.solvers.load("lexicographic").solve(problem).x - paper, paper)


def _printed(s: Snapshot) -> float:
    d, asked = dynamics(s), demands(s)
    g = dynamics(Snapshot(s.ground, s.q, 0.0 * s.v)).h
    best = _solver().solve(hierarchy(d.phi, d.h, asked, s.q_act)).x
    return relative(printed(d.phi, g, asked) - best, best)


def _at_own_targets(s: Snapshot) -> float:
    d, asked = dynamics(s), demands(s)
    g = dynamics(Snapshot(s.ground, s.q, 0.0 * s.v)).h
    paper = printed(d.phi, g, asked)
    qdd = d.phi @ (paper - d.h)
    own = [Demand(t.J, t.dJ, t.J @ qdd + t.dJ @ s.q_act) for t in asked]
    return relative(_solver().solve(hierarchy(d.phi, d.h, own, s.q_act)).x - paper, paper)


def _shifted(s: Snapshot) -> float:
    """At rest: a_h' = a_h + J_h Jbar_c a_c, a_p' = a_p + J_p (Jbar_c a_c + Jbar_h a_h)."""
    d, asked = dynamics(s), demands(s)
    com, hand, _ = prioritise(d.phi, [t.J for t in asked])
    given = com.Jbar @ asked[0].a
    moved = [
        asked[0],
        Demand(asked[1].J, asked[1].dJ, asked[1].a + asked[1].J @ given),
        Demand(asked[2].J, asked[2].dJ, asked[2].a + asked[2].J @ (given + hand.Jbar @ asked[1].a)),
    ]
    paper = printed(d.phi, d.h, asked)
    return relative(_solver().solve(hierarchy(d.phi, d.h, moved, s.q_act)).x - paper, paper)


def _metrics(ground: Ground, count: int) -> Iterator[Check]:
    """The paper's law equals Gauss' last level: least torque or least acceleration give another torque."""
    gauss, other = [], []
    for s in ground.states(count, SEED + 1):
        d, asked = dynamics(s), demands(s)[1:2]
        paper = compensated(d.phi, d.h, asked, s.q_act)
        tau = 20.0 * s.rng.normal(size=12)
        qdd, inverse = s.kkt(tau)[0], np.linalg.inv(s.A)
        bare, _ = s.kkt(np.zeros(12))
        apart, floor = qdd - inverse @ -s.bias, bare - inverse @ -s.bias
        gauss.append(abs(apart @ s.A @ apart - floor @ s.A @ floor - tau @ d.phi @ tau) / (tau @ d.phi @ tau))
        plain = hierarchy(d.phi, d.h, asked, s.q_act)
        other.append(relative(_solver().solve(Hierarchy(plain.levels)).x - paper, paper))
        Phi = orthogonal_projector(asked[0].J)
        gauss.append(largest(asked[0].J @ Phi))
    label = ground.label
    yield at_most("S HQP", "|qdd - qdd_f|_A^2 = const + tau^T phi* tau; J* Phi = 0", label, 1e-8, gauss)
    yield seen_to_fail("S HQP", "last level min |tau|^2 instead of Gauss, relative torque", label, 1e-8, other)
