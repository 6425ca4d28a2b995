"""Eqs. (16) to (27) and (45) to (62): tasks, their dynamics, and the prioritised controller."""

from __future__ import annotations

from collections.abc import Iterator

import numpy as np

from benchmarks.reports.checks import Check, at_most, exactly, seen_to_fail
from benchmarks.sentis2012.equations.constraints import STEP, dynamics
from benchmarks.sentis2012.equations.ground import Ground, Snapshot, largest, pinv, relative
from benchmarks.sentis2012.equations.law import Demand, compensated, printed, prioritise
from hqp.arrays import Mat, Vec

SEED = 48


def checks(ground: Ground, count: int) -> Iterator[Check]:
    """Every row on one slope at ``count`` random states."""
    yield from _kinematics(ground, count)
    yield from _single(ground, count)
    yield from _null_space(ground, count)
    yield from _skill_jacobians(ground, count)
    yield from _priorities(ground, count)
    yield from _feedback(ground, count)


def demands(s: Snapshot, size: float = 1.0) -> list[Demand]:
    """Balance, hand and posture of eq. (48) with random accelerations."""
    found = []
    for J, dJ in (s.com, s.hand, s.posture):
        J_star, dJ_star = s.star(J, dJ)
        found.append(Demand(J_star, dJ_star, size * s.rng.normal(size=J.shape[0])))
    return found


def _stacked(s: Snapshot) -> tuple[Mat, Mat]:
    return np.vstack((s.com[0], s.hand[0])), np.vstack((s.com[1], s.hand[1]))


def _kinematics(ground: Ground, count: int) -> Iterator[Check]:
    differences = []
    for s in ground.states(count, SEED):
        ahead, behind = s.at(s.v, STEP), s.at(s.v, -STEP)
        dJ_star = s.star(*_stacked(s))[1]
        found = (ahead.star(*_stacked(ahead))[0] - behind.star(*_stacked(behind))[0]) / (2.0 * STEP)
        differences.append(largest(found - dJ_star))
    yield at_most("S(16)-(20)", "dJ*/dt vs differences", ground.label, 1e-6, differences)


def _single(ground: Ground, count: int) -> Iterator[Check]:
    moving, reached, starless = [], [], []
    for s in ground.states(count, SEED):
        d = dynamics(s)
        phi, h = d.phi, d.h
        g = _gravity(s)
        for J, dJ in (s.hand, s.com, _stacked(s)):
            J_star, dJ_star = s.star(J, dJ)
            Lambda = np.linalg.inv(J_star @ phi @ J_star.T)
            Jbar = phi @ J_star.T @ Lambda
            mu, p = Jbar.T @ (h - g) - Lambda @ (dJ_star @ s.q_act), Jbar.T @ g
            tau = 20.0 * s.rng.normal(size=12)
            xdd = J @ s.kkt(tau)[0] + dJ @ s.v
            moving.append(relative(Lambda @ xdd + mu + p - Jbar.T @ tau, Jbar.T @ tau))
            starless.append(largest(J_star @ (phi @ J_star.T) - np.eye(J.shape[0])))
            a = s.rng.normal(size=J.shape[0])
            F = Lambda @ a + mu + p
            reached.append(largest(J @ s.kkt(J_star.T @ F)[0] + dJ @ s.v - a))
    text = "Lambda* xdd + mu* + p* = Jbar*^T tau with xdd of KKT, relative; hand, com, both"
    yield at_most("S(23)", text, ground.label, 1e-9, moving)
    yield at_most("S(24)-(26)", "xdd = a_ref in KKT forward dynamics; hand, com, both", ground.label, 1e-8, reached)
    yield seen_to_fail("S(23) erratum 6", "Jbar without the inertia: J* Jbar = I", ground.label, 1e-9, starless)


def _gravity(s: Snapshot) -> Vec:
    """g*: b* + g* at rest."""
    return dynamics(Snapshot(s.ground, s.q, 0.0 * s.v)).h


def _null_space(ground: Ground, count: int) -> Iterator[Check]:
    unchanged, square, zero, euclidean = [], [], [], []
    for s in ground.states(count, SEED):
        d = dynamics(s)
        J, dJ = s.hand
        (step,) = prioritise(d.phi, [s.star(J, dJ)[0]])
        N, base = step.N, 20.0 * s.rng.normal(size=12)
        posture = 20.0 * s.rng.normal(size=12)

        def xdd(tau: Vec, s: Snapshot = s, J: Mat = J, dJ: Mat = dJ) -> Vec:
            return np.asarray(J @ s.kkt(tau)[0] + dJ @ s.v)

        unchanged.append(largest(xdd(base + N.T @ posture) - xdd(base)))
        square.append(largest(N @ N - N))
        zero.append(largest(step.J @ d.phi @ N.T))
        plain = np.eye(12) - pinv(step.J) @ step.J
        euclidean.append(largest(xdd(base + plain @ posture) - xdd(base)))
    label = ground.label
    yield at_most("S(27)", "xdd of the hand unchanged by N*^T tau [m/s^2]", label, 1e-8, unchanged)
    yield at_most("S(27)", "N*^2 = N*", label, 1e-9, square)
    yield at_most("S(27)", "J* phi* N*^T = 0", label, 1e-9, zero)
    yield seen_to_fail("S(27)", "Euclidean projector instead [m/s^2]", label, 1e-8, euclidean)


def _skill_jacobians(ground: Ground, count: int) -> Iterator[Check]:
    hand, com, scaled, chain, travel = [], [], [], [], []
    robot = ground.robot
    for s in ground.free_states(count, SEED):
        for column, e in enumerate(np.eye(robot.nv)):
            ahead, behind = s.at(e, STEP), s.at(e, -STEP)
            hand.append(largest((ahead.frame("hand")[0] - behind.frame("hand")[0]) / (2 * STEP) - s.hand[0][:, column]))
            centre = (ahead.upper_body()[0] - behind.upper_body()[0])[:2] / (2 * STEP)
            com.append(largest(centre - s.com[0][:, column]))
        c, J, _, mass = s.upper_body()
        state = robot.state(s.q, s.v)
        part = robot.subtree("torso_yaw")
        scaled += [largest(state.com(part) - c), largest(state.com_jacobian(part) - J)]
        p, R = np.zeros(3), np.eye(3)
        for joint in robot.model.supports[robot.model.frames[robot.frame("hand")].parentJoint]:
            p, R = p + R @ s.data.liMi[joint].translation, R @ s.data.liMi[joint].rotation
        p = p + R @ robot.model.frames[robot.frame("hand")].placement.translation
        chain.append(largest(p - s.frame("hand")[0]))
        turn = s.frame("base")[1].T  # base velocities for one metre a second along world x, y, z
        travel.append(largest((mass / robot.mass) * J[:, :3] @ turn - np.eye(3)))
    label = ground.label
    yield at_most("S(47)", "J_hand vs differences, every column", label, 1e-7, hand)
    yield at_most("S(46)", "J_com, upper body over its own mass, vs differences", label, 1e-7, com)
    yield at_most("S(46)", "the library's subtree centre and Jacobian vs the sum", label, 1e-12, scaled)
    yield at_most("S(47) erratum 15", "product of iT(i+1) from the world to the hand", label, 1e-12, chain)
    text = "sum over the upper body / total mass: metres missed per metre of travel"
    yield seen_to_fail("S(45) erratum 13", text, label, 1e-7, travel)


def _priorities(ground: Ground, count: int) -> Iterator[Check]:
    stacked, crossed, ranks, literal = [], [], [], []
    for s in ground.states(count, SEED):
        phi = dynamics(s).phi
        stars = [s.star(*pair)[0] for pair in (s.com, s.hand, s.posture)]
        com, hand, posture = prioritise(phi, stars)
        (both,) = prioritise(phi, [np.vstack(stars[:2])])
        stacked.append(largest(hand.N - both.N))
        crossed += [largest(hand.J @ com.Jbar), largest(com.J @ hand.Jbar), largest(stars[0] @ hand.N)]
        sizes = np.linalg.eigvalsh(posture.J @ phi @ posture.J.T)
        ranks.append(int(np.count_nonzero(sizes > 1e-9 * sizes.max())))
        whole = phi @ stars[1].T @ np.linalg.inv(stars[1] @ phi @ stars[1].T)
        literal.append(largest(stars[0] @ (np.eye(12) - whole @ stars[1] - com.Jbar @ com.J)))
    label = ground.label
    yield at_most("S(49)-(53)", "N_hand,com = projector of the stacked tasks", label, 1e-8, stacked)
    yield at_most("S(49)-(53)", "cross terms, J_com N_hand,com = 0", label, 1e-8, crossed)
    yield seen_to_fail("S(53) erratum 17", "Jbar_hand of the unprioritised J*_hand: J_com N = 0", label, 1e-8, literal)
    yield exactly("S(51)", "rank of the prioritised posture", label, 7, ranks)


def _feedback(ground: Ground, count: int) -> Iterator[Check]:
    held, loose = [], []
    resting, shifted = [], []
    errors: list[list[float]] = [[], [], []]
    uncoupled: list[list[float]] = [[], [], []]
    for s in ground.states(count, SEED):
        still = Snapshot(ground, s.q, 0.0 * s.v, s.rng)
        d = dynamics(still)
        phi, g = d.phi.copy(), d.h
        zero = [Demand(t.J, t.dJ, 0.0 * t.a) for t in demands(still)]
        qdd = still.kkt(printed(phi, g, zero))[0]
        held.append(largest(qdd))
        steps = prioritise(phi, [t.J for t in zero])
        hand_whole = phi @ zero[1].J.T @ np.linalg.inv(zero[1].J @ phi @ zero[1].J.T)
        tau = sum(step.J.T @ (step.Jbar.T @ g) for step in (steps[0], steps[2]))
        loose.append(largest(ground.U @ still.kkt(tau + steps[1].J.T @ (hand_whole.T @ g))[0]))
        asked = demands(still)
        qdd = ground.U @ still.kkt(printed(phi, g, asked))[0]
        resting.append(largest(asked[0].J @ qdd - asked[0].a))
        given = steps[0].Jbar @ asked[0].a
        shifted.append(largest(asked[1].J @ qdd - asked[1].a - asked[1].J @ given))
        asked = demands(s)
        d = dynamics(s)
        for law, found in ((compensated(d.phi, d.h, asked, s.q_act), errors), (printed(d.phi, g, asked), uncoupled)):
            _follow(s, law, asked, d.phi, found)
    label = ground.label
    yield at_most("S(57)-(59)", "gravity only, p_k = Jbar_k|^T g*: no acceleration", label, 1e-8, held)
    yield seen_to_fail("S(58)", "p_hand of the unprioritised task: accelerates", label, 1e-8, loose)
    yield at_most("S(60) erratum 18", "at rest, as printed: com as asked", label, 1e-8, resting)
    yield at_most(
        "S(61) erratum 18", "at rest, as printed: hand off by J* Jbar_com a_com exactly", label, 1e-8, shifted
    )
    names = ("S(60) compensated, com", "S(61) compensated, hand", "S(62) compensated, posture in its free directions")
    for name, found in zip(names, errors, strict=True):
        yield at_most(name.split(" ")[0], name.split(" ", 1)[1], label, 1e-8, found)
    names = ("S(57) com", "S(58) hand", "S(59) posture")
    for name, found in zip(names, uncoupled, strict=True):
        text = f"as printed, {name.split(' ')[1]} off by [m/s^2, rad/s^2]"
        yield seen_to_fail(f"{name.split(' ')[0]} erratum 18", text, label, 1e-8, found)


def _follow(s: Snapshot, tau: Vec, asked: list[Demand], phi: Mat, found: list[list[float]]) -> None:
    """Deviation of each task from its demand in KKT forward dynamics, for the posture in its free directions."""
    qdd = s.ground.U @ s.kkt(tau)[0]
    posture = prioritise(phi, [t.J for t in asked])[2]
    values, vectors = np.linalg.eigh(posture.J @ phi @ posture.J.T)
    free = vectors[:, values > 1e-9 * values.max()]
    for k, task in enumerate(asked):
        off = task.J @ qdd + task.dJ @ s.q_act - task.a
        found[k].append(largest(free.T @ off) if k == 2 else largest(off))
