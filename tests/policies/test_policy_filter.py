"""A policy's command passes unchanged unless a limit binds, and never past a limit: drawn and hostile commands.

Joints move under gravity, coupled, by Pinocchio.
"""

from __future__ import annotations

import math
from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np
import pinocchio as pin
import pytest

import hqp
import hqp.tasks as t
from hqp import PolicyFilter
from hqp.errors import DeclarationError
from hqp.policies import PolicyFilters
from hqp.policies.policy_filter import IMPACT, KEPT, UNLIMITED
from hqp.robots import Robot
from hqp.tasks.limits import home_inertia
from tests.loop.test_begin import Physics, holding, standing
from tests.robots.test_tendons import drawn as tendons
from tests.scenes.hostile import DT, KINDS, Plant, hostile
from tests.tasks.test_prescribed import load


def declared(kind: str, robot: Robot, apart: bool = False) -> PolicyFilter:
    gains = {"kp": 60.0, "kd": 2.0} if kind == "positions" else {}
    palms = robot.landmarks.get("palms", ())
    collision = t.CollisionAvoidance(pairs=((palms[0], palms[1]),)) if apart and len(palms) > 1 else None
    return PolicyFilter(command=kind, collision=collision, **gains)  # type: ignore[arg-type]


def held(robot: Robot, q: Any, v: Any, damping: float = 5.0) -> Any:
    """Torques of the motors that hold the joints against gravity and damp them."""
    return pin.rnea(robot.model, robot.model.createData(), q, v, -damping * v)[robot.actuated]


@pytest.mark.parametrize("kind", KINDS)
@pytest.mark.parametrize("name", ["g1", "ur5", "anymal"])
def test_what_breaks_no_limit_passes_to_the_bit(name: str, kind: str) -> None:
    robot = load(name)
    whole = replace(declared(kind, robot, apart=True), held=True)
    session = whole.session(robot, DT, deadline=math.inf)
    plant, rng = Plant(robot, kind, session), np.random.default_rng(0)
    centre = robot.state(robot.home).angles[robot.actuated] if kind == "positions" else 0.0
    phases, free = rng.uniform(0.0, 6.0, robot.actuated.size), 0
    for i in range(150):
        command = centre + 0.02 * np.sin(0.05 * i + phases)
        if kind == "torques":
            command = command + held(robot, plant.q, plant.v)
        tick = session.tick(plant.q, plant.v, command)
        if not tick.limited:
            np.testing.assert_allclose(tick.command, command, rtol=0.0, atol=1e-12)
            free += 1
        plant.move(tick.command)
    assert free > 100


ROBOTS = [("g1", False), ("ur5", False), ("kinova", False), ("panda", False), ("anymal", False), ("anymal", True)]
STANDS = [("g1", True, 1), ("g1", True, 4), *((name, True, 0) for name in ("talos", "cbi"))]
"""Humanoids on a stand, under gravity: seeds in which a waist left its range."""
MANY = [
    ("xarm7", False, 1),
    *(("g1", True, seed) for seed in range(5, 25)),
    *((name, False, 0) for name in ("talos", "cbi")),
]


@pytest.mark.long
@pytest.mark.parametrize("kind", KINDS)
@pytest.mark.parametrize(
    ("name", "stands", "seed"),
    [*((*one, 1) for one in ROBOTS), *STANDS, *(pytest.param(*one, marks=pytest.mark.slow) for one in MANY)],
)
def test_no_command_passes_a_limit(name: str, stands: bool, seed: int, kind: str) -> None:
    """Check positions, speeds and torques of moving joints after each of many hostile ticks, by plain arithmetic."""
    robot, rng = load(name), np.random.default_rng(seed)
    session = replace(declared(kind, robot), held=stands).session(robot, DT, deadline=math.inf)
    plant, own, limited = Plant(robot, kind, session), robot.actuated, 0
    effort = plant.servos.effort
    for i in range(1200):
        angles, v = robot.past(plant.q).angles[own], plant.v[own]
        tick = session.tick(plant.q, plant.v, hostile(rng, kind, robot, i))
        assert np.isfinite(tick.command).all()
        limited += bool(tick.limited)
        if kind == "positions":
            tau = plant.servos.torque(tick.command, angles, v)
            assert (np.abs(tau) <= effort * (1.0 + 1e-9) + 1e-9).all()
        if kind == "torques":
            assert (np.abs(tick.command) <= effort).all()
        plant.move(tick.command)
        angles = robot.past(plant.q).angles[own]
        over = np.maximum(robot.lower[own] - angles, angles - robot.upper[own]).max()
        assert over < 1e-6, (i, over)
        assert (np.abs(plant.v[own]) <= robot.velocity_limit[own] * (1.0 + 1e-9) + 1e-9).all(), i
    assert limited > 800


@pytest.mark.parametrize("seed", range(2))
@pytest.mark.parametrize("name", ["cbi", "g1"])
def test_no_search_goes_on_without_progress(name: str, seed: int) -> None:
    """Hostile ticks on a stand, half of the joints at limits: searches took 10 200 working sets, 138 now."""
    robot, rng, most = load(name), np.random.default_rng(seed), 0
    session = replace(declared("positions", robot), held=True).session(robot, DT, deadline=math.inf)
    plant = Plant(robot, "positions", session)
    for i in range(100):
        tick = session.tick(plant.q, plant.v, hostile(rng, "positions", robot, i))
        assert tick.tick.solution is not None
        most = max(most, tick.tick.solution.stats.iterations)
        plant.move(tick.command)
    assert most < 10 * robot.nv


@pytest.mark.parametrize("seed", range(4))
@pytest.mark.parametrize("name", ["g1", "anymal"])
@pytest.mark.parametrize("kind", ["positions", "torques"])
def test_torques_at_a_limit_do_not_alternate_on_a_base_adrift(name: str, kind: str, seed: int) -> None:
    """Drawn joints are driven to their limits, and a light base gives way: no torque turns back from tick to tick."""
    robot, rng = load(name), np.random.default_rng(seed)
    session = declared(kind, robot).session(robot, DT, deadline=math.inf)
    plant, own, sent = Plant(robot, kind, session), robot.actuated, []
    effort, way = plant.servos.effort, rng.uniform(-1.0, 1.0, own.size)
    for _ in range(120):
        angles, v = robot.past(plant.q).angles[own], plant.v[own]
        command = 0.2 * way * effort if kind == "torques" else angles + 0.2 * way * effort / plant.servos.kp
        tick = session.tick(plant.q, plant.v, command)
        sent.append((tick.command if kind == "torques" else plant.servos.torque(tick.command, angles, v)) / effort)
        plant.move(tick.command)
    steps = np.diff(np.array(sent), axis=0)
    turns = (steps[1:] * steps[:-1] < 0.0) & (np.minimum(np.abs(steps[1:]), np.abs(steps[:-1])) > 0.02)
    assert turns.sum(axis=0).max() <= 6


@pytest.mark.parametrize("seed", range(3))
@pytest.mark.parametrize("kind", ["positions", "torques"])
def test_a_joint_at_its_limit_changes_its_own_command_alone(kind: str, seed: int) -> None:
    """Drawn joints of a coupled arm are driven to their speed limits; the others keep the policy's command."""
    robot, rng = load("ur5"), np.random.default_rng(seed)
    session, chosen = declared(kind, robot).session(robot, DT, deadline=math.inf), int(rng.integers(6))
    plant, found = Plant(robot, kind, session), 0
    for _ in range(120):
        tau = held(robot, plant.q, plant.v)
        tau[chosen] += 0.3 * robot.effort_limit[chosen]
        command = tau if kind == "torques" else plant.servos.target(tau, robot.past(plant.q).angles, plant.v)
        tick = session.tick(plant.q, plant.v, command)
        if list(tick.limited) == [robot.joint_names[chosen]]:
            np.testing.assert_array_equal(np.delete(tick.command, chosen), np.delete(command, chosen))
            found += 1
        plant.move(tick.command)
    assert found > 20


@pytest.mark.parametrize("kind", ["positions", "torques"])
def test_the_filter_learns_torques_that_its_model_lacks(kind: str) -> None:
    """A drawn load, constant at each joint, beside the motors: the estimate finds it, and the prediction with it."""
    robot, rng = load("ur5"), np.random.default_rng(3)
    session = declared(kind, robot).session(robot, DT, deadline=math.inf)
    plant, extra = Plant(robot, kind, session), rng.uniform(-5.0, 5.0, 6)
    plant.load = extra
    for _ in range(150):
        tau = held(robot, plant.q, plant.v, 20.0) - extra
        command = tau if kind == "torques" else plant.servos.target(tau, robot.past(plant.q).angles, plant.v)
        plant.move(session.tick(plant.q, plant.v, command).command)
    np.testing.assert_allclose(session.lacking, extra, atol=0.05)


@pytest.mark.parametrize("seed", range(3))
@pytest.mark.parametrize("kind", ["positions", "torques"])
def test_the_estimate_follows_a_load_that_grows(kind: str, seed: int) -> None:
    """Drawn loads beside the motors grow steadily: the estimate keeps up with them."""
    robot, rng = load("ur5"), np.random.default_rng(seed)
    session = declared(kind, robot).session(robot, DT, deadline=math.inf)
    plant, growth = Plant(robot, kind, session), rng.uniform(-20.0, 20.0, 6)  # N m/s
    for i in range(150):
        plant.load = (i + 1) * DT * growth
        tau = held(robot, plant.q, plant.v, 20.0) - plant.load
        command = tau if kind == "torques" else plant.servos.target(tau, robot.past(plant.q).angles, plant.v)
        plant.move(session.tick(plant.q, plant.v, command).command)
    # the latest measured period is the one before; a lag of ten ticks would be ten times as much
    np.testing.assert_allclose(session.lacking, plant.load, atol=2.0 * DT * np.abs(growth).max())


@pytest.mark.parametrize("seed", range(3))
@pytest.mark.parametrize("name", ["g1", "anymal"])
def test_the_filter_learns_a_force_on_a_base_that_turns(name: str, seed: int) -> None:
    """A robot in free fall, whose filter counts on gravity, turns about a drawn axis: the force it lacks is upright."""
    robot, rng = load(name), np.random.default_rng(seed)
    session = declared("torques", robot).session(robot, DT, deadline=math.inf)
    plant, axis = Plant(robot, "torques", session), rng.normal(size=3)
    plant.v[3:6] = 4.0 * axis / np.linalg.norm(axis)
    weight = 9.81 * robot.mass
    for i in range(200):
        push = 0.1 * robot.effort_limit[robot.actuated] * np.sin(0.05 * i + rng.uniform(0.0, 6.0, robot.actuated.size))
        plant.move(session.tick(plant.q, plant.v, push).command)
    force = pin.Quaternion(*plant.q[[6, 3, 4, 5]]).toRotationMatrix() @ session.lacking[:3]
    np.testing.assert_allclose(force, [0.0, 0.0, weight], atol=0.04 * weight)


def test_the_tick_says_who_was_limited_and_by_how_much() -> None:
    robot = load("ur5")
    session = PolicyFilter(kp=400.0, kd=20.0).session(robot, DT, deadline=math.inf)
    asked = robot.home.copy()
    asked[2] += 3.0
    tick = session.tick(robot.home, np.zeros(robot.nv), asked)
    assert list(tick.limited) == [robot.joint_names[2]]
    np.testing.assert_allclose(tick.limited[robot.joint_names[2]], tick.command[2] - asked[2])
    np.testing.assert_array_equal(np.delete(tick.command, 2), np.delete(asked, 2))
    asked[4] = math.nan
    tick = session.tick(robot.home, np.zeros(robot.nv), asked)
    assert math.isnan(tick.limited[robot.joint_names[4]])


@pytest.mark.parametrize("kind", KINDS)
@pytest.mark.parametrize("name", ["g1", "anymal", "ur5"])
def test_a_file_and_a_batch_send_the_same_bits(name: str, kind: str, tmp_path: Path) -> None:
    """Worlds in several orders, one of them stopped and begun anew; states and commands are hostile."""
    robot, rng, count = load(name), np.random.default_rng(2), 3
    own = declared(kind, robot, apart=True)
    sessions = [own.session(load(name), DT, deadline=math.inf) for _ in range(count)]
    sessions[0].export(tmp_path / "filter.hqp")
    batch = PolicyFilters.load(tmp_path / "filter.hqp", count, threads=2)
    plants = [Plant(robot, kind, session) for session in sessions]
    for i in range(90):
        if i == 40:
            batch.stop([1], "door")
            sessions[1].session.stop("door")
        if i == 60:
            batch.resume([1])
            sessions[1].session.resume()
        commands = np.array([hostile(rng, kind, robot, 3 * i + k) for k in range(count)])
        Q, V = np.array([plant.q for plant in plants]), np.array([plant.v for plant in plants])
        if i % 20 == 7:
            Q[2, 0], V[2, -1] = math.nan, math.inf
        ticks = [s.tick(q, v, c) for s, q, v, c in zip(sessions, Q, V, commands, strict=True)]
        found = batch.step(Q, V, commands)
        np.testing.assert_array_equal(found.commands, [tick.command for tick in ticks])
        assert found.statuses() == tuple(tick.tick.status for tick in ticks)
        for plant, tick in zip(plants, ticks, strict=True):
            plant.move(tick.command)
    assert batch.counters.ticks == 90 * count


def test_a_world_that_is_reset_begins_anew() -> None:
    robot = load("g1")
    batch = PolicyFilters(declared("torques", robot).session(robot, DT, deadline=math.inf), 2)
    rng, Q = np.random.default_rng(4), np.tile(robot.home, (2, 1))
    given = [(0.3 * rng.normal(size=(2, robot.nv)), 30.0 * rng.normal(size=(2, robot.actuated.size))) for _ in range(5)]
    first = [batch.step(Q, v, command).commands for v, command in given]
    batch.reset([1])
    again = [batch.step(Q, v, command).commands for v, command in given]
    for one, other in zip(first, again, strict=True):
        np.testing.assert_array_equal(one[1], other[1])
    assert any((one[0] != other[0]).any() for one, other in zip(first, again, strict=True))
    for bad in ((Q[:1], given[0][0], given[0][1]), (Q, given[0][0][:, 1:], given[0][1]), (Q, Q, Q)):
        with pytest.raises(DeclarationError, match="wrong shape"):
            batch.step(*bad)
    with pytest.raises(DeclarationError, match="worlds"):
        batch.reset([2])


@pytest.mark.parametrize("name", ["g1", "anymal", "kinova", "talos"])
def test_the_estimate_is_the_inverse_dynamics_of_pinocchio(name: str) -> None:
    """Its first step from zero, over drawn periods: the torques that the motion needs beside the command."""
    robot, rng = hqp.robots.load(name, rotors=name == "talos"), np.random.default_rng(0)
    data, first = robot.model.createData(), 6 * robot.floating
    for _ in range(5):
        session = declared("torques", robot).session(robot, DT, deadline=math.inf)
        q, v = robot.random_configuration(rng), 0.3 * rng.normal(size=robot.nv)
        end, later = robot.integrate(q, v, DT), v + 1e-3 * rng.normal(size=robot.nv)
        sent = session.tick(q, v, np.zeros(robot.actuated.size)).command
        session.tick(end, later, sent)
        mean, change = 0.5 * (v + later), np.zeros(robot.nv)
        moved = np.r_[:first, robot.actuated]
        change[moved] = ((later - v) / DT)[moved]
        forces = pin.rnea(robot.model, data, robot.integrate(q, mean, 0.5 * DT), mean, change)
        forces[robot.actuated] -= sent
        for k in range(0, first, 3):  # carried on by the turn of a period
            forces[k : k + 3] = pin.exp3(DT * later[3:6]).T @ forces[k : k + 3]
        most = np.append(np.full(first, IMPACT * robot.mass), np.minimum(robot.effort_limit[robot.actuated], UNLIMITED))
        inside = np.abs(forces[moved]) < most
        assert inside.mean() > 0.7
        step = (1.0 - KEPT**2) + (1.0 - KEPT) ** 2
        np.testing.assert_allclose(session.lacking[inside], step * forces[moved][inside], rtol=1e-9, atol=1e-7)


def test_declared() -> None:
    robot: Any = load("ur5")
    for bad, what in (
        (lambda: PolicyFilter(), "kp and kd"),
        (lambda: PolicyFilter(limits=3, kp=1.0, kd=1.0), "limits"),  # type: ignore[arg-type]
        (lambda: PolicyFilter(collision=3, kp=1.0, kd=1.0), "collision"),  # type: ignore[arg-type]
        (lambda: PolicyFilter(command="force"), "command"),  # type: ignore[arg-type]
        (lambda: PolicyFilter(kp=-1.0, kd=1.0).session(robot, DT), "kp"),
        (lambda: PolicyFilter(kp={"elbow_joint": 1.0}, kd=1.0).session(robot, DT), "kp"),
        (lambda: PolicyFilter(kp=1.0, kd=1.0).session(robot, DT).tick(robot.home, np.zeros(6), np.zeros(5)), "shape"),
    ):
        with pytest.raises(DeclarationError, match=what):
            bad()


def filtered(robot: Robot, kind: str) -> Any:
    """Session of a filter whose servos are critically damped about the inertia at home."""
    own = home_inertia(robot)[robot.actuated]
    gains = {"kp": 400.0 * own, "kd": 40.0 * own} if kind == "positions" else {}
    # the torques of these policies bear gravity on a stand
    declared = PolicyFilter(command=kind, held=kind == "torques", **gains)  # type: ignore[arg-type]
    return declared.session(robot, DT, deadline=math.inf)


WAYS = [(kind, how) for kind in ("positions", "velocities") for how in ("stop", "nan", "some nan")]


@pytest.mark.parametrize(("kind", "how"), [*WAYS, ("torques", "stop")])
@pytest.mark.parametrize("name", ["g1", "ur5"])
def test_joints_come_to_rest_after_a_stop_and_without_states(name: str, kind: str, how: str) -> None:
    """A policy that drives all joints on: they rest within two seconds, and move again after resume."""
    robot, rng = load(name), np.random.default_rng(2)
    session, own = filtered(robot, kind), robot.actuated
    plant = Plant(robot, kind, session)
    speeds = rng.uniform(-0.4, 0.4, own.size)

    def policy() -> Any:
        angles, v = robot.state(plant.q).angles[own], plant.v[own]
        if kind == "velocities":
            return speeds
        if kind == "torques":
            return held(robot, plant.q, plant.v, 0.0) + home_inertia(robot)[own] * (speeds - v) / 0.05
        return angles + 0.1 * speeds

    for _ in range(100):
        plant.move(session.tick(plant.q, plant.v, policy()).command)
    fastest, place = np.abs(plant.v).max(), robot.state(plant.q).angles[own].copy()
    assert fastest > 0.1
    if how == "stop":
        session.session.stop("operator")
    for k in range(1000):
        q, v = plant.q.copy(), plant.v.copy()
        if how == "nan" or (how == "some nan" and k % 3):
            q[-1], v[:] = math.nan, math.nan
        if how == "some nan" and k % 3 == 0:
            q[:] = math.nan
        tick = session.tick(q, v, policy())
        assert not tick.tick.status.usable
        assert np.isfinite(tick.command).all()
        plant.move(tick.command)
    assert np.abs(plant.v).max() < 1e-3
    away = np.abs(robot.state(plant.q).angles[own] - place).max()
    assert away < 0.15 * fastest
    session.session.resume()
    for _ in range(50):
        tick = session.tick(plant.q, plant.v, policy())
        assert tick.tick.status.solved
        plant.move(tick.command)
    assert np.abs(plant.v).max() > 0.02


@pytest.mark.parametrize(("kind", "lost"), [("positions", False), ("torques", False), ("positions", True)])
@pytest.mark.parametrize("name", ["ur5", "kinova"])
def test_an_arm_under_gravity_comes_to_rest(name: str, kind: str, lost: bool) -> None:
    """Coupled joints by Pinocchio: an arm is stopped, or its states are lost, on its way."""
    robot, q = load(name), standing(name)
    session, physics, own = filtered(robot, kind), Physics(robot, q), robot.actuated
    kp, kd, inertia = session.declared.kp, session.declared.kd, home_inertia(robot)[own]
    push, speeds, places = 5.0 * np.cos(np.arange(6.0)), [], []
    for k in range(900):
        held, angles = holding(robot, physics.q), robot.state(physics.q).angles[own].copy()
        given = physics.q, physics.v
        if k == 200 and not lost:
            session.session.stop()
        if k >= 200 and lost:
            given = np.full(robot.nq, math.nan), np.full(robot.nv, math.nan)
        asked = held + inertia * push - 5.0 * inertia * physics.v
        if kind == "positions":
            asked = angles + (asked + kd * physics.v) / kp
        sent = session.tick(*given, asked).command
        if kind == "positions":
            sent = np.clip(kp * (sent - angles) - kd * physics.v, -robot.effort_limit, robot.effort_limit)
        physics.step(sent)
        speeds.append(float(np.abs(physics.v).max()))
        places.append(robot.state(physics.q).angles[own].copy())
    assert speeds[199] > 0.5
    assert max(speeds[700:]) < 0.05
    assert np.abs(places[-1] - places[199]).max() < 0.3 * speeds[199]


@pytest.mark.parametrize("seed", range(4))
def test_motors_that_pull_several_joints_are_refused(seed: int, tmp_path: Any) -> None:
    """The motor of a tendon moves other joints too: it is no servo of its joint."""
    robot, *_ = tendons(seed, tmp_path)
    several = [n for n, row in zip(robot.joint_names, robot.actuation, strict=True) if np.count_nonzero(row) > 1]
    for command in ("positions", "velocities", "torques"):
        declared = PolicyFilter(command=command, kp=10.0, kd=1.0)
        if several:
            with pytest.raises(DeclarationError, match=several[0]):
                declared.session(robot, 0.01)
        else:
            declared.session(robot, 0.01)
