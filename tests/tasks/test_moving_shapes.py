"""Moving shapes of the world: rate and drift of a distance include their motion, and a hand gives way."""

from __future__ import annotations

import math
from collections.abc import Callable
from pathlib import Path
from typing import Any

import numpy as np
import pinocchio as pin
import pytest

import hqp
from hqp import Level, P, Stack, shapes
from hqp.errors import DeclarationError
from hqp.tasks import CollisionAvoidance, JointLimits, Position, Posture

from .test_collision import write_box

WORLD = (
    shapes.sphere("ball", 0.1),
    shapes.capsule("pole", 0.05, 0.6),
    shapes.box("box", (0.2, 0.3, 0.25)),
    shapes.half_space("wall"),
)


@pytest.fixture(scope="module")
def panda() -> Any:
    if "panda" not in hqp.robots.names():
        pytest.skip("needs example-robot-data")
    return hqp.robots.load("panda")


def moved(pose: Any, rate: Any, h: float) -> Any:
    found = pose.copy()
    found[:3, 3] += h * rate[:3]
    found[:3, :3] = pin.exp3(h * rate[3:]) @ pose[:3, :3]
    return found


def around(panda: Any, rng: np.random.Generator) -> tuple[dict[str, Any], dict[str, Any]]:
    """Poses near the hand, and velocities."""
    hand, poses, rates = panda.state().position("panda_hand"), {}, {}
    for shape in WORLD:
        pose = np.eye(4)
        pose[:3, :3] = pin.exp3(rng.normal(size=3))
        away = rng.normal(size=3)
        pose[:3, 3] = hand + 0.35 * away / np.linalg.norm(away)
        if shape.name == "wall":
            pose[:3, 3] = hand - 0.2 * pose[:3, 2]
        poses[shape.name], rates[shape.name] = pose, rng.normal(size=6)
    return poses, rates


@pytest.mark.long
@pytest.mark.parametrize("order", [1, 2])
def test_native_rows_equal_readable_rows(panda: Any, order: int, written: Callable[..., Any]) -> None:
    element, rng = CollisionAvoidance(pairs="world", world=WORLD, influence=0.6), np.random.default_rng(1)
    near = 0
    for _ in range(10):
        poses, rates = around(panda, rng)
        q, v = panda.integrate(panda.home, 0.2 * rng.normal(size=panda.nv), 1.0), rng.normal(size=panda.nv)
        at = element.at(poses, rates)
        state = panda.state(q, v)
        native = written(element, state, at, order)
        readable = written(element, state, at, order, native=False)
        np.testing.assert_allclose(native.J, readable.J, atol=1e-9)
        np.testing.assert_allclose(native.lower, readable.lower, atol=1e-5, rtol=1e-6)
        still = written(element, state, element.at(poses), order)
        finite = np.isfinite(native.lower)
        near += int(finite.sum())
        assert not finite.any() or np.abs(native.lower[finite] - still.lower[finite]).max() > 1e-3
    assert near > 50


@pytest.mark.long
def test_rates_and_drifts_by_differences(panda: Any) -> None:
    """d/dt of a distance is J v + carried, its second derivative at zero acceleration the drift."""
    element, rng = CollisionAvoidance(pairs="world", world=WORLD, influence=0.6), np.random.default_rng(2)
    h, compared = 1e-5, 0
    for _ in range(10):
        poses, rates = around(panda, rng)
        q, v = panda.integrate(panda.home, 0.2 * rng.normal(size=panda.nv), 1.0), rng.normal(size=panda.nv)

        def at(
            t: float, q: Any = q, v: Any = v, poses: Any = poses, rates: Any = rates
        ) -> tuple[dict[int, float], dict[int, float], dict[int, float]]:
            value = element.at({n: moved(p, rates[n], t) for n, p in poses.items()}, rates).value
            state = panda.state(panda.integrate(q, v, t), v)
            near = element.near(state, value)
            rate = element.jacobian(state, value) @ v + element.carried(state, value)
            drift = element.drift(state, value)
            keys = [None if n is None else n.pair for n in near]
            tables = ([n.distance if n else 0.0 for n in near], rate, drift)
            found = [{k: float(x) for k, x in zip(keys, table, strict=True) if k is not None} for table in tables]
            return found[0], found[1], found[2]

        (before, slow, _), (_, rate, drift), (after, fast, _) = (at(t) for t in (-h, 0.0, h))
        for pair in before.keys() & after.keys() & rate.keys():
            assert (after[pair] - before[pair]) / (2 * h) == pytest.approx(rate[pair], abs=1e-3)
            change = (fast[pair] - slow[pair]) / (2 * h)
            if abs(change) < 100.0:  # skip jumps of the nearest point
                assert drift[pair] == pytest.approx(change, abs=1e-2, rel=1e-2)
                compared += 1
    assert compared > 50


def from_ball(state: Any, centre: Any, radius: float) -> float:
    """Distance of a ball from the nearest capsule of the robot [m]."""
    state.kinematics()
    capsules = state.robot.capsules
    places = [state.robot.bodies[c.body][5] for c in capsules]
    p, R = np.array([p for p, _ in places]), np.array([R for _, R in places])
    a, b = (
        p + np.einsum("kij,kj->ki", R, np.array(ends)) for ends in zip(*((c.a, c.b) for c in capsules), strict=True)
    )
    along, way = b - a, centre - a
    share = np.clip(np.sum(way * along, axis=1) / np.maximum(np.sum(along**2, axis=1), 1e-12), 0.0, 1.0)
    away = np.linalg.norm(way - share[:, None] * along, axis=1)
    return float(np.min(away - [c.radius for c in capsules])) - radius


@pytest.mark.long
@pytest.mark.parametrize("formulation", [hqp.Velocity(), hqp.Acceleration()], ids=["velocity", "acceleration"])
def test_a_hand_gives_way_to_a_ball(panda: Any, formulation: Any) -> None:
    """A ball crosses the hand's target at 0.3 m/s: no contact with its velocity given, contact without."""
    frame, dt, least = "panda_hand_tcp", 0.002, {}
    order = 1 if isinstance(formulation, hqp.Velocity) else 2
    place = panda.state().position(frame)
    for told in (True, False):
        avoid = CollisionAvoidance(
            pairs="world", world=shapes.sphere("ball", 0.08), clearance=0.02, influence=0.15, recovery=0.1
        )
        hand = Position(frame=frame, law=P(3.0, max_velocity=0.5) if order == 1 else None)
        stack = Stack(Level(hand), Level(Posture()), subject_to=[JointLimits(), avoid])
        session = hqp.Controller(stack, formulation, deadline=math.inf).session(panda, dt)
        q, v, least[told] = panda.home, np.zeros(panda.nv), math.inf
        for k in range(1500):
            ball, rate = place + [0.0, 0.5 - 0.3 * dt * k, 0.03], {"ball": [0.0, -0.3, 0.0]}
            world = avoid.at({"ball": ball}, rate if told else None)
            q, v = session.step(panda.state(q, v), hand.at(place), world).advance()
            apart = from_ball(panda.state(q), ball + [0.0, -0.3 * dt, 0.0], 0.08) - avoid.clearance
            least[told] = min(least[told], apart)
    assert least[True] > -1e-3
    assert least[False] < -0.01


def test_bad_velocities() -> None:
    avoid = CollisionAvoidance(pairs="world", world=WORLD)
    with pytest.raises(DeclarationError, match="velocity of ball"):
        avoid.at({}, {"ball": [0.0, 1.0]})
    with pytest.raises(DeclarationError, match="bell"):
        avoid.at({}, {"bell": [0.0, 0.0, 1.0]})


@pytest.fixture
def block(tmp_path: Path) -> Any:
    """A mesh of a box, and the box."""
    path = tmp_path / "block.stl"
    write_box(path, np.array([0.1, 0.15, 0.125]))
    return shapes.mesh("block", path), shapes.box("block", (0.2, 0.3, 0.25))


@pytest.mark.long
@pytest.mark.parametrize("order", [1, 2])
def test_a_moving_mesh_has_the_rows_of_the_box_that_it_is(panda: Any, block: Any, order: int, written: Any) -> None:
    """J and the bounds with the motion of the world, drift included; coal's distances are exact to 1e-6."""
    mesh, box = (CollisionAvoidance(pairs="world", world=shape, influence=0.6) for shape in block)
    rng, compared = np.random.default_rng(4), 0
    for _ in range(12):
        poses, rates = around(panda, rng)
        pose, rate = {"block": poses["box"]}, {"block": rates["box"]}
        q, v = panda.integrate(panda.home, 0.2 * rng.normal(size=panda.nv), 1.0), rng.normal(size=panda.nv)
        rows = []
        for element in (mesh, box):
            at, state = element.at(pose, rate), panda.state(q, v)
            near = element.near(state, at.value)
            own = written(element, state, at, order, native=False)
            rows.append({n.pair: (n, own.J[k], own.lower[k]) for k, n in enumerate(near) if n is not None})
        for pair in rows[0].keys() & rows[1].keys():
            (n, J, lower), (m, K, other) = rows[0][pair], rows[1][pair]
            if m.distance < 0.01 or np.linalg.norm(n.point - m.point) > 1e-3:
                continue  # one of several nearest points
            np.testing.assert_allclose(J, K, atol=5e-3)
            assert lower == pytest.approx(other, abs=2e-2 if order == 1 else 0.5, rel=2e-2)
            compared += 1
    assert compared > 20


@pytest.mark.long
@pytest.mark.parametrize(
    "formulation",
    [hqp.Velocity(), pytest.param(hqp.Acceleration(), marks=pytest.mark.slow)],
    ids=["velocity", "acceleration"],
)
def test_a_hand_gives_way_to_a_moving_mesh(panda: Any, block: Any, formulation: Any) -> None:
    frame, dt, least = "panda_hand_tcp", 0.005, math.inf
    order = 1 if isinstance(formulation, hqp.Velocity) else 2
    place = panda.state().position(frame)
    fingers = ("panda_hand", "panda_leftfinger", "panda_rightfinger", "panda_link7")
    avoid = CollisionAvoidance(
        pairs=tuple((f, "block") for f in fingers), world=block[0], clearance=0.02, influence=0.15, recovery=0.1
    )
    hand = Position(frame=frame, law=P(3.0, max_velocity=0.5) if order == 1 else None)
    stack = Stack(Level(hand), Level(Posture()), subject_to=[JointLimits(), avoid])
    session = hqp.Controller(stack, formulation, deadline=math.inf).session(panda, dt)
    q, v = panda.home, np.zeros(panda.nv)
    for k in range(300):
        pose = np.eye(4)
        pose[:3, 3] = place + [0.0, 0.45 - 0.2 * dt * k, 0.03]
        at = avoid.at({"block": pose}, {"block": np.array([0.0, -0.2, 0.0, 0.0, 0.0, 0.0])})
        tick = session.step(panda.state(q, v), at, hand.at(place))
        assert tick.status == hqp.Status.OPTIMAL
        q, v = tick.advance()
        least = min([least, *(n.distance for n in avoid.near(panda.state(q), at.value) if n is not None)])
    assert 0.012 < least < 0.03
    assert np.linalg.norm(panda.state(q).position(frame) - place) > 0.04
