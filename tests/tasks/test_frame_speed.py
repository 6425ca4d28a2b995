"""The speed of a frame stays below its limit: differences of its positions over closed loops."""

from __future__ import annotations

import math
from itertools import pairwise
from typing import Any

import numpy as np
import pinocchio as pin
import pytest
from scipy.spatial import ConvexHull

import hqp
import hqp.tasks as t
from hqp import PD, Level, P, Stack, serial
from hqp.errors import DeclarationError, FrameNotFound
from hqp.tasks.frame_speed import INNER, directions

DT = 0.002
FORMULATIONS = {
    "velocity": hqp.Velocity(law=P(5.0)),
    "acceleration": hqp.Acceleration(law=PD(100.0, 20.0), contact_law=PD(400.0, 40.0)),
    "torque": hqp.Torque(law=PD(100.0, 20.0), contact_law=PD(400.0, 40.0)),
}
HANDS = {"panda": "panda_hand", "ur5": "tool0", "talos": "gripper_left_base_link", "g1": "left_wrist_yaw_link"}
LINEAR, ANGULAR = 0.25, 0.5


@pytest.fixture(scope="module")
def robots() -> dict[str, Any]:
    if "panda" not in hqp.robots.names():
        pytest.skip("needs example-robot-data")
    return {name: hqp.robots.load(name) for name in HANDS}


def loop(
    robot: Any, kind: str, way: list[float], limits: list[Any], ticks: int, v: Any = None
) -> tuple[np.ndarray[Any, Any], np.ndarray[Any, Any], set[Any]]:
    """Speed and angular speed of the hand in each tick, from differences of its placement, and the statuses."""
    frame, robot = HANDS[robot.name], robot.copy()
    feet = [t.FixedContact(frame=f, name=f) for f in robot.landmarks.get("soles", ())] if robot.floating else []
    hard = [*feet, t.JointLimits(), *([t.TorqueLimits()] if kind == "torque" else []), *limits]
    hand = t.Position(frame=frame, name="hand")
    posture = Level(t.Posture(law=P(1.0) if kind == "velocity" else PD(20.0)))
    controller = hqp.Controller(Stack(Level(hand), posture, subject_to=hard), FORMULATIONS[kind], deadline=math.inf)
    session = controller.session(robot, DT)
    q, v = robot.home, np.zeros(robot.nv) if v is None else v
    start = robot.state(q).position(frame).copy()
    places, turns, statuses = [start], [robot.state(q).rotation(frame).copy()], set()
    for k in range(ticks):
        goal = start + way if k < ticks // 2 else start - 0.5 * np.array(way)
        tick = session.step(robot.state(q, v), hand.at(goal))
        statuses.add(tick.status)
        q, v = tick.advance()
        places.append(robot.state(q).position(frame).copy())
        turns.append(robot.state(q).rotation(frame).copy())
    speed = np.linalg.norm(np.diff(places, axis=0), axis=1) / DT
    turn = [np.linalg.norm(pin.log3(a.T @ b)) / DT for a, b in pairwise(turns)]
    return speed, np.array(turn), statuses


def test_the_polytope_lies_in_the_ball_and_loses_at_most_two_percent() -> None:
    normals = np.concatenate((directions(), -directions()))
    assert np.linalg.norm(normals, axis=1) == pytest.approx(1.0, abs=1e-12)
    assert len(np.unique(np.round(normals, 6), axis=0)) == 162
    nearest = -ConvexHull(normals).equations[:, 3].max()  # cosine to the direction that is furthest from all normals
    assert INNER / nearest < 0.999
    assert INNER >= 0.98


@pytest.mark.parametrize("kind", FORMULATIONS)
@pytest.mark.parametrize("name", ["panda", "ur5", "talos", pytest.param("g1", marks=pytest.mark.slow)])
@pytest.mark.parametrize(
    "way", [[0.2, 0.1, -0.1], pytest.param([0.35, 0.2, -0.3], marks=pytest.mark.slow), [1.0, 0.6, 0.9]],
    ids=["within reach", "at its edge", "beyond"],
)  # fmt: skip
def test_no_hand_is_faster_than_its_limit(robots: dict[str, Any], name: str, kind: str, way: list[float]) -> None:
    limit = t.FrameVelocityLimits(frame=HANDS[name], linear=LINEAR, angular=ANGULAR)
    speed, turn, statuses = loop(robots[name], kind, way, [limit], 500)
    assert all(status.solved for status in statuses)
    assert speed.max() < LINEAR
    assert turn.max() < ANGULAR
    loose, _, _ = loop(robots[name], kind, way, [], 250)
    assert loose.max() > 1.2 * LINEAR  # without it the hand is faster


@pytest.mark.parametrize("kind", FORMULATIONS)
def test_at_most_two_percent_of_the_speed_is_lost(robots: dict[str, Any], kind: str) -> None:
    """In any direction: a distant goal is approached at 0.98 of the limit after the start."""
    for way in ([0.0, 1.0, 0.0], [-0.3, 0.5, 0.4], [0.3, -0.6, 0.1]):
        limit = t.FrameVelocityLimits(frame=HANDS["panda"], linear=LINEAR)
        speed, _, _ = loop(robots["panda"], kind, way, [limit], 500)
        assert 0.979 * LINEAR < np.max(speed) < LINEAR


@pytest.mark.parametrize("kind", FORMULATIONS)
def test_an_excess_decays_at_the_rate(robots: dict[str, Any], kind: str) -> None:
    """A hand that starts too fast returns below its limit without a status and without a jump."""
    robot, frame = robots["ur5"], HANDS["ur5"]
    J = robot.state().jacobian(frame)[:3]
    v = np.linalg.pinv(J) @ [0.0, 0.6, 0.0]
    limit = t.FrameVelocityLimits(frame=frame, linear=LINEAR, rate=20.0)
    speed, _, statuses = loop(robot, kind, [0.0, 0.4, 0.0], [limit], 400, v)
    assert statuses == {hqp.Status.OPTIMAL}
    assert speed[0] > 0.5
    assert speed[150:].max() < LINEAR * 1.001
    excess = np.maximum(speed - LINEAR, 0.0)
    assert np.all(excess <= 0.6 * np.exp(-18.0 * DT * np.arange(excess.size)))


@pytest.mark.parametrize("turned", [0.3, 2.0])
def test_the_heading_does_not_matter(robots: dict[str, Any], turned: float) -> None:
    """A floating robot rotated as a whole with its goal has equal bounds on its joints' motion."""
    robot, frame = robots["talos"], HANDS["talos"]
    limit, rng = t.FrameVelocityLimits(frame=frame, angular=1.0), np.random.default_rng(1)
    v = rng.normal(size=robot.nv)
    q = robot.home.copy()
    other = q.copy()
    other[:7] = pin.SE3ToXYZQUAT(pin.SE3(pin.exp3(np.array([0.0, 0.0, turned])), np.ones(3)) * pin.XYZQUATToSE3(q[:7]))
    one, two = robot.copy().state(q, v), robot.copy().state(other, v)
    assert limit.jacobian(one) == pytest.approx(limit.jacobian(two), abs=1e-12)
    for order in (1, 2):
        for a, b in zip(limit.step_bounds(one, DT, order), limit.step_bounds(two, DT, order), strict=True):
            assert a == pytest.approx(b, abs=1e-9)


@pytest.mark.parametrize(
    ("fields", "what"),
    [
        ({"frame": ""}, "frame"),
        ({"linear": 0.0}, "linear"),
        ({"linear": -0.1}, "linear"),
        ({"linear": math.nan}, "linear"),
        ({"angular": -math.inf}, "angular"),
        ({"linear": math.inf}, "finite linear"),
        ({"rate": 0.0}, "rate"),
    ],
)
def test_bad_fields_are_refused(fields: dict[str, Any], what: str) -> None:
    with pytest.raises(DeclarationError, match=what):
        t.FrameVelocityLimits(**{"frame": "panda_hand", **fields})


def test_an_unknown_frame_is_refused_and_files_keep_infinity(robots: dict[str, Any]) -> None:
    with pytest.raises(FrameNotFound, match="panda_hand"):
        t.FrameVelocityLimits(frame="panda_hnd").rows(robots["panda"])
    stack = Stack(Level(t.Posture()), subject_to=[t.FrameVelocityLimits(frame="panda_hand", linear=0.1)])
    assert serial.loads(serial.dumps(stack)) == stack
