"""Wheels on Dreamer: geometry, ranks, ground normals and planes; the biarticular coupling."""

from __future__ import annotations

from collections.abc import Callable
from typing import Any

import numpy as np
import pytest

import hqp
import hqp.robots
from hqp import Level, P, Stack
from hqp.arrays import Mat
from hqp.errors import DeclarationError, FrameNotFound
from hqp.tasks import JointCoupling, OmniWheelContact, Position, WheelContact

from .conftest import assembly

WHEELS = ("wheel_0", "wheel_1", "wheel_2")
Written = Callable[..., Any]


@pytest.fixture(scope="module")
def dreamer() -> Any:
    return hqp.robots.load("dreamer")


def on_the_ground(robot: Any, rng: np.random.Generator) -> Any:
    """A configuration with the base level, wheels and joints anywhere."""
    q = robot.random_configuration(rng, 0.5)
    yaw = rng.uniform(-np.pi, np.pi)
    q[2:7] = robot.home[2], 0.0, 0.0, np.sin(yaw / 2), np.cos(yaw / 2)
    return q


def constraints(robot: Any, q: Any, wheels: list[Any]) -> Mat:
    """J_constr ``(7, nv)``: coupling, then the wheels."""
    state = robot.state(q)
    coupling = JointCoupling({"torso_hip": 1.0, "torso_thorax": -1.0})
    return np.vstack([coupling.jacobian(state), *(wheel.jacobian(state) for wheel in wheels)])


def test_constraints_and_actuation_have_full_rank(dreamer: Any) -> None:
    rng = np.random.default_rng(0)
    wheels = [OmniWheelContact(wheel=w) for w in WHEELS]
    for _ in range(10):
        J = constraints(dreamer, on_the_ground(dreamer, rng), wheels)
        assert np.linalg.matrix_rank(J) == 7
        assert np.linalg.matrix_rank(np.vstack((J, dreamer.actuation))) == 19


def test_rolling_along_the_axle_leaves_the_wheels_out(dreamer: Any) -> None:
    """With the printed direction, the axle's own, its rows have no wheel speed, and [J; U] loses rank."""
    wheels = []
    for w in WHEELS:  # rotating an axle by 90 degrees about the vertical makes the true axle the direction of the row
        x, y, _ = dreamer.wheels[w].axle
        wheels.append(OmniWheelContact(wheel=w, axle=(y, -x, 0.0)))
    J = constraints(dreamer, dreamer.home, wheels)
    columns = dreamer.joints("wheels")
    assert np.abs(J[:, columns]).max() < 1e-12
    assert np.linalg.matrix_rank(np.vstack((J, dreamer.actuation))) == 18
    right = constraints(dreamer, dreamer.home, [OmniWheelContact(wheel=w) for w in WHEELS])
    np.testing.assert_allclose(np.abs(right[1::2, columns]), 0.101 * np.eye(3), atol=1e-12)


def test_base_rolls_as_the_wheels_turn(dreamer: Any) -> None:
    """Equal wheel speeds yaw the base at r / (distance of the wheels) times the speed."""
    J = constraints(dreamer, dreamer.home, [OmniWheelContact(wheel=w) for w in WHEELS])
    v = np.zeros(dreamer.nv)
    v[dreamer.joints("wheels")] = 1.0
    v[:6] = -np.linalg.lstsq(J[1:, :6], J[1:] @ v, rcond=None)[0]
    assert np.abs(J @ v).max() < 1e-12
    np.testing.assert_allclose(np.abs(v[:6]), [0, 0, 0, 0, 0, 0.101 / 0.24], atol=1e-6)


@pytest.mark.parametrize("kind", [OmniWheelContact, WheelContact])
def test_rows_on_any_ground(dreamer: Any, kind: Any, written: Written) -> None:
    """With any fixed normal, rows are the contact point's velocity, drift is the rate of J v, native rows agree."""
    rng = np.random.default_rng(1)
    element = kind(wheel="wheel_1", radius=0.3, axle=(0.2, 1.0, -0.4))
    for _ in range(5):
        q, v, normal = dreamer.random_configuration(rng), rng.normal(size=19), rng.normal(size=3)
        normal /= np.linalg.norm(normal)
        state = dreamer.state(q, v)
        reference = element.at(element.value(state) - 0.05 * normal, normal=7.0 * normal)
        block = written(element, state, reference)
        np.testing.assert_allclose(block.J, element.jacobian(state, normal), atol=1e-12)
        np.testing.assert_allclose(block.drift, element.drift(state, normal), atol=1e-11)
        np.testing.assert_allclose(block.error, [*[0.0] * (len(block.error) - 1), 0.05], atol=1e-12)
        p, R = state.position("wheel_1"), state.rotation("wheel_1")
        axle = R @ np.array(element.geometry(dreamer)[1])
        rolling = np.cross(normal, axle)
        rolling /= np.linalg.norm(rolling)
        delta = -0.3 * normal
        h, moved = 1e-6, []
        for s in (h, -h):
            after = dreamer.state(dreamer.integrate(q, v, s))
            moved.append(after.position("wheel_1") + after.rotation("wheel_1") @ R.T @ delta - p - delta)
        slip = (moved[0] - moved[1]) / (2 * h)
        along = [rolling, np.cross(rolling, normal), normal] if kind is WheelContact else [rolling, normal]
        np.testing.assert_allclose(block.J @ v, np.array(along) @ slip, atol=1e-7)
        rate = [element.jacobian(dreamer.state(dreamer.integrate(q, v, s), v), normal) @ v for s in (h, -h)]
        np.testing.assert_allclose((rate[0] - rate[1]) / (2 * h), block.drift, atol=1e-6 * max(1, np.abs(v).max() ** 2))


@pytest.mark.parametrize("native", [True, False], ids=["native", "readable"])
def test_a_change_of_normal_does_not_throw_the_wheel_off_its_plane(dreamer: Any, native: bool) -> None:
    element = OmniWheelContact(wheel="wheel_0")
    rows = assembly(element, dreamer, 1, native=native)
    hold = element.hold(dreamer.state())

    def height(x: float, z: float, normal: Any) -> float:
        q = dreamer.home.copy()
        q[0] += x
        q[2] += z
        rows.fill(dreamer.state(q), {element.name: element.at(hold.value, normal=normal)}, ())
        return float(rows.error[1])

    slope = [-np.sin(0.12), 0.0, np.cos(0.12)]
    assert height(0.0, 0.0, None) == 0.0
    assert height(2.0, 0.001, None) == pytest.approx(0.001)
    assert height(2.0, 0.001, slope) == pytest.approx(0.001)  # the plane through the start would be 0.24 m away
    assert height(2.0 + np.cos(0.12), 0.001 + np.sin(0.12), slope) == pytest.approx(0.001)
    assert height(2.0 + np.cos(0.12), 0.001 + np.sin(0.12), None) == pytest.approx(0.001)


@pytest.mark.parametrize("native", [True, False], ids=["native", "readable"])
@pytest.mark.parametrize("axis", range(3))
def test_a_value_that_moves_along_one_axis_moves_the_plane(dreamer: Any, native: bool, axis: int) -> None:
    element, normal = OmniWheelContact(wheel="wheel_0"), np.array([-0.3, 0.2, np.sqrt(0.87)])
    rows = assembly(element, dreamer, 1, native=native)
    state = dreamer.state()
    value, heights = element.hold(state).value, list[float]()
    for shift in (0.0, 0.1):
        rows.fill(state, {element.name: element.at(value + shift * np.eye(3)[axis], normal=normal)}, ())
        heights.append(float(rows.error[1]))
    assert heights[1] - heights[0] == pytest.approx(-0.1 * normal[axis])


def test_an_axle_along_the_normal_gives_zero_rows_not_nan(dreamer: Any, written: Written) -> None:
    element = WheelContact(wheel="wheel_0", axle=(0.0, 0.0, 1.0))
    state = dreamer.state(dreamer.home, np.ones(19))
    block = written(element, state, element.hold(state))
    assert np.isfinite(block.J).all()
    assert np.isfinite(block.drift).all()
    assert not block.J[:2].any()
    assert np.isfinite(element.drift(state)).all()


def test_fields(dreamer: Any) -> None:
    assert OmniWheelContact(wheel="wheel_0").name == "wheel_0"
    assert OmniWheelContact(wheel="wheel_0").rows(dreamer) == 2
    assert WheelContact(wheel="wheel_0").rows(dreamer) == 3
    assert OmniWheelContact(wheel="wheel_0").geometry(dreamer)[0] == 0.101
    with pytest.raises(DeclarationError, match="radius"):
        OmniWheelContact(wheel="wheel_0", radius=-1.0)
    with pytest.raises(DeclarationError, match="axle"):
        OmniWheelContact(wheel="wheel_0", axle=(0.0, 0.0, 0.0))
    with pytest.raises(DeclarationError, match="wheel_0, wheel_1, wheel_2"):
        OmniWheelContact(wheel="hand").rows(dreamer)
    with pytest.raises(FrameNotFound, match="wheel_0"):
        OmniWheelContact(wheel="whel_0").rows(dreamer)
    with pytest.raises(DeclarationError, match=r"normal.*\(3,\)"):
        OmniWheelContact(wheel="wheel_0").at(normal=[0.0, 1.0])
    with pytest.raises(DeclarationError, match="zero"):
        OmniWheelContact(wheel="wheel_0").at(gravity_normal=[0.0, 0.0, 0.0])
    reference = OmniWheelContact(wheel="wheel_0").at(normal=[0, 0, 2], gravity_normal=[0, 3, 4], velocity=[1, 0])
    np.testing.assert_allclose(reference.normal, [0, 0, 1])
    np.testing.assert_allclose(reference.gravity_normal, [0, 0.6, 0.8])
    assert OmniWheelContact(wheel="wheel_0").at(normal=[np.nan, 0, 1]).finite is False


def test_coupling(dreamer: Any, written: Written) -> None:
    coupling = JointCoupling({"torso_hip": 1.0, "torso_thorax": -1.0}, name="biarticular", offset=0.1)
    assert coupling == JointCoupling((("torso_hip", 1.0), ("torso_thorax", -1.0)), name="biarticular", offset=0.1)
    assert hash(coupling) == hash(
        JointCoupling([["torso_hip", 1], ["torso_thorax", -1]], name="biarticular", offset=0.1)
    )
    assert JointCoupling({"torso_hip": 1.0, "torso_thorax": -1.0}).name == "torso_hip_torso_thorax"
    v = np.zeros(19)
    v[dreamer.joints("torso_hip")] = 0.3
    state = dreamer.state(dreamer.integrate(dreamer.home, v, 1.0))
    # the offset is held, not the joint angles of the first tick
    assert written(coupling, state, coupling.hold(state)).error[0] == pytest.approx(0.2)
    assert written(coupling, state, coupling.at(0.3)).error[0] == pytest.approx(0.0)
    for bad in ({}, {"a": 0.0}, {"a": np.nan}, [("a", 1.0), ("a", 2.0)], [1.0], {"": 1.0}, None):
        with pytest.raises(DeclarationError, match="coefficient"):
            JointCoupling(bad)  # type: ignore[arg-type]
    with pytest.raises(DeclarationError, match="no group names"):
        JointCoupling({"arm": 1.0}).rows(dreamer)


@pytest.mark.long
def test_rolling_away_keeps_plane_and_coupling(dreamer: Any) -> None:
    """2 s at velocity level: the base rolls 0.4 m, wheels stay on the ground, a coupling error decays."""
    coupling = JointCoupling({"torso_hip": 1.0, "torso_thorax": -1.0})
    base = Position(frame="base", axes="xy", law=P(3.0))
    constraints = [coupling, *(OmniWheelContact(wheel=w) for w in WHEELS)]
    controller = hqp.Controller(Stack(Level(base), subject_to=constraints), hqp.Velocity(), solver="nullspace")
    session = controller.session(dreamer, dt=0.002)
    v = np.zeros(19)
    v[dreamer.joints("torso_hip")] = 0.1
    q = dreamer.integrate(dreamer.home, v, 1.0)
    start = {w: dreamer.state(q).position(w) for w in WHEELS}
    assert abs(coupling.value(dreamer.state(q))[0]) > 0.09
    slip = 0.0
    for _ in range(1000):
        state = dreamer.state(q)
        rolling = [wheel.jacobian(state)[0] for wheel in constraints[1:]]
        tick = session.step(state, base.at([0.4, 0.1]))
        slip = max(slip, np.abs(np.array(rolling) @ tick.solution.x).max())  # type: ignore[union-attr]
        q, _ = tick.advance()
    state = dreamer.state(q)
    np.testing.assert_allclose(state.position("base")[:2], [0.4, 0.1], atol=2e-3)
    assert slip < 1e-9
    assert abs(coupling.value(state)[0]) < 1e-5
    for w in WHEELS:
        assert abs(state.position(w)[2] - start[w][2]) < 1e-6
