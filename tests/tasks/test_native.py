"""Every native operation matches the readable functions of its element."""

from __future__ import annotations

import dataclasses
from itertools import product
from typing import Any

import numpy as np
import pytest

import hqp
import hqp.programs.assembly
import hqp.tasks as t
from hqp import PD, Level, P, Stack
from hqp.arrays import Mat, Vec
from hqp.declare.element import Element, Inequality, plan_of
from hqp.declare.law import Law, pace
from hqp.declare.reference import Reference
from hqp.programs.assembly import Assembly
from hqp.robots import Robot

from .test_derivatives import CLASSES, NAMES, examples

pytestmark = pytest.mark.skipif(hqp.programs.assembly.native is None, reason="no native assembly here")

CASES = [(robot, name) for robot in ("cbi", "panda", "dreamer", "tiago") for name in CLASSES]
PLANLESS: set[str] = set()
"""Classes with motion rows that need no native operation."""
OTHER = {
    "dreamer": {"f": "hand", "o": "base", "a": "torso_yaw", "b": "torso_hip", "c": "torso_thorax"},
    "tiago": {
        "f": "arm_tool_link",
        "o": "torso_lift_link",
        "a": "arm_2_joint",
        "b": "wheel_left_joint",
        "c": "head_1_joint",
    },
}


@pytest.fixture(scope="module")
def robots() -> dict[str, Any]:
    if "panda" not in hqp.robots.names():
        pytest.skip("needs example-robot-data")
    return {name: hqp.robots.load(name) for name in {*NAMES, *OTHER}}


def assemblies(elements: list[Element], robot: Robot, order: int, patch: pytest.MonkeyPatch) -> tuple[Assembly, ...]:
    """One native assembly and one in Python."""
    free, bound = (P(3.0), P(3.0, max_velocity=0.8, max_acceleration=2.0))
    if order == 2:
        free, bound = PD(9.0, 5.0), PD(9.0, 5.0, max_velocity=0.5, max_acceleration=4.0)
    dense = [e for e in elements if e.selection(robot) is None]
    picked = [e for e in elements if e.selection(robot) is not None]
    laws: dict[str, Any] = {e.name: bound if k % 2 else free for k, e in enumerate(elements)}
    fast = Assembly(dense, picked, robot, 0.002, laws)
    without = {type(m.element).__name__ for m in fast.members.values() if m.write is not None}
    assert without <= PLANLESS, f"no plan, or one that does not count: {without}"
    patch.setattr(hqp.programs.assembly, "native", None)
    slow = Assembly(dense, picked, robot, 0.002, laws)
    patch.undo()
    return fast, slow


def reference(element: Element, robot: Robot, rng: np.random.Generator, m: int) -> Reference:
    """A distant goal with feedforward, and sloped ground for a wheel."""
    hold = element.hold(robot.state(robot.random_configuration(rng)))
    extra = {"velocity": rng.normal(size=m), "acceleration": rng.normal(size=m)}
    if isinstance(element, (t.OmniWheelContact, t.WheelContact)):
        normal = np.array([0.2, 0.2, 1.0]) * rng.normal(size=3)
        return element.at(hold.value, normal=normal if rng.uniform() < 0.8 else None, **extra)
    if isinstance(element, t.Cone) and hold.value is not None:
        return element.at(hold.value[0], velocity=rng.normal(size=3), acceleration=rng.normal(size=3))
    return dataclasses.replace(hold, **extra) if element.equality or isinstance(element, t.Within) else hold


@dataclasses.dataclass(frozen=True, kw_only=True)
class Fence(Inequality):
    """User inequality with a law on the distance; one side has no bound."""

    def rows(self, robot: Any) -> int:
        return 2

    def jacobian(self, state: Any) -> Mat:
        return np.asarray(state.jacobian("r_palm")[:2])

    def drift(self, state: Any) -> Vec:
        return np.asarray(state.drift("r_palm")[:2])

    def bounds(self, state: Any) -> tuple[Any, Any]:
        x, y, _ = state.position("r_palm")
        return np.array([-0.1 - x, -np.inf]), np.array([0.1 - x, 0.02 - y])


@pytest.mark.parametrize("order", [1, 2])
def test_laws_of_a_users_inequality_are_the_readable_ones(
    robots: dict[str, Any], order: int, monkeypatch: pytest.MonkeyPatch
) -> None:
    """Each row within max_velocity and max_acceleration, near its bound and far; also between two laws."""
    robot, rng, dt = robots["cbi"], np.random.default_rng(0), 0.002
    task = t.Position(frame="r_palm")
    elements: list[Element] = [Fence(name="a"), Fence(name="b", weight=2.5), task]
    found = []
    bounds = {"max_velocity": 0.5}, {"max_acceleration": 0.4}, {"max_velocity": 0.5, "max_acceleration": 1.5}
    for most, before in product(bounds, (None, {}, bounds[0], bounds[2])):
        law: Law = P(3.0, **most) if order == 1 else PD(9.0, 5.0, **most)
        former: Law = P(8.0, **(before or {})) if order == 1 else PD(2.0, 3.0, **(before or {}))
        first = law if before is None else former
        rows = Assembly(elements, [], robot, dt, {e.name: first for e in elements})
        monkeypatch.setattr(hqp.programs.assembly, "native", None)
        pair = [Assembly(elements, [], robot, dt, {e.name: one for e in elements}) for one in (law, former)]
        monkeypatch.undo()
        for e in elements:
            rows.take_law(e.name, law, at_once=False)
        share = 0.0 if before is None else 1.0
        for _ in range(20):
            rows.go_on()
            share = max(share - dt * float(max(pace(law), pace(former))), 0.0)
            goal = task.at(0.2 * rng.normal(size=3))
            state = robot.state(robot.random_configuration(rng), 0.2 * rng.normal(size=robot.nv))
            for one in (rows, *pair):
                one.fill(state, {e.name: e.hold(state) for e in elements} | {task.name: goal}, ())
            for what in ("lower", "upper"):
                after, other = (getattr(one, what) for one in pair)
                with np.errstate(invalid="ignore"):  # one of them has no bound
                    blend = np.where(np.isfinite(other - after), after + share * (other - after), after)
                _check(getattr(rows, what), blend, what)
            found.append(rows.upper.copy())
    assert np.ptp(found) > 0.1


@pytest.mark.parametrize("draws", [15, pytest.param(30, marks=pytest.mark.slow)])
@pytest.mark.parametrize("order", [1, 2])
@pytest.mark.parametrize(("robot_name", "name"), CASES)
def test_native_rows_equal_readable_rows(
    robots: dict[str, Any], robot_name: str, name: str, order: int, draws: int, monkeypatch: pytest.MonkeyPatch
) -> None:
    """Every way to steer, inside limits and outside."""
    robot, rng = robots[robot_name], np.random.default_rng(3)
    if name == "BaseVelocityLimits" and not robot.floating:
        pytest.skip("no free base")
    if name == "Balance" and order == 1:
        pytest.skip("its law gives accelerations")
    table = examples({**NAMES, **OTHER}[robot_name])
    elements: list[Element] = []
    for example in table[name]:
        for weight in (1.0, 2.5):
            elements.append(dataclasses.replace(example, name=f"e{len(elements)}", weight=weight))
    fast, slow = assemblies(elements, robot, order, monkeypatch)
    counts = {e.name: e.rows(robot) for e in elements}
    given: dict[str, Reference] = {}
    for k in range(draws):
        for element in elements:
            if k == 0 or rng.uniform() < 0.5:
                given[element.name] = reference(element, robot, rng, counts[element.name])
        q, v = robot.random_configuration(rng), rng.normal(size=robot.nv)
        if k % 5 == 4 and "Limits" in name:  # some joints outside their limits
            q = robot.integrate(q, rng.normal(size=robot.nv), 1.0)
        state = robot.state(q, v)
        taken = given
        if k % 3 == 0:
            taken = {n: dataclasses.replace(g, velocity=None, acceleration=None) for n, g in given.items()}
        for one in (fast, slow):
            one.fill(state, taken, list(given.values()) if k % 3 else ())
        for what in ("J", "error", "drift", "lower", "upper"):
            _check(getattr(fast, what), getattr(slow, what), what)


@pytest.mark.parametrize("name", CLASSES)
def test_hold_values_have_the_shape_of_their_plan(robots: dict[str, Any], name: str) -> None:
    """The native loop copies them into buffers of that shape."""
    robot = robots["cbi"]
    for element in examples(NAMES["cbi"])[name]:
        plan, value = plan_of(element, robot), element.hold(robot.state()).value
        if plan is not None:
            assert value is None or np.shape(value) == plan.shape or (plan.shape == () and np.size(value) == 0)
            assert value is not None or plan.shape == ()


def _check(x: Mat | Vec, y: Mat | Vec, what: str) -> None:
    finite = np.isfinite(y)
    assert np.array_equal(finite, np.isfinite(x)), what
    if finite.any():
        scale = np.maximum(1.0, np.abs(y[finite]).max())
        assert np.abs(x[finite] - y[finite]).max() < 1e-10 * scale, what


def test_a_wheel_keeps_its_distance_when_the_ground_tilts(
    robots: dict[str, Any], monkeypatch: pytest.MonkeyPatch
) -> None:
    """Roll far with changing normals, as one reference object or as new ones of equal value."""
    robot, rng = robots["dreamer"], np.random.default_rng(4)
    wheels: list[Any] = [t.OmniWheelContact(wheel=w) for w in robot.wheels]
    wheels.append(t.WheelContact(wheel=next(iter(robot.wheels)), name="ordinary"))
    fast, slow = assemblies(wheels, robot, 2, monkeypatch)
    hold = {w.name: w.hold(robot.state()) for w in wheels}
    given, q = dict(hold), robot.home.copy()
    for k in range(200):
        v = rng.normal(size=robot.nv)
        q = robot.integrate(q, v, 0.02)
        if k % 3 == 0:
            tilt = np.array([0.3 * np.sin(0.1 * k), 0.2, 1.0])
            given = {w.name: w.at(hold[w.name].value, normal=tilt if k % 2 else None) for w in wheels}
        state = robot.state(q, v)
        for one in (fast, slow):
            one.fill(state, given, ())
        for what in ("J", "error", "drift", "lower", "upper"):
            _check(getattr(fast, what), getattr(slow, what), what)
    assert np.abs(fast.error).max() > 0.1  # there is an error to carry over


@pytest.mark.parametrize("native", [True, False], ids=["native", "readable"])
def test_a_normal_of_nan_does_not_stay(robots: dict[str, Any], native: bool, monkeypatch: pytest.MonkeyPatch) -> None:
    """It leaves no trace in the next tick."""
    robot = robots["dreamer"]
    wheel = t.OmniWheelContact(wheel=next(iter(robot.wheels)))
    rows = assemblies([wheel], robot, 2, monkeypatch)[0 if native else 1]
    hold = wheel.hold(robot.state())
    lost, tilted = (wheel.at(hold.value, normal=n) for n in ([np.nan, 0.0, 1.0], [0.1, 0.0, 1.0]))
    state = robot.state(robot.integrate(robot.home, np.full(robot.nv, 0.1), 1.0))
    found = []
    for reference in (hold, tilted, lost, tilted):
        rows.fill(state, {wheel.name: reference}, ())
        found.append(rows.error.copy())
        assert bool(rows.unusable()) is (reference is lost)
    assert np.abs(found[1]).max() > 0.0
    assert np.array_equal(found[1], found[3])


STACK = Stack(
    Level(
        t.FixedContact(frame="l_sole"),
        t.PointContact(frame="r_sole"),
        t.Com(axes="yx", weight=2.0),
        t.Position(frame="l_palm", axes="zx", offset=(0.1, 0.2, 0.3), weight=0.5),
    ),
    Level(t.Position(frame="r_palm"), t.Position(frame="r_palm", relative_to="pelvis", name="near")),
    Level(t.Orientation(frame="pelvis", axes=("yaw", "roll"), weight=3.0), t.Com(axes="z", name="com_z")),
    Level(t.Orientation(frame="head"), t.Pose(frame="l_palm", name="palm"), t.Com(subtree="B_TFE", name="trunk")),
    Level(t.Posture(weight=0.3)),
    subject_to=[t.JointLimits(margin=0.01, acceleration=30.0)],
)


def problems(robot: Robot, formulation: Any, monkeypatch: pytest.MonkeyPatch, native: bool) -> list[Any]:
    if not native:
        monkeypatch.setattr(hqp.programs.assembly, "native", None)
    rng = np.random.default_rng(3)
    program, found = formulation.compile(STACK, robot, 0.002), []
    holds = {e.name: e.hold(robot.state(robot.random_configuration(rng))) for e in STACK}
    for _ in range(20):
        q, v = robot.random_configuration(rng), rng.normal(size=robot.nv)
        goal = t.Position(frame="r_palm").at(rng.normal(size=3), velocity=rng.normal(size=3))
        program.fill(robot.state(q, v), {**holds, "r_palm": goal}, [goal])
        found.append(program.problem.copy())
    monkeypatch.undo()
    return found


@pytest.mark.parametrize(
    "formulation",
    [hqp.Velocity(law=P(3.0), contact_law=P(7.0)), hqp.Acceleration(law=PD(9.0))],
    ids=["velocity", "acceleration"],
)
def test_native_problems_equal_readable_problems(formulation: Any, monkeypatch: pytest.MonkeyPatch) -> None:
    robot = hqp.robots.load("cbi")
    fast = problems(robot, formulation, monkeypatch, native=True)
    slow = problems(robot, formulation, monkeypatch, native=False)
    assert hqp.programs.assembly.native is not None
    for one, other in zip(fast, slow, strict=True):
        for a, b in zip(one.levels, other.levels, strict=True):
            assert np.abs(a.dense(one.n) - b.dense(one.n)).max() < 1e-12
            for side in ("lower", "upper"):
                x, y = getattr(a, side), getattr(b, side)
                assert np.allclose(x, y, rtol=1e-10, atol=1e-9)


@pytest.mark.long
def test_errors_are_exact_near_half_a_turn() -> None:
    """Rotation vectors lose accuracy first at rotations by almost pi, about any axis."""
    robot = hqp.robots.load("cbi")
    task = t.Orientation(frame="pelvis", law=P(1.0))
    session = hqp.Controller(Stack(Level(task)), solver="nullspace").session(robot, 0.002)
    rng = np.random.default_rng(4)
    for angle in (0.0, 1e-9, 1e-4, 1.0, np.pi - 1e-3, np.pi - 1e-7):
        axis = rng.normal(size=3)
        turn = np.concatenate((axis / np.linalg.norm(axis) * np.sin(angle / 2), [np.cos(angle / 2)]))
        tick = session.step(robot.state(), task.at(turn))
        assert tick.solution is not None
        omega = robot.state().jacobian("pelvis")[3:] @ tick.solution.x
        assert np.allclose(omega, axis / np.linalg.norm(axis) * angle, atol=1e-7)
