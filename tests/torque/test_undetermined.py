"""Contacts may go as long as the rest determines the motion: at torque level, on legs with soles and with points."""

from __future__ import annotations

from itertools import combinations

import numpy as np
import pytest

import hqp
from hqp import Level, Stack
from hqp.tasks import FixedContact, PointContact, Posture

ROBOTS = ("g1", "cbi", "go2", "anymal")


@pytest.mark.parametrize("name", ROBOTS)
def test_contacts_go_while_rows_and_motors_have_full_rank(name: str) -> None:
    """The rank of [J; U] of the feet that are left, at a drawn configuration."""
    robot = hqp.robots.load(name)
    soles = robot.landmarks.get("soles")
    feet = soles if soles else robot.landmarks["feet"]
    kind = FixedContact if soles else PointContact
    contacts = [kind(frame=foot, name=foot) for foot in feet]
    session = hqp.Controller(Stack(Level(Posture()), subject_to=contacts), hqp.Torque()).session(robot, dt=0.002)
    state = robot.state(robot.random_configuration(np.random.default_rng(2), 0.2))
    rows = {foot: state.jacobian(foot)[: 6 if soles else 3].copy() for foot in feet}
    motors = np.eye(robot.nv)[robot.actuated]
    seen = set()
    for count in range(1, len(feet) + 1):
        for out in combinations(feet, count):
            kept = np.vstack([motors, *(rows[foot] for foot in feet if foot not in out)])
            full = np.linalg.matrix_rank(kept, tol=1e-6) == robot.nv
            why = session.program.refuses(frozenset(out))
            assert (why == "") == full, f"without {out}: {why or 'permitted'}"
            assert full or all(foot in why for foot in out)
            seen.add(full)
    assert seen == {True, False}
