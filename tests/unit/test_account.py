"""Accounts: provoke each cause, compare the kernel's account with the explanation, measure the effect of a price."""

from __future__ import annotations

import math
import pickle
from pathlib import Path
from types import SimpleNamespace
from typing import Any

import numpy as np
import pytest

import hqp
from hqp import PD, Hierarchy, Level, P, Rows, Solution, Stack, Status
from hqp.errors import DeclarationError, HqpError
from hqp.explanation.account import Layout, TickAccount
from hqp.explanation.multipliers import explain
from hqp.explanation.questions import Teller
from hqp.explanation.words import PRICE, Short
from hqp.programs.formulation import Place
from hqp.robots import Robot
from hqp.tasks import Com, FixedContact, JointLimits, Orientation, PointContact, Position, Posture, TorqueLimits
from hqp.tolerances import ZERO_RESIDUAL
from hqp.viewer.account import element_view

DT = 0.002


def humanoid(name: str, formulation: Any, price: Any = None) -> tuple[Robot, hqp.Session, Position]:
    robot = hqp.robots.load(name)
    hand = Position(frame=robot.landmarks["palms"][1], name="hand")
    limits = [TorqueLimits()] if isinstance(formulation, hqp.Torque) else []
    stack = Stack(
        Level(Com(name="com")),
        Level(hand),
        Level(Orientation(frame=robot.landmarks["base"][0], name="trunk")),
        Level(Posture()),
        subject_to=[*(FixedContact(frame=f) for f in robot.landmarks["soles"]), *limits, JointLimits()],
    )
    return robot, hqp.Controller(stack, formulation, deadline=math.inf, price=price).session(robot, DT), hand


def arm(name: str = "ur5", **fields: Any) -> tuple[Robot, hqp.Session, Position]:
    robot = hqp.robots.load(name)
    hand = Position(frame=robot.frame_names[-1], name="hand", law=P(5.0))
    stack = Stack(Level(hand), Level(Posture()), subject_to=[JointLimits()])
    return robot, hqp.Controller(stack, deadline=math.inf, **fields).session(robot, DT), hand


def drive(robot: Robot, run: hqp.Session, hand: Position, ahead: Any, ticks: int) -> hqp.Tick:
    q, v = robot.home.copy(), np.zeros(robot.nv)
    goal = robot.state(q, v).position(hand.frame) + ahead
    for _ in range(ticks):
        q, v = run.step(robot.state(q, v), hand.at(goal)).advance()
    return run.step(robot.state(q, v), hand.at(goal))


def both(tick: hqp.Tick, element: str) -> tuple[str, str]:
    return tick.explain()[element].cause, tick.account().cause(element)


@pytest.mark.parametrize(("times", "met"), [(0.99, True), (1.01, False)])
def test_a_residual_is_zero_to_all_or_to_none(times: float, met: bool) -> None:
    """Compare account, notes, explanation and viewer of one row near ZERO_RESIDUAL."""
    asked = 1e-6
    residual = times * ZERO_RESIDUAL * (1.0 + asked)
    layout = Layout(("hand",), (0,), (False,), 1, np.ones(1))
    account = TickAccount(0, layout, np.array([residual, asked, 1.0, 1.0, 0.0, 1.0, 1.0]))
    assert account.met("hand") is met
    assert bool(list(account.priced())) is not met
    bound, x = np.array([asked]), np.array([asked - residual])
    problem = Hierarchy((Rows(np.eye(1), bound, bound),))
    solution = Solution(x, Status.OPTIMAL, (bound - x,), (np.array([2], dtype=np.int8),))
    element: Any = SimpleNamespace(weight=1.0, equality=True, name="hand")
    told = explain(problem, solution, {"hand": Place(element, 0, slice(0, 1), "hand")}, {})
    assert told["hand"].met is met
    snapshot = {"residuals": (bound - x,)}
    member: Any = SimpleNamespace(name="hand", level=0, part=slice(0, 1), weight=1.0, equality=True, contact=False)
    stack: Any = SimpleNamespace(constraints=0)
    assert (element_view(member, snapshot, told, None, stack, {}).state == "met") is met


def test_what_is_met_has_no_cause() -> None:
    for formulation in (hqp.Velocity(), hqp.Acceleration(), hqp.Torque()):
        robot, run, hand = humanoid("talos", formulation)
        tick = drive(robot, run, hand, 0.001, 3)
        assert both(tick, "hand") == ("", "")
        assert tick.notes == ()
        assert not tick.account().shares[: run.problem.constraints + 2].any()


def test_an_arm_out_of_reach_is_held_back_by_its_price() -> None:
    robot, run, hand = arm()
    tick = drive(robot, run, hand, [1.5, 0.0, 0.2], 1500)
    assert both(tick, "hand") == ("price", "price")
    held = tick.explain()["hand"].held_back
    assert held is not None
    assert held.share > 0.9
    assert held.unit == "m/s"
    assert held.requested > 1.0
    assert abs(held.achieved) < 0.01 * held.requested
    assert held.short.names == ("x", "y", "z")
    assert held.short.direction[0] > 0.9  # away from the shoulder
    assert 0.0 < held.worth < 0.1
    (note,) = tick.notes
    assert (note.element, note.status) == ("hand", Status.OPTIMAL)
    assert note.detail.startswith(f"requested {held.requested:.3g} m/s, achieved {held.achieved:.3g}, short along (")
    assert note.detail.endswith("the price on motion outweighs the rest")
    assert "held back by its price: requested" in str(tick.explain())
    assert tick.status is Status.OPTIMAL


def test_a_humanoid_out_of_reach_reports_request_and_achieved_part() -> None:
    robot, run, hand = humanoid("g1", hqp.Velocity())
    tick = drive(robot, run, hand, [1.0, 0.0, 0.2], 300)
    assert {"hand"} == {note.element for note in tick.notes}  # lower levels without a reference get no note
    assert "short along" in tick.notes[0].detail


def test_notes_may_be_read_later() -> None:
    """Notes compute their texts when they are read, from the numbers of their own tick."""
    read, later = [], []
    for at_once in (True, False):
        robot, run, hand = humanoid("g1", hqp.Velocity())
        q, v = robot.home.copy(), np.zeros(robot.nv)
        goal = robot.state(q, v).position(hand.frame) + [1.0, 0.0, 0.2]
        ticks = []
        for k in range(120):
            tick = run.step(robot.state(q, v), hand.at(goal - 0.01 * k))
            q, v = tick.advance()
            ticks.append(tick)
            if at_once:
                read.append(tick.notes)
        if not at_once:
            later = [pickle.loads(pickle.dumps(tick)).notes if k % 2 else tick.notes for k, tick in enumerate(ticks)]
    assert read == later
    assert len({notes[0].detail for notes in read if notes}) > 50


def test_worth_is_the_slope_of_what_is_not_met() -> None:
    """Compare c_k ||y_k|| with the change of the residual at a slightly lower price, at the optimum of the stage."""
    robot, run, hand = arm()
    tick = drive(robot, run, hand, [1.5, 0.0, 0.2], 1500)
    problem = run.problem.copy()
    k = run.program.places["hand"].level
    found = []
    for factor in (1.0, 0.999):
        prices = problem.prices.copy()  # type: ignore[union-attr]
        prices[k] *= factor
        other = hqp.Hierarchy(
            problem.levels, problem.constraints, n=problem.n, prices=prices, turning=problem.turning,
            motion=problem.motion,
        )  # fmt: skip
        point = hqp.solvers.load("reference").solve(other).stage_points[k]  # type: ignore[index]
        moved = problem.motion.offset(point)  # type: ignore[union-attr]
        found.append((float(np.linalg.norm(problem.levels[k].slack(point))), float(np.linalg.norm(moved))))
    (w, y), (less, more) = found
    held = tick.explain()["hand"].held_back
    assert held is not None
    assert (w - less) / (more - y) == pytest.approx(held.worth, rel=0.01)


def test_lost_to_a_level_above() -> None:
    robot, run, hand = humanoid("talos", hqp.Velocity())
    com = Com(name="com")
    state = robot.state()
    tick = run.step(state, com.at(state.com()), hand.at(state.position(hand.frame) + [1.5, 0.0, 0.0]))
    explained, accounted = tick.explain()["hand"], tick.account()
    assert explained.cause == accounted.cause("hand")
    assert {loss.element for loss in explained.losses} <= {*run.program.places, PRICE}


def test_two_levels_that_exclude_each_other() -> None:
    robot, _, hand = arm("panda")
    twin = Position(frame=hand.frame, name="twin", law=P(5.0))
    run = hqp.Controller(Stack(Level(hand), Level(twin), Level(Posture())), deadline=math.inf).session(robot, DT)
    state = robot.state()
    goal = state.position(hand.frame)
    tick = run.step(state, hand.at(goal), twin.at(goal + [0.05, 0.0, 0.0]))
    assert both(tick, "twin") == ("lost", "lost")
    assert tick.explain()["twin"].losses[0].element == "hand"
    assert tick.account().losses("twin")[0].element == "hand"
    assert "lost to hand" in str(tick.explain())


@pytest.mark.parametrize("price", [None, 0])
def test_a_limit_is_named_with_joint_and_side(price: Any) -> None:
    robot = hqp.robots.load("ur5")
    posture = Posture(law=P(5.0))
    run = hqp.Controller(Stack(Level(posture), subject_to=[JointLimits()]), price=price, deadline=math.inf).session(
        robot, DT
    )
    q = robot.home.copy()
    q[2] = robot.upper[2] - 1e-4
    target = q[:6].copy()
    target[2] += 0.5
    state = robot.state(q)
    posture_at = posture.at(state.angles + (target - q[:6]))
    tick = run.step(state, posture_at)
    assert both(tick, "posture") == ("limit", "limit")
    (loss,) = tick.explain()["posture"].losses
    assert loss.element == "joint_limits"
    assert loss.rows == ("elbow_joint upper",)
    assert "held by joint_limits 100 % (elbow_joint upper)" in str(tick.explain())


def test_a_push_is_measured_by_the_most_that_it_could_be() -> None:
    """Compare ||A'w|| with ||A|| ||w|| for each unmet element, with dense rows and with weighted single joints."""
    robot, _, hand = arm()
    stack = Stack(Level(hand), Level(Posture(weight=3.0)), subject_to=[JointLimits()])
    run = hqp.Controller(stack, deadline=math.inf).session(robot, DT)
    tick = drive(robot, run, hand, [1.5, 0.0, 0.2], 200)
    account, problem = tick.account(), run.problem
    assert not isinstance(problem.levels[-1].A, np.ndarray)
    for name in ("hand", "posture"):
        place, i = run.program.places[name], account.elements.index(name)
        A, w = (
            x[place.part] for x in (problem.levels[place.level].dense(problem.n), tick.solution.residuals[place.level])
        )
        told = account._values[4 * i + 2 : 4 * i + 4]
        np.testing.assert_allclose(told, [np.linalg.norm(A.T @ w), np.linalg.norm(A) * np.linalg.norm(w)], rtol=1e-9)


def test_fights_inside_a_level() -> None:
    robot, _, hand = arm("panda")
    twin = Position(frame=hand.frame, name="twin", law=P(5.0))
    run = hqp.Controller(Stack(Level(hand, twin), Level(Posture())), price=0, deadline=math.inf).session(robot, DT)
    state = robot.state()
    goal = state.position(hand.frame)
    tick = run.step(state, hand.at(goal), twin.at(goal + [0.05, 0.0, 0.0]))
    assert both(tick, "twin") == ("own level", "own level")
    assert tick.explain()["twin"].fights == ("hand",)
    assert "conflicts with hand in its own level" in str(tick.explain())


def test_out_of_reach_is_no_levels_fault() -> None:
    robot = hqp.robots.load("ur5")
    base = Position(frame=robot.frame_names[0], name="base", law=P(5.0))  # no joint moves it
    run = hqp.Controller(Stack(Level(base), Level(Posture())), price=0, deadline=math.inf).session(robot, DT)
    state = robot.state()
    tick = run.step(state, base.at(state.position(base.frame) + 0.1))
    assert both(tick, "base") == ("out of reach", "out of reach")
    assert tick.explain()["base"].losses == ()
    assert "out of reach" in str(tick.explain())


@pytest.mark.parametrize("formulation", [hqp.Velocity(), hqp.Acceleration()], ids=["velocity", "acceleration"])
def test_a_reference_that_is_too_fast_says_so(formulation: Any) -> None:
    robot = hqp.robots.load("ur5")
    law = P(5.0) if isinstance(formulation, hqp.Velocity) else PD(100.0)
    hand = Position(frame=robot.frame_names[-1], name="hand", law=law)
    stack = Stack(Level(hand), Level(Posture()), subject_to=[JointLimits()])
    run = hqp.Controller(stack, formulation, deadline=math.inf).session(robot, DT)
    run.step(robot.state())
    state = robot.state()
    rate = hand.at(state.position(hand.frame), velocity=[20.0, 0.0, 0.0])  # no error at all
    tick = run.step(state, rate)
    assert both(tick, "hand") == ("too fast", "too fast")
    assert "the rate of its reference" in str(tick.explain())
    state = robot.state()
    slow = hand.at(state.position(hand.frame) + [4.0, 0.0, 0.0], velocity=[0.01, 0.0, 0.0])  # an error, hardly a rate
    assert both(run.step(state, slow), "hand")[0] in ("limit", "price")


@pytest.mark.parametrize("formulation", [hqp.Velocity(), hqp.Acceleration()], ids=["velocity", "acceleration"])
@pytest.mark.parametrize("price", [None, 0])
def test_the_kernels_shares_are_those_of_the_certificate(formulation: Any, price: Any) -> None:
    """Use arms, because their multipliers are unique: the rows above a level are well separated."""
    from hqp.explanation.multipliers import explain

    compared = 0
    for name in ("panda", "ur5", "kinova"):
        robot = hqp.robots.load(name)
        hand, elbow = (
            Position(frame=robot.frame_names[-1], name="hand"),
            Position(frame=robot.frame_names[-8], name="elbow"),
        )
        limits = [] if price == 0 else [JointLimits()]  # at a vertex, many limits can share a push in several ways
        stack = Stack(Level(hand), Level(elbow), Level(Posture()), subject_to=limits)
        run = hqp.Controller(stack, formulation, price=price, deadline=math.inf).session(robot, DT)
        rng = np.random.default_rng(1)
        for _ in range(8):
            state = robot.state(robot.integrate(robot.home, 0.4 * rng.standard_normal(robot.nv), 1.0))
            goals = [e.at(state.position(e.frame) + 0.5 * rng.standard_normal(3)) for e in (hand, elbow)]
            tick = run.step(state, *goals)
            assert tick.solution is not None
            account = tick.account()
            names = {e.name: e.row_names(robot) for e in run.stack}
            told = explain(run.problem, tick.solution, run.program.places, names)
            for i, element in enumerate(account.elements):
                entry = told[element]
                assert account.residual[i] == pytest.approx(entry.residual, abs=1e-9)
                assert account.requested[i] == pytest.approx(entry.requested, rel=1e-6, abs=1e-9)
                shares = {loss.element: loss.share for loss in account.losses(element)}
                for loss in entry.losses if element in ("hand", "elbow") else ():
                    if loss.share > 0.05:
                        compared += 1
                        assert shares.get(loss.element, 0.0) == pytest.approx(loss.share, abs=0.03), (
                            f"{element}: {loss}"
                        )
    assert compared > 20


def test_other_solvers_account_through_an_explanation() -> None:
    robot = hqp.robots.load("ur5")
    hand = Position(frame=robot.frame_names[-1], name="hand", law=P(5.0))
    stack = Stack(Level(hand), Level(Posture()), subject_to=[JointLimits()])
    run = hqp.Controller(stack, solver="cascade:proxqp", deadline=math.inf).session(robot, DT)
    state = robot.state()
    account = run.step(state, hand.at(state.position(hand.frame) + [2.0, 0.0, 0.0])).account()
    assert isinstance(account, TickAccount)
    assert account.cause("hand") == "limit"
    assert account.cause("posture") in ("lost", "limit")


@pytest.mark.long
def test_an_answer_that_was_cut_short_after_stages_has_an_account() -> None:
    """explain() raised ValueError: it read the longer list of multipliers of the previous tick."""
    robot, run, hand = humanoid("talos", hqp.Velocity())
    start, rng, cut = robot.state().position(hand.frame), np.random.default_rng(0), 0
    for k in range(21):
        run.workspace.limit(1e-9 if k % 3 == 2 else math.inf)  # type: ignore[attr-defined]
        q = robot.home.copy()
        if k % 2:
            q[7:] += 0.02 * rng.normal(size=q.size - 7)
        tick = run.step(robot.state(q), hand.at(start + [2.0 if k % 7 else 0.0, 0.0, 0.0]))
        cut += tick.status is Status.TIME_LIMIT
        assert "hand" in str(tick.account())
        assert "hand" in str(tick.explain())
    assert cut >= 7


def test_an_unknown_name_is_told_with_the_closest() -> None:
    robot, run, _ = arm()
    account = run.step(robot.state()).account()
    for ask in (account.met, account.cause, account.losses):
        with pytest.raises(DeclarationError, match="hand"):
            ask("hant")


def test_accounts_can_be_kept_and_cost_little(monkeypatch: pytest.MonkeyPatch) -> None:
    """Accounts come from the kernel, without the second solve of an explanation."""
    monkeypatch.setattr(Teller, "explain", None)
    robot, run, hand = humanoid("talos", hqp.Velocity())
    state = robot.state()
    goal = hand.at(state.position(hand.frame) + [1.0, 0.0, 0.2])
    run.step(state)
    history = [run.step(robot.state(), goal).account() for _ in range(50)]
    assert len({account.count for account in history}) == 50
    requested = [account.requested[account.elements.index("hand")] for account in history]
    assert max(requested) == pytest.approx(min(requested))  # later ticks do not overwrite kept accounts
    first = run.step(robot.state())
    run.step(robot.state())
    with pytest.raises(HqpError, match="latest"):
        first.account()


def test_the_direction_in_which_an_element_is_short_reads_by_row() -> None:
    assert str(Short.of(np.array([-0.8, 0.0, 0.6]), ("x", "y", "z"))) == "0.8 x, -0.6 z"
    assert str(Short.of(np.array([-1.0]), ())) == "1 row 0"


def test_contacts_in_conflict_have_an_account_too() -> None:
    robot = hqp.robots.load("talos")
    left, right = robot.landmarks["soles"]
    pulled = PointContact(frame=right, name="pulled")
    stack = Stack(Level(Posture()), subject_to=[FixedContact(frame=left), FixedContact(frame=right), pulled])
    run = hqp.Controller(stack, deadline=math.inf).session(robot, DT)
    run.step(robot.state())
    tick = run.step(robot.state(), pulled.at(velocity=[0.1, 0.0, 0.0]))
    assert tick.status is Status.CONSTRAINTS_VIOLATED
    assert both(tick, "pulled") == ("own level", "own level")


@pytest.mark.long
def test_accounts_leave_no_memory_behind() -> None:
    """A workspace with a view of its own multipliers was never freed: 0.1 to 1 MB each."""
    import gc

    if not Path("/proc/self/statm").exists():
        pytest.skip("no /proc")

    def resident() -> float:
        return int(Path("/proc/self/statm").read_text().split()[1]) * 4096 / 1e6

    robot = hqp.robots.load("ur5")
    hand = Position(frame=robot.frame_names[-1], name="hand", law=P(5.0))

    def sessions(count: int) -> None:
        for _ in range(count):
            run = hqp.Controller(Stack(Level(hand), Level(Posture())), deadline=math.inf).session(robot, DT)
            state = robot.state()
            run.step(state, hand.at(state.position(hand.frame) + [2.0, 0.0, 0.0])).account()
        gc.collect()

    sessions(60)
    before = resident()
    sessions(240)
    assert resident() - before < 6.0


@pytest.mark.parametrize("native", [True, False], ids=["native", "general"])
def test_a_tick_from_rest_names_the_acceleration(native: bool) -> None:
    """Without the acceleration window the hand would reach its reference, although feet and CoM push back as well."""
    robot = hqp.robots.load("g1")
    feet = [FixedContact(frame=frame) for frame in robot.landmarks["soles"]]
    hand = Position(frame=robot.landmarks["palms"][1], law=P(5.0), name="hand")
    stack = Stack(Level(Com(axes="xy")), Level(hand), Level(Posture()), subject_to=[*feet, JointLimits()])
    rates = None if native else hqp.RateLimits(velocity=1e9)
    run = hqp.Controller(stack, rates=rates, deadline=math.inf).session(robot, DT)
    goal = hand.at(robot.state().position(hand.frame) + np.array([0.15, 0.05, 0.1]))
    run.step(robot.state())
    tick = run.step(robot.state(), goal)
    assert both(tick, "hand") == ("limit", "limit")
    loss = next(loss for loss in tick.explain()["hand"].losses if loss.element == "joint_limits")
    assert loss.binds
    assert loss.share < 0.5  # the CoM has the largest share
    assert loss.rows
    assert all(row.endswith(" acceleration") for row in loss.rows)
    assert "held by joint_limits" in str(tick.explain())
    free = Stack(Level(Com(axes="xy")), Level(hand), Level(Posture()), subject_to=feet)
    other = hqp.Controller(free, deadline=math.inf).session(robot, DT)
    assert other.step(robot.state(), goal).account().met("hand")


def test_a_joint_at_its_top_speed_is_named_so() -> None:
    robot = hqp.robots.load("ur5")
    v = np.zeros(6)
    v[0], v[2] = robot.velocity_limit[0], -robot.velocity_limit[2]
    kinds = JointLimits().bound_kinds(robot.state(robot.home, v), v, DT)
    assert kinds[0] == ("acceleration", "speed")
    assert kinds[2] == ("speed", "acceleration")
    assert kinds[1] == ("acceleration", "acceleration")
    q = robot.home.copy()
    q[2] = robot.upper[2]
    assert JointLimits().bound_kinds(robot.state(q), np.zeros(6), DT)[2] == ("acceleration", "")
