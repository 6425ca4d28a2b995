"""Joints outside their range: a note names each with its way back, from Python and from a file, until it is inside."""

from __future__ import annotations

import math
import re
from typing import Any

import numpy as np
import pinocchio as pin
import pytest

import hqp
from hqp import PD, Level, P, Stack
from hqp.export.loaded import LoadedSession
from hqp.loop.file import text
from hqp.tasks import JointLimits, Posture, PrescribedMotion, TorqueLimits

DT = 0.005
LEVELS = {"velocity": hqp.Velocity(), "acceleration": hqp.Acceleration(), "torque": hqp.Torque(holding=None)}
NOTE = re.compile(r"is (\S+) (rad|m) outside its range \[(\S+), (\S+)\]( and returns)?$")


def outside(notes: Any) -> dict[str, tuple[float, float, float, bool]]:
    """Way, limits, and true if it returns, by joint."""
    found = {}
    for note in notes:
        if match := NOTE.match(note.detail):
            way, _, low, high, back = match.groups()
            assert note.element not in found
            found[note.element] = float(way), float(low), float(high), back is not None
    return found


@pytest.mark.parametrize("kind", LEVELS)
@pytest.mark.parametrize("name", ["g1", "ur5", "panda", pytest.param("talos", marks=pytest.mark.slow)])
def test_joints_outside_their_range_are_named_until_they_are_back(name: str, kind: str) -> None:
    """Drawn joints at rest outside their range by up to 0.1, ranges by plain arithmetic."""
    if name not in hqp.robots.names():
        pytest.skip("needs example-robot-data")
    robot, rng = hqp.robots.load(name), np.random.default_rng(0)
    own = robot.actuated
    joints, low, high = robot.joint_names, robot.lower[own], robot.upper[own]
    law = P(5.0) if kind == "velocity" else PD(100.0, 20.0)
    base = [PrescribedMotion(name="base")] if robot.floating else []
    limits = [JointLimits(joints=joints, return_velocity=0.2), *([TorqueLimits()] if kind == "torque" else [])]
    stack = Stack(Level(Posture(joints=joints, law=law)), subject_to=[*base, *limits])
    session = hqp.Controller(stack, LEVELS[kind], deadline=math.inf).session(robot, DT, stuck=False)
    file = LoadedSession(text(session))
    angles = robot.state(robot.home).angles.copy()
    turns = np.flatnonzero(np.isfinite(low + high))
    moved = rng.choice(turns, size=max(1, turns.size // 4), replace=False)
    side, way = rng.choice([-1.0, 1.0], moved.size), rng.uniform(1e-4, 0.1, moved.size)
    angles[own[moved]] = np.where(side > 0.0, high[moved] + way, low[moved] - way)
    q, v, named, inside = robot.configuration(angles), np.zeros(robot.nv), 0, 0
    if robot.floating:
        q[:7] = robot.home[:7]
    for k in range(400):
        state = robot.state(q, v)
        at = state.angles[own].copy()
        tick = session.step(state)
        if k == 0:
            for hold, value in session.hold_values.items():
                if hold in file.names:
                    file.hold(hold, value)
        assert [(n.element, n.detail) for n in file.step(q, v).notes if NOTE.match(n.detail)] == [
            (n.element, n.detail) for n in tick.notes if NOTE.match(n.detail)
        ]
        noted, off = outside(tick.notes), np.maximum(low - at, at - high)
        passing = {note.element for note in tick.notes if "cannot brake" in note.detail}
        assert set(noted) | passing >= {joints[i] for i in np.flatnonzero(off > 1.01e-6)}
        for joint, (found, least, most, back) in noted.items():
            i = joints.index(joint)
            assert off[i] > 0.99e-6
            np.testing.assert_allclose((found, least, most), (off[i], low[i], high[i]), rtol=6e-3, atol=1e-9)
            assert back == (tick.status is not hqp.Status.CONSTRAINTS_VIOLATED)
        named, inside = named + len(noted), inside + (not noted)
        q, v = tick.advance()
    assert named > 10
    assert inside > 100


def test_a_joint_returns_if_it_accelerates_as_its_limits_demand() -> None:
    """Drawn postures of an arm whose motors are too weak for its weight; accelerations by Pinocchio."""
    robot, rng, found = hqp.robots.load("ur5"), np.random.default_rng(1), {True: 0, False: 0}
    stack = Stack(Level(Posture(law=PD(100.0, 20.0))), subject_to=[TorqueLimits(scale=0.05), JointLimits()])
    session = hqp.Controller(stack, LEVELS["torque"], deadline=math.inf).session(robot, DT, stuck=False)
    data = robot.model.createData()
    for _ in range(60):
        q = rng.uniform(robot.lower, robot.upper)
        joint, side = int(rng.integers(3)), rng.choice([-1.0, 1.0])
        q[joint] = (robot.upper if side > 0.0 else robot.lower)[joint] + side * 0.05
        tick = session.step(robot.state(q))
        ((name, (*_, back)),) = outside(tick.notes).items()
        assert name == robot.joint_names[joint]
        inwards = -side * pin.aba(robot.model, data, q, np.zeros(6), tick.command)[joint]
        assert back == (inwards > 20.0 * 0.5 - 1e-6), inwards  # approach times return_velocity
        found[back] += 1
    assert min(found.values()) > 5
