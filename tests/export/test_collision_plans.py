"""Live sessions, files and batches avoid links and shapes with identical commands."""

from __future__ import annotations

from dataclasses import replace
from typing import Any

import numpy as np
import pytest

import hqp
from hqp import PD, Level, P, Stack, shapes
from hqp.export.loaded import LoadedSession
from hqp.loop.file import text
from hqp.solvers.lexicographic import kernel
from hqp.tasks import CollisionAvoidance, JointLimits, Position, Posture

pytestmark = pytest.mark.skipif(not kernel(), reason="no native kernel here")
HANDS = {"panda": "panda_hand_tcp", "ur5": "tool0", "kinova": "j2s6s200_end_effector", "cbi": "right_hand"}


def blocked(name: str, formulation: str, seed: int) -> tuple[Any, Any, Any, Any]:
    """A session with a hand target behind a ball and a box at drawn places beside its way, and its references."""
    robot, rng = hqp.robots.load(name, floating=False), np.random.default_rng(seed)
    law = P(5.0) if formulation == "velocity" else PD(25.0, 10.0)
    frame = HANDS.get(name) if HANDS.get(name) in robot.frame_names else robot.landmarks["palms"][0]
    hand = Position(frame=frame, law=law, name="hand")
    start = robot.state(robot.home).position(frame).copy()
    way = rng.normal(size=3) * [1.0, 1.0, 0.5]
    way *= 0.35 / np.linalg.norm(way)
    side = np.cross(way, rng.normal(size=3))
    side /= np.linalg.norm(side)
    ball = shapes.sphere("ball", 0.05, tuple(start + 0.6 * way + 0.02 * side))
    box = shapes.box("box", (0.1, 0.08, 0.06), tuple(start + way - 0.05 * side), (0.3, 0.2, 0.1))
    avoid = CollisionAvoidance(world=(ball, box), clearance=0.02)
    stack = Stack(Level(hand), Level(Posture(law=law)), subject_to=[JointLimits(), avoid])
    form = {"velocity": hqp.Velocity, "acceleration": hqp.Acceleration, "torque": hqp.Torque}[formulation]()
    session = hqp.Controller(stack, form, deadline=np.inf).session(robot, 0.005)
    return session, hand, start + way, avoid


@pytest.mark.long
@pytest.mark.parametrize("formulation", ["velocity", "acceleration", "torque"])
def test_a_file_and_a_batch_keep_the_distances_of_the_session(formulation: str) -> None:
    same(blocked("panda", formulation, 1), ticks=60)


@pytest.mark.slow
@pytest.mark.parametrize("seed", range(4))
@pytest.mark.parametrize("formulation", ["velocity", "acceleration", "torque"])
@pytest.mark.parametrize("name", ["panda", "ur5", "cbi"])
def test_drawn_shapes_beside_the_way_of_a_hand(name: str, formulation: str, seed: int) -> None:
    same(blocked(name, formulation, seed), ticks=160)


def same(scene: tuple[Any, Any, Any, Any], ticks: int) -> None:
    session, hand, goal, avoid = scene
    judge = replace(avoid, influence=avoid.clearance + 0.05)
    robot, twin = session.robot, session.robot.copy()
    file = LoadedSession(text(session))
    batch = hqp.Batch(session.controller, robot, 2, session.dt, threads=2)
    q, v, margins = robot.home.copy(), np.zeros(robot.nv), []
    for i in range(ticks):
        tick = session.step(robot.state(q, v), hand.at(goal))
        if i == 0:
            for element, value in session.hold_values.items():
                if element in file.names:
                    file.hold(element, value)
        found = file.step(q, v, {"hand": goal})
        np.testing.assert_array_equal(found.x, tick.x, err_msg=f"tick {i}")
        many = batch.step(np.array([q, q]), np.array([v, v]), {"hand": np.array([goal, goal])})
        np.testing.assert_array_equal(many.x[0], many.x[1])
        np.testing.assert_allclose(many.x[0], tick.x, atol=1e-9 * max(1.0, float(np.abs(tick.x).max())))
        q, v = tick.advance()
        if i % 4 == 0:
            near = [n.distance - n.clearance for n in judge.near(twin.state(q)) if n is not None]
            margins.append(min(near, default=np.inf))
    assert min(margins) > min(margins[0], 0.0) - 1e-3  # a hand may start inside and comes out
    assert min(margins) < 0.05
