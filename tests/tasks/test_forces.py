"""Rows on contact forces: conservative, and exact if documented as exact."""

from __future__ import annotations

import math
from dataclasses import replace
from typing import Any

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st
from scipy.optimize import linprog

import hqp.robots
from hqp import Level, Stack, Torque
from hqp.arrays import Vec
from hqp.errors import DeclarationError
from hqp.tasks import CenterOfPressure, Com, FixedContact, FrictionCone, UnilateralContact

TRAPEZE = ((-0.1, -0.04), (0.15, -0.05), (0.15, 0.05), (-0.1, 0.06))


def holds(element: Any, force: Any) -> bool:
    force = np.asarray(force, dtype=float)
    C, lower, upper = element.force_rows(force.size)
    assert C.shape == (element.rows(None), force.size)
    return bool(np.all(C @ force >= lower - 1e-12) and np.all(C @ force <= upper))


def test_unilateral() -> None:
    assert holds(UnilateralContact(contact="foot"), [5.0, 5.0, 0.0])
    assert not holds(UnilateralContact(contact="foot", minimum=10.0), [0.0, 0.0, 9.0, 0.0, 0.0, 0.0])
    assert UnilateralContact(contact="foot").name == "foot_unilateral"


@given(st.integers(3, 16), st.floats(0.05, 2.0), st.floats(-math.pi, math.pi), st.floats(0.0, 1.5))
def test_pyramid_is_inside_the_cone(edges: int, mu: float, angle: float, part: float) -> None:
    cone = FrictionCone(contact="foot", mu=mu, edges=edges)
    tangential = part * mu * 100.0
    inside = holds(cone, [tangential * math.cos(angle), tangential * math.sin(angle), 100.0])
    if part > 1.0 + 1e-9:
        assert not inside, "outside the cone, allowed by the pyramid"
    if part < math.cos(math.pi / edges) - 1e-9:
        assert inside, "inside the circle that the pyramid holds"


def test_pyramid_reaches_the_cone_at_its_edges() -> None:
    for edges in (3, 4, 8):
        cone = FrictionCone(contact="foot", mu=0.6, edges=edges)
        for i in range(edges):
            b = 2.0 * math.pi * i / edges
            assert holds(cone, [60.0 * math.cos(b), 60.0 * math.sin(b), 100.0])
            assert not holds(cone, [60.01 * math.cos(b), 60.01 * math.sin(b), 100.0])
        assert not holds(cone, [0.0, 0.0, -1.0])


def test_torsion() -> None:
    cone = FrictionCone(contact="foot", mu=0.6, torsion=0.02)
    assert holds(cone, [0.0, 0.0, 100.0, 9.0, 9.0, 1.99])
    assert not holds(cone, [0.0, 0.0, 100.0, 0.0, 0.0, -2.01])
    with pytest.raises(DeclarationError, match="6"):
        cone.force_rows(3)


def wrench_at(point: Vec, normal_force: float) -> Vec:
    """Wrench of a vertical force through a point of the sole."""
    return np.concatenate(([0.0, 0.0, normal_force], np.cross([*point, 0.0], [0.0, 0.0, normal_force])))


def test_a_sole_turns_as_forces_in_its_corners_allow() -> None:
    """The bounds of m_z equal a linear programme over forces in the four corners, each inside its square."""
    x, X, y, Y = sole = (-0.05, 0.12, -0.03, 0.045)
    cone = FrictionCone(contact="foot", mu=0.5, sole=sole)
    C = cone.force_rows(6)[0][8:]
    side = 0.5 * math.sqrt(0.5)
    corners = [(p, q, s, t) for p in (x, X) for q in (y, Y) for s in (side, -side) for t in (side, -side)]
    G = np.array([[s, t, 1.0, *np.cross([p, q, 0.0], [s, t, 1.0])] for p, q, s, t in corners]).T
    rng = np.random.default_rng(0)
    for turn in (1.0, -1.0):
        rows = C[turn * C[:, 5] < 0.0]
        for _ in range(20):
            wrench = G @ rng.exponential(size=len(corners))
            found = linprog(-turn * G[5], A_eq=G[:5], b_eq=wrench[:5])
            assert np.min(rows[:, :5] @ wrench[:5] / np.abs(rows[:, 5])) == pytest.approx(-found.fun, abs=1e-9)
    assert not holds(cone, [0.0, 0.0, 100.0, 100.0 * Y, -100.0 * X, 0.1]), "in a corner nothing holds it"
    with pytest.raises(DeclarationError, match="one of them"):
        FrictionCone(contact="foot", mu=0.5, sole=sole, torsion=0.1)


@pytest.mark.parametrize("polygon", [TRAPEZE, TRAPEZE[:3]])
@pytest.mark.parametrize("first", [True, False])
def test_the_sole_of_a_centre_of_pressure_bounds_the_yaw_moment(polygon: Any, first: bool) -> None:
    """Inside the polygon the yaw moment is bounded by forces in its corners (an LP); inf leaves it free."""
    feet = tuple(FixedContact(frame=frame, name=frame) for frame in ("left_sole_link", "right_sole_link"))
    press = CenterOfPressure(contact=feet[0].name, polygon=polygon)
    cones = [FrictionCone(contact=foot.name, mu=0.5) for foot in feet]
    within = (*feet, press, *cones) if first else (*feet, *cones, press)
    stack = Stack(Level(Com()), subject_to=within)
    completed = {e.name: e for e in Torque().completed(stack)}
    assert completed[cones[1].name] == cones[1]
    cone = completed[cones[0].name]
    assert cone.sole is not None
    C = np.vstack([e.force_rows(6)[0] for e in (cone, CenterOfPressure(contact="foot", rectangle=cone.sole))])
    assert len(C) == 16 + 4
    own = replace(cones[0], torsion=math.inf)
    assert own in tuple(Torque().completed(Stack(Level(own), subject_to=(*feet, press))))
    assert len(own.force_rows(6)[0]) == 8
    corners = np.array(press.corners())
    G = np.array([[*f, *np.cross([*p, 0.0], f)] for p in corners for f in _edges(0.5)]).T
    rng = np.random.default_rng(0)
    inside = 0
    for _ in range(300):
        f = rng.normal(size=6) * [20.0, 20.0, 5.0, 2.0, 2.0, 2.0] + [0.0, 0.0, 100.0, 0.0, 0.0, 0.0]
        if min(C @ f) >= 0.0:
            inside += 1
            assert linprog(np.zeros(G.shape[1]), A_eq=G, b_eq=f).status == 0
    assert inside > 2


def _edges(mu: float) -> list[tuple[float, float, float]]:
    """Forces along the edges of a fine pyramid inside the cone."""
    return [(mu * math.cos(a), mu * math.sin(a), 1.0) for a in np.linspace(0.0, 2.0 * math.pi, 48, endpoint=False)]


@pytest.mark.parametrize("polygon", [TRAPEZE, TRAPEZE[::-1], TRAPEZE[:3]])
def test_centre_of_pressure(polygon: Any) -> None:
    element, corners = CenterOfPressure(contact="foot", polygon=polygon), np.array(polygon)
    rng = np.random.default_rng(0)
    centre = corners.mean(axis=0)
    for _ in range(200):
        inside = rng.dirichlet(np.ones(len(corners))) @ corners
        assert holds(element, wrench_at(inside, 50.0))
        assert not holds(element, wrench_at(inside, -50.0)), "a pull"
    for a, b in zip(corners, np.roll(corners, -1, axis=0), strict=True):
        edge = 0.5 * (a + b)
        assert holds(element, wrench_at(edge + 1e-6 * (centre - edge), 50.0))
        assert not holds(element, wrench_at(edge - 1e-6 * (centre - edge), 50.0))


def test_rectangle_is_the_polygon_of_its_corners() -> None:
    one = CenterOfPressure(contact="foot", rectangle=(-0.1, 0.2, -0.05, 0.04)).force_rows(6)
    corners = ((-0.1, -0.05), (0.2, -0.05), (0.2, 0.04), (-0.1, 0.04))
    other = CenterOfPressure(contact="foot", polygon=corners).force_rows(6)
    for a, b in zip(one, other, strict=True):
        np.testing.assert_allclose(a, b)


def test_rows_are_forces() -> None:
    """A violation of one newton is one in every row: moments count by the lever of the sole, or of the torsion."""
    for size in (0.1, 1.0, 10.0):
        box = (-0.2 * size, 0.2 * size, -0.1 * size, 0.1 * size)
        C, _, _ = CenterOfPressure(contact="foot", rectangle=box).force_rows(6)
        np.testing.assert_allclose(sorted(C[:, 2]), [0.5, 0.5, 1.0, 1.0])
        np.testing.assert_allclose(np.linalg.norm(C[:, 3:5], axis=1), 1.0 / (0.2 * size))
    C, _, _ = FrictionCone(contact="foot", mu=0.6, torsion=0.05).force_rows(6)
    np.testing.assert_allclose(C[-2:, [2, 5]], [[1.0, -20.0], [1.0, 20.0]])
    C, _, _ = FrictionCone(contact="foot", mu=0.6, torsion=0.0).force_rows(6)
    np.testing.assert_allclose(C[-2:, [2, 5]], [[0.0, -1.0], [0.0, 1.0]])


@pytest.mark.parametrize(
    ("cls", "fields", "what"),
    [
        (UnilateralContact, {"minimum": -1.0}, "minimum"),
        (UnilateralContact, {"contact": ""}, "contact"),
        (FrictionCone, {"mu": 0.0}, "mu"),
        (FrictionCone, {"mu": math.nan}, "mu"),
        (FrictionCone, {"mu": 0.5, "edges": 2}, "edges"),
        (FrictionCone, {"mu": 0.5, "edges": 4.5}, "edges"),
        (FrictionCone, {"mu": 0.5, "torsion": -1.0}, "torsion"),
        (CenterOfPressure, {}, "exactly one"),
        (CenterOfPressure, {"rectangle": (0, 1, 0, 1), "polygon": TRAPEZE}, "exactly one"),
        (CenterOfPressure, {"rectangle": (0.1, -0.1, 0, 1)}, "x_min < x_max"),
        (CenterOfPressure, {"rectangle": (0.1, 0.2, math.nan, 1)}, "rectangle"),
        (CenterOfPressure, {"polygon": TRAPEZE[:2]}, "convex"),
        (CenterOfPressure, {"polygon": (TRAPEZE[0], TRAPEZE[2], TRAPEZE[1], TRAPEZE[3])}, "convex"),
        (CenterOfPressure, {"polygon": ((0, 0), (1, 0), (0.2, 0.2), (0, 1))}, "convex"),
        (CenterOfPressure, {"polygon": "sole"}, "polygon"),
    ],
)
def test_fields(cls: Any, fields: dict[str, Any], what: str) -> None:
    with pytest.raises(DeclarationError, match=what):
        cls(**{"contact": "foot", **fields})


def test_declarations_are_plain_data() -> None:
    one = CenterOfPressure(contact="foot", polygon=[[-1, 0], [1, 0], [0, 1]])  # type: ignore[arg-type]
    assert one == CenterOfPressure(contact="foot", polygon=((-1.0, 0.0), (1.0, 0.0), (0.0, 1.0)))
    assert hash(one)


def test_a_point_has_no_centre_of_pressure() -> None:
    with pytest.raises(DeclarationError, match="dimension"):
        CenterOfPressure(contact="foot", rectangle=(-1, 1, -1, 1)).force_rows(3)


def test_no_rows_on_motion() -> None:
    stack = hqp.Stack(hqp.Level(UnilateralContact(contact="l_sole")))
    with pytest.raises(DeclarationError, match="Torque"):
        hqp.Controller(stack, hqp.Velocity()).session(hqp.robots.load("cbi"), 0.002)
