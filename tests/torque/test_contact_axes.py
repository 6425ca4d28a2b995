"""Axes of contact forces: cones and ``contact_forces`` agree in any heading, on any slope."""

from __future__ import annotations

import math
from typing import Any

import numpy as np
import pinocchio as pin
import pytest

import hqp
from hqp import Level, Stack
from hqp.tasks import FixedContact, FrictionCone, PointContact, Posture


@pytest.mark.parametrize("name", ["talos", "go2"])
def test_rows_of_a_cone_bound_the_force_in_its_axes(name: str) -> None:
    """C f of the element, with f of ``contact_forces``, equals the rows that the solver sees."""
    robot = hqp.robots.load(name)
    frames = robot.landmarks["soles" if name == "talos" else "feet"]
    make: Any = FixedContact if name == "talos" else PointContact
    feet = [make(frame=frame) for frame in frames]
    cones = [FrictionCone(contact=frame, mu=0.6, torsion=math.inf) for frame in frames]
    stack = Stack(Level(Posture()), subject_to=[*feet, *cones])
    session = hqp.Controller(stack, hqp.Torque(), deadline=math.inf).session(robot, 0.002)
    program: Any = session.program
    rng = np.random.default_rng(0)
    for heading in np.linspace(-2.0 * math.pi, 2.0 * math.pi, 7):
        q = robot.integrate(robot.home, rng.uniform(-0.2, 0.2, robot.nv), 1.0)
        turn = pin.Quaternion(pin.rpy.rpyToMatrix(0.0, 0.0, heading)) * pin.Quaternion(*q[[6, 3, 4, 5]])
        q[3:7] = turn.coeffs()
        lean = rng.uniform(-0.2, 0.2, 2)
        normal = np.array([*lean, math.sqrt(1.0 - lean @ lean)])
        session.step(robot.state(q), *(foot.at(normal=normal) for foot in feet))
        tau = rng.normal(size=robot.actuated.size) * 20.0
        forces, axes, world = (
            program.contact_forces(tau),
            program.contact_axes(),
            program.contact_forces(tau, world=True),
        )
        for cone in cones:
            place = program.places[cone.name]
            rows = program.problem.levels[place.level]
            force, turned = forces[cone.contact], axes[cone.contact]
            found = (rows.A @ tau - rows.lower)[place.part]
            assert found == pytest.approx(cone.force_rows(force.size)[0] @ force, abs=1e-7 * np.abs(force).max())
            assert turned.T @ turned == pytest.approx(np.eye(3), abs=1e-12)
            assert np.linalg.det(turned) == pytest.approx(1.0)
            assert turned[:, 2] == pytest.approx(normal)
            assert turned @ force[:3] == pytest.approx(world[cone.contact][:3])
