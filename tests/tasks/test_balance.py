"""Centre of mass over a ZMP: the error decays at the declared rate, the ZMP stays in the support, also on slopes."""

from __future__ import annotations

import math
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

import hqp.robots
from hqp import DCM, PD, Level, P, Stack, serial
from hqp.declare.robot import Robot
from hqp.errors import DeclarationError
from hqp.tasks import Balance, CenterOfPressure, Com, FixedContact, Orientation, Posture
from hqp.tasks.polygons import nearest, shrunk, slope
from hqp.tasks.support_polygon import hull

SOLES = {f"{side}_sole_link": (-0.1, 0.1, -0.06, 0.06) for side in ("left", "right")}
FEET = [FixedContact(frame=f) for f in SOLES]
WITHIN = [CenterOfPressure(contact=f, rectangle=r) for f, r in SOLES.items()]


@pytest.fixture(scope="module")
def robot() -> Robot:
    return hqp.robots.load("talos")


def stack(balance: Balance) -> Stack:
    body = [Level(Orientation(frame="base_link", name="trunk")), Level(Posture())]
    return Stack(Level(balance, Com(axes="z", name="height")), *body, subject_to=[*FEET, *WITHIN])


def ready(balance: Balance) -> Balance:
    found = balance.among([*FEET, *WITHIN])
    assert isinstance(found, Balance)
    return found


@pytest.mark.parametrize("k", [2.0, 5.0])
def test_the_error_of_the_dcm_falls_as_its_gain_says(robot: Robot, k: float) -> None:
    """e(t) = e(0) exp(-k t) while the support reaches the ZMP, in a loop at torque level."""
    dt, balance = 0.001, Balance(law=DCM(k))
    run = hqp.Controller(stack(balance), hqp.Torque(holding=None), price=0, deadline=np.inf).session(robot, dt)
    element, state = ready(balance), robot.state(robot.home)
    goal = state.com()[:2] + [0.01, -0.008]
    omega = math.sqrt(9.81 / (state.com()[2] - element.corners(state)[:, 2].mean()))
    errors = []
    for _ in range(400):
        errors.append(state.com()[:2] + state.com_velocity()[:2] / omega - goal)
        tick = run.step(state, balance.at(goal, goal))
        assert tick.status.solved, tick.notes
        q, v = tick.advance()
        state = robot.state(q, v)
    expected = errors[0] * math.exp(-k * 0.4)
    np.testing.assert_allclose(errors[-1], expected, atol=0.02 * np.abs(errors[0]).max())


def test_the_forces_act_at_the_zmp_that_was_asked_for(robot: Robot) -> None:
    """Forward at the edge of the support: the wrench of both feet has no horizontal moment about p."""
    balance = Balance(margin=0.02)
    run = hqp.Controller(stack(balance), hqp.Torque(holding=None), price=0, deadline=np.inf).session(robot, 0.002)
    state = robot.state(robot.home)
    run.step(state)
    reference = balance.at(state.com()[:2], state.com()[:2] - [0.3, 0.0])
    tick = run.step(state, reference)
    assert tick.status.solved
    p, wanted = ready(balance).zmp(state, reference.value)
    assert wanted[0] > p[0] + 0.1
    assert p[0] == pytest.approx(max(x for x, _ in ready(balance).corners(state)[:, :2]))
    qdd = run.program.acceleration(tick.solution.x)
    a = (state.com_jacobian() @ qdd + state.com_drift())[:2]
    height = state.com()[2] - ready(balance).corners(state)[:, 2].mean()
    np.testing.assert_allclose(a, 9.81 / height * (state.com()[:2] - p), atol=1e-6)


def test_with_the_zmp_at_the_capture_point_it_stays_there(robot: Robot) -> None:
    """d xi/dt = dc/dt + a / omega = 0 for a robot that moves at 0.1 m/s; at rest xi is below the CoM."""
    for height in (None, 0.9):
        element = ready(Balance(height=height))
        still = robot.state(robot.home)
        np.testing.assert_allclose(element.dcm(still), still.com()[:2])
        state = robot.state(robot.home, np.concatenate(([0.1, -0.04], np.zeros(robot.nv - 2))))
        xi, omega = element.dcm(state), element.omega(state)
        assert xi[0] > state.com()[0] + 0.02
        p, _ = element.zmp(state, np.concatenate((xi, xi)))
        np.testing.assert_allclose(p, xi)
        a = omega**2 * (state.com()[:2] - p)
        np.testing.assert_allclose(state.com_velocity()[:2] + a / omega, 0.0, atol=1e-12)
        if height is None:  # the robot's own height: the demand is that acceleration
            np.testing.assert_allclose(-element.error(state, np.concatenate((xi, xi))), a, rtol=1e-2)


@pytest.mark.parametrize("height", [None, 0.7])
def test_the_dcm_moves_as_its_derivative_says(robot: Robot, height: float | None) -> None:
    """d xi/dt = v_c + a_c / omega - v_c omega' / omega^2, by differences along a motion; omega of the height."""
    rng, step = np.random.default_rng(0), 1e-5
    element = ready(Balance(height=height))
    for _ in range(5):
        q = robot.integrate(robot.home, 0.05 * rng.normal(size=robot.nv), 1.0)
        v, a = 0.3 * rng.normal(size=robot.nv), rng.normal(size=robot.nv)
        found, omegas = [], []
        for h in (-step, step):
            state = robot.state(robot.integrate(q, h * (v + 0.5 * h * a), 1.0), v + h * a)
            found.append(element.dcm(state))
            omegas.append(element.omega(state))
        state = robot.state(q, v)
        omega, turned = element.omega(state), (omegas[1] - omegas[0]) / (2.0 * step)
        rate = state.com_velocity()[:2]
        above = state.com()[2] - element.corners(state)[:, 2].mean() if height is None else height
        assert omega == pytest.approx(math.sqrt(9.81 / above), rel=0.05 if height is None else 1e-12)
        acceleration = element.jacobian(state) @ a + element.drift(state)
        expected = rate + acceleration / omega - rate * turned / omega**2
        np.testing.assert_allclose((found[1] - found[0]) / (2.0 * step), expected, atol=1e-6)


@pytest.mark.long
@settings(max_examples=25)
@given(st.integers(0, 10_000))
def test_on_a_slope_the_line_of_force_goes_through_the_zmp(seed: int) -> None:
    """Without vertical acceleration the ground's force m (a - g) points from p on the slope to the centre of mass."""
    rng = np.random.default_rng(seed)
    robot = hqp.robots.load("talos")
    q = robot.integrate(
        robot.home, np.concatenate((np.zeros(3), 0.2 * rng.normal(size=3), np.zeros(robot.nv - 6))), 1.0
    )
    state, element = robot.state(q, 0.3 * rng.normal(size=robot.nv)), ready(Balance())
    reference = np.concatenate((state.com()[:2], state.com()[:2])) + 0.1 * rng.normal(size=4)
    corners, (p, _) = element.corners(state), element.zmp(state, reference)
    plane = np.linalg.lstsq(np.column_stack((np.ones(len(corners)), corners[:, :2])), corners[:, 2], rcond=None)[0]
    arm = state.com() - [*p, plane @ [1.0, *p]]
    force = np.array([*-element.error(state, reference), 9.81])
    assert np.abs(np.cross(arm, force)).max() < 1e-9 * 9.81


@settings(max_examples=25)
@given(st.integers(0, 10_000))
def test_the_nearest_point_is_in_the_polygon_and_no_other_is_nearer(seed: int) -> None:
    rng = np.random.default_rng(seed)
    cloud, point = rng.normal(size=(int(rng.integers(3, 12)), 2)), 2.0 * rng.normal(size=2)
    corners = cloud[hull(cloud)]
    found = nearest(corners, point)
    side = np.roll(corners, -1, axis=0) - corners
    normal = np.column_stack((side[:, 1], -side[:, 0]))
    assert np.all(np.sum(normal * (found - corners), axis=1) < 1e-9)
    others = rng.dirichlet(np.ones(len(corners)), 200) @ corners
    assert np.linalg.norm(others - point, axis=1).min() > np.linalg.norm(found - point) - 1e-9
    beside = nearest(corners, point + 1e-6)
    assert np.linalg.norm(beside - found) < 2e-6, "it moves no faster than the point"


def test_smaller_polygons_and_planes() -> None:
    assert shrunk(((-2.0, -1.0), (2.0, -1.0), (2.0, 1.0), (-2.0, 1.0)), 0.5)[2] == pytest.approx((1.5, 0.5))
    assert shrunk(((0.0, 0.0), (1.0, 0.0), (1.0, 0.2)), 0.3)[0] == pytest.approx((0.3, 0.1))
    line = np.array([[0.0, 0.0, 0.0], [1.0, 1.0, 0.5], [2.0, 2.0, 1.0]])
    np.testing.assert_array_equal(slope(line), 0.0)


def test_what_it_takes(robot: Robot) -> None:
    declared = stack(Balance(law=DCM(4.0), margin=0.01, height=0.8, name="balance"))
    assert serial.loads(serial.dumps(declared)) == declared
    for wrong in (P(1.0), PD(1.0), None):
        with pytest.raises(DeclarationError, match="DCM"):
            Balance(law=wrong)
    alone = Stack(Level(Balance(points=tuple((f, x, x, 0.0) for f in SOLES for x in (0.0, 0.1)))))
    with pytest.raises(DeclarationError, match="a law of order 1"):
        hqp.Controller(alone, hqp.Velocity()).session(robot, 0.002)
    hqp.Controller(alone, hqp.Acceleration()).session(robot, 0.002)
    with pytest.raises(DeclarationError, match="points"):
        Balance().rows(robot)
    with pytest.raises(DeclarationError, match="no saturation"):
        DCM(3.0, max_acceleration=1.0)
    bad: list[Any] = [{"margin": -0.1}, {"height": 0.0}, {"contacts": 3}, {"points": (("a", 0, 0, 0),)}]
    for fields in bad:
        with pytest.raises(DeclarationError, match=next(iter(fields))):
            Balance(**fields)


def test_the_page_declares_one_in_a_file() -> None:
    """Read the page's text to an equal element, write it and read it back."""
    page = (Path(__file__).parents[2] / "docs" / "elements" / "balance.md").read_text(encoding="utf-8")
    found = serial.loads(page.partition("```toml\n")[2].partition("```")[0])
    feet = "left_sole_link", "right_sole_link"
    assert found == Stack(Level(Balance(law=DCM(3.0), contacts=feet, margin=0.005, height=0.85)))
    assert serial.loads(serial.dumps(found)) == found
