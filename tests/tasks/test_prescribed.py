"""Prescribed motion: limits, distances, tasks and dynamics treat another controller's motion as given."""

from __future__ import annotations

import re
from functools import cache
from typing import Any

import numpy as np
import pytest

import hqp
import hqp.tasks as t
from hqp import Level, P, Stack, Status
from hqp.errors import DeclarationError, JointNotFound
from hqp.export.loaded import LoadedSession
from hqp.loop.file import text
from hqp.robots import Robot
from hqp.serial import dumps, loads

FORMULATIONS = {"velocity": hqp.Velocity, "acceleration": hqp.Acceleration, "torque": hqp.Torque}
ROBOTS = ("g1", "talos")
DT = 0.002


@cache
def _loaded(name: str) -> Robot:
    return hqp.robots.load(name)


def load(name: str) -> Robot:
    return _loaded(name).copy()


def legs_of(robot: Robot) -> list[str]:
    """Joints between the base and a sole."""
    soles = [robot.frame(sole) for sole in robot.landmarks["soles"]]
    moved = np.flatnonzero(np.any([robot.support(sole) for sole in soles], axis=0))
    return [robot.joint_name(int(c)) for c in moved if c >= 6]


def scene(robot: Robot, formulation: str, price: float | None = None) -> tuple[hqp.Session, t.PrescribedMotion, Any]:
    legs = legs_of(robot)
    upper = [name for name in robot.joint_names if name not in legs]
    given = t.PrescribedMotion(joints=legs, name="legs")
    hands = [t.Position(frame=palm, name=f"hand {k}") for k, palm in enumerate(robot.landmarks["palms"][:2])]
    apart = t.CollisionAvoidance(clearance=0.02, influence=0.1, pairs=_arms(robot, legs))
    stack = Stack(
        *(Level(hand, price=price) for hand in hands),
        Level(t.Posture(joints=upper, name="posture"), price=price),
        subject_to=[t.JointLimits(joints=upper), apart, given],
    )
    controller = hqp.Controller(stack, FORMULATIONS[formulation](), deadline=np.inf)
    return controller.session(robot, DT, stuck=False), given, hands


def _arms(robot: Robot, legs: list[str]) -> tuple[tuple[str, str], ...]:
    """The last link of each arm paired with the links of the legs."""
    capsules = [c.name.rpartition("/")[0] or c.name for c in robot.capsules]
    body = dict(zip(capsules, (c.body for c in robot.capsules), strict=True))
    moved = {robot.subtree(joint) for joint in legs}
    palms = {robot.body(robot.frame(palm)) for palm in robot.landmarks["palms"]}
    return tuple((a, b) for a in body if body[a] in palms for b in body if body[b] in moved)


def drawn(robot: Robot, rng: np.random.Generator) -> tuple[Any, Any]:
    q = robot.integrate(robot.home, np.r_[rng.normal(size=3), rng.uniform(-0.2, 0.2, robot.nv - 3)], 1.0)
    return q, rng.normal(size=robot.nv) * np.where(np.arange(robot.nv) < 6, 0.3, 1.0)


def nearest(robot: Robot, q: Any, pairs: tuple[tuple[str, str], ...]) -> float:
    """Least distance of capsules, named or of named links [m], by coal."""
    import coal
    import pinocchio as pin

    data = robot.model.createData()
    pin.forwardKinematics(robot.model, data, q)
    shapes: dict[str, list[Any]] = {}
    for c in robot.capsules:
        a, b = (data.oMi[c.body].act(np.array(end)) for end in (c.a, c.b))
        along = b - a
        turn = pin.Quaternion.FromTwoVectors(np.array([0.0, 0.0, 1.0]), along).matrix() if np.any(along) else np.eye(3)
        shape = coal.Capsule(c.radius, float(np.linalg.norm(along))), coal.Transform3s(turn, (a + b) / 2.0)
        for name in {c.name, c.name.rpartition("/")[0] or c.name}:
            shapes.setdefault(name, []).append(shape)
    ask, found = coal.DistanceRequest(), coal.DistanceResult()
    far = []
    for one, two in pairs:
        for (a, at), (b, there) in ((x, y) for x in shapes[one] for y in shapes[two]):
            found.clear()
            far.append(coal.distance(a, at, b, there, ask, found))
    return float(min(far))


@pytest.mark.parametrize("price", [None, 0.0])
@pytest.mark.parametrize("formulation", FORMULATIONS)
@pytest.mark.parametrize("name", ROBOTS)
def test_nothing_moves_what_is_given(name: str, formulation: str, price: float | None) -> None:
    """Drawn states, speeds and accelerations, hands out of reach: given coordinates keep their values in each tick."""
    robot, rng = load(name), np.random.default_rng(1)
    session, given, hands = scene(robot, formulation, price)
    own = given.selection(robot)
    for _ in range(25):
        q, v = drawn(robot, rng)
        a = rng.normal(size=own.size)
        state = robot.state(q, v)
        goals = [hand.at(state.position(hand.frame) + rng.normal(size=3)) for hand in hands]
        told = rng.uniform() < 0.7
        tick = session.step(state, *goals, *([given.at(acceleration=a)] if told else []))
        assert tick.solved
        _, after = tick.advance()
        expected = v[own] + DT * a * told
        np.testing.assert_allclose(after[own], expected, atol=1e-9, rtol=0.0)
        if formulation == "velocity":
            np.testing.assert_allclose(tick.x[own], expected, atol=1e-13, rtol=0.0)


@pytest.mark.parametrize("name", ROBOTS)
def test_the_dynamics_keep_it_with_no_torque_of_its_motors(name: str) -> None:
    """Judged by Pinocchio: M dv + h = S' tau + forces on the given coordinates alone, and none by x."""
    import pinocchio as pin

    robot, rng = load(name), np.random.default_rng(2)
    session, given, hands = scene(robot, "torque")
    own = given.selection(robot)
    rest = np.setdiff1d(np.arange(robot.nv), own)
    model, data = robot.model, robot.model.createData()
    for _ in range(10):
        q, v = drawn(robot, rng)
        a = rng.normal(size=own.size)
        state = robot.state(q, v)
        tick = session.step(state, given.at(acceleration=a), hands[0].at(state.position(hands[0].frame) + 0.05))
        dv = (tick.advance()[1] - v) / DT
        force = pin.rnea(model, data, q, v, dv) + robot.rotors * dv * (model.armature == 0.0)
        tau = np.zeros(robot.nv)
        tau[robot.actuated] = tick.command
        np.testing.assert_allclose(force[rest], tau[rest], atol=1e-6 * (1.0 + np.abs(tau).max()), rtol=0.0)
        np.testing.assert_allclose(tau[own], 0.0, atol=1e-9)
        np.testing.assert_allclose(dv[own], a, atol=1e-7)


@pytest.mark.parametrize("formulation", ["velocity", "acceleration"])
def test_an_arm_gives_way_to_a_leg_that_comes(formulation: str) -> None:
    """A thigh swings into a hand with the task to stay: the hand moves, the leg does not; judged by capsules."""
    robot = load("g1")
    session, given, _ = scene(robot, formulation)
    own, q, v = given.selection(robot), robot.home.copy(), np.zeros(robot.nv)
    hip = list(own).index(robot.joints("left_hip_pitch_joint")[0])
    start, pairs, length = q.copy(), _arms(robot, legs_of(robot)), 2.5
    without, least, moved = np.inf, np.inf, 0.0
    for i in range(int(length / DT)):
        measured = np.zeros(own.size)
        measured[hip] = -1.1 * np.pi / length * np.sin(np.pi * i * DT / length)
        v[own] = measured
        tick = session.step(robot.state(q, v))
        assert tick.status is Status.OPTIMAL, (i, tick.notes)
        q, v = tick.advance()
        np.testing.assert_allclose(v[own], measured, atol=1e-12)
        if i % 20 == 0:
            least = min(least, nearest(robot, q, pairs))
            without = min(without, nearest(robot, np.r_[q[:19], start[19:]], pairs))
        moved = max(moved, float(np.abs(q[7 + 12 :] - start[7 + 12 :]).max()))
    assert without < 0.0  # without the rows the leg hits the hand
    assert moved > 0.05
    assert least > 0.015


def test_measured_and_not_sent() -> None:
    """The state's velocity counts in each tick, also after another command."""
    robot, rng = load("g1"), np.random.default_rng(3)
    session, given, _ = scene(robot, "velocity")
    own, seen = given.selection(robot), []
    for _ in range(5):
        v = 0.2 * rng.normal(size=robot.nv)
        tick = session.step(robot.state(robot.home, v))
        seen.append(np.abs(tick.x[own] - v[own]).max())
    assert max(seen) < 1e-13


@pytest.mark.parametrize("formulation", FORMULATIONS)
@pytest.mark.parametrize("name", ROBOTS)
def test_files_and_batches_give_the_same_bits(name: str, formulation: str) -> None:
    robot, rng = load(name), np.random.default_rng(4)
    session, given, hands = scene(robot, formulation)
    file, alone = LoadedSession(text(session)), LoadedSession(text(session))
    batch = hqp.Batch(session.controller, robot.copy(), 2, DT, threads=1)
    q, v = robot.home.copy(), np.zeros(robot.nv)
    own = given.selection(robot)
    start = robot.state(q).position(hands[0].frame)
    for i in range(30):
        v[own] = 0.3 * rng.normal(size=own.size)
        a = rng.normal(size=own.size)
        goal = start + 0.1 * np.sin(0.1 * i + np.arange(3))
        tick = session.step(robot.state(q, v), given.at(acceleration=a), hands[0].at(goal))
        if i == 0:
            for element, value in session.hold_values.items():
                if element in file.names:
                    file.hold(element, value)
        told = {"legs": (np.zeros(own.size), np.zeros(own.size), a), hands[0].name: goal}
        found, q_told, v_told = file.step(q, v, told), q, v.copy()
        np.testing.assert_array_equal(found.x, tick.x, err_msg=f"tick {i}")
        assert found.status is tick.status
        q, v = tick.advance()
        Q, V, A = np.array([q_told, q_told]), np.array([v_told, v_told]), np.array([a, 0.0 * a])
        targets = {"legs": (np.zeros_like(A), np.zeros_like(A), A), hands[0].name: np.array([goal, goal])}
        np.testing.assert_array_equal(
            batch.step(Q, V, targets).x[0], alone.step(q_told, v_told, told).x, err_msg=f"tick {i}"
        )


def test_declared() -> None:
    robot, arm = load("g1"), load("ur5")
    assert t.PrescribedMotion().rows(robot) == 6
    assert t.PrescribedMotion(joints=["left_knee_joint"], base=False).rows(robot) == 1
    assert t.PrescribedMotion(joints="left_knee_joint").row_names(robot)[4:] == (
        "base pitch",
        "base yaw",
        "left_knee_joint",
    )
    stack = Stack(Level(t.Posture()), subject_to=[t.PrescribedMotion(joints=["left_knee_joint"])])
    assert loads(dumps(stack)) == stack
    with pytest.raises(JointNotFound):
        t.PrescribedMotion(joints="left_kne").rows(robot)
    for bad, what in (
        (lambda: t.PrescribedMotion().rows(arm), "at least one joint"),
        (lambda: t.PrescribedMotion(joints=None), "joints"),
        (lambda: t.PrescribedMotion(base=1), "base"),
        (lambda: t.PrescribedMotion(law=P(1.0)), "not corrected"),
        (lambda: t.PrescribedMotion().at(np.zeros(6)), "value"),
        (lambda: t.PrescribedMotion().at(velocity=np.zeros(6)), "velocity"),
    ):
        with pytest.raises(DeclarationError, match=what):
            bad()  # type: ignore[no-untyped-call]


def test_notes_name_the_pair_that_prescribed_legs_bring_together() -> None:
    """Both shins are given and approach: a note has their names, and coal's distance, file and live."""
    robot = load("g1")
    pair = (("left_ankle_roll_link", "right_ankle_roll_link"),)
    given, apart = t.PrescribedMotion(joints=legs_of(robot)), t.CollisionAvoidance(pairs=pair, clearance=0.05)
    stack = Stack(Level(t.Posture(joints=robot.joint_names[12:])), subject_to=[given, apart])
    session = hqp.Controller(stack, deadline=np.inf).session(robot, DT, stuck=False)
    file = LoadedSession(text(session))
    q, v, seen = robot.home.copy(), np.zeros(robot.nv), []
    v[robot.joints("left_hip_roll_joint")], v[robot.joints("right_hip_roll_joint")] = -0.3, 0.3
    for _ in range(250):
        tick, found = session.step(robot.state(q, v)), file.step(q, v)
        assert found.notes == tick.notes
        if tick.status is Status.CONSTRAINTS_VIOLATED:
            (note,) = tick.notes
            assert note.element == "collision"
            rows = re.findall(r"(left_ankle_roll_link\S*) - (right_ankle_roll_link\S*) \S+ at (\S+) mm", note.detail)
            assert len(set(rows)) == len(rows), note
            seen.append(min(1e-3 * float(distance) for _, _, distance in rows))
            assert abs(seen[-1] - nearest(robot, q, pair)) < 1e-4, note
        q, v = tick.advance()
    assert len(seen) > 10
    assert min(seen) < 0.05
