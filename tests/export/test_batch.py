"""Batches of many worlds: each world is independent of the others and of the number of threads."""

from __future__ import annotations

import numpy as np
import pytest

import hqp
import hqp.tasks as t
from hqp import Status
from hqp.errors import DeclarationError
from hqp.export.loaded import LoadedSession
from hqp.loop.file import text
from hqp.solvers.lexicographic import kernel
from tests.scenes.stacks import FORMULATIONS, scene

pytestmark = pytest.mark.skipif(not kernel(), reason="no native kernel here")
COUNT = 40


def run(session: hqp.Session, threads: int, ticks: int = 12) -> list[tuple[np.ndarray, np.ndarray]]:
    """x and status of all ticks; one world gets an invalid state, another one is reset."""
    robot = session.robot
    batch = hqp.Batch(session.controller, robot, COUNT, session.dt, threads=threads)
    rng = np.random.default_rng(0)
    Q = np.array([robot.integrate(robot.home, rng.uniform(-0.1, 0.1, robot.nv), 1.0) for _ in range(COUNT)])
    V = rng.uniform(-0.05, 0.05, (COUNT, robot.nv))
    goals = robot.state(robot.home).position(robot.landmarks["palms"][-1]) + rng.uniform(-0.3, 0.3, (COUNT, 3))
    found = []
    for i in range(ticks):
        at = Q.copy()
        if i == 5:
            at[3, -1] = np.nan
        if i == 8:
            batch.reset(7)
        targets = {} if i % 3 == 0 else {"hand": goals}
        tick = batch.step(at, V, targets)
        found.append((tick.x, tick.status))
    return found


@pytest.mark.long
@pytest.mark.parametrize("formulation", FORMULATIONS)
def test_the_number_of_threads_changes_no_bit(formulation: str) -> None:
    session, _ = scene("g1", formulation)
    for (x, status), (other, same) in zip(run(session, 1), run(session, 3), strict=True):
        np.testing.assert_array_equal(x, other)
        np.testing.assert_array_equal(status, same)


@pytest.mark.parametrize("reach", [0.05, 0.4])
@pytest.mark.parametrize(
    ("name", "formulation"), [("g1", "velocity"), ("g1", "acceleration"), ("cbi", "velocity"), ("ur5", "velocity")]
)
def test_a_world_is_a_session(name: str, formulation: str, reach: float) -> None:
    session, given = scene(name, formulation)
    robot = session.robot
    batch = hqp.Batch(session.controller, robot, 3, session.dt, threads=1)
    alone = [LoadedSession(text(session)) for _ in range(3)]
    rng = np.random.default_rng(1)
    Q = np.array([robot.integrate(robot.home, rng.uniform(-0.1, 0.1, robot.nv), 1.0) for _ in range(3)])
    V = np.zeros((3, robot.nv))
    goal = given(1)[0].value
    assert goal is not None
    goals = goal + rng.uniform(-reach, reach, (3, 3))
    for _ in range(60):
        tick = batch.step(Q, V, {"hand": goals})
        for k, one in enumerate(alone):
            found = one.step(Q[k], V[k], {"hand": goals[k]})
            assert tick.statuses()[k] is found.status
            np.testing.assert_array_equal(tick.x[k], found.x)
            if formulation == "acceleration":
                V[k] += session.dt * found.x
            Q[k] = one.advance(Q[k], V[k] if formulation == "acceleration" else found.x)
    assert tick.solved.all()


@pytest.mark.long
@pytest.mark.parametrize("name", ["g1", "ur5"])
@pytest.mark.parametrize("threads", [1, 3])
def test_notes_of_a_world_are_those_of_its_session(name: str, threads: int) -> None:
    """Joints drawn in and out of their ranges, a state that is not valid, and a stop."""
    session, _ = scene(name, "velocity")
    robot, count = session.robot, 20
    batch = hqp.Batch(session.controller, robot, count, session.dt, threads=threads)
    alone = [LoadedSession(text(session)) for _ in range(count)]
    rng, named = np.random.default_rng(3), set()
    for k in range(8):
        Q = np.array([robot.integrate(robot.home, rng.uniform(-2.0, 2.0, robot.nv), 1.0) for _ in range(count)])
        V = rng.uniform(-0.5, 0.5, (count, robot.nv))
        Q[k, -1] = np.nan
        if k == 5:
            batch.stop(worlds=[2], reason="a person")
            alone[2].stop("a person")
        tick = batch.step(Q, V, notes=True)
        for own, one, q, v in zip(tick.notes, alone, Q, V, strict=True):
            assert own == one.step(q, v).notes
            named |= {note.status for note in own}
        assert batch.step(Q, V).notes == ()
        for one, q, v in zip(alone, Q, V, strict=True):
            one.step(q, v)
    assert Status.INVALID_STATE in named
    assert len(named) > 1


def test_a_fault_is_that_of_its_world() -> None:
    session, _ = scene("ur5")
    batch = hqp.Batch(session.controller, session.robot, 4, session.dt)
    Q = np.tile(session.robot.home, (4, 1))
    assert batch.step(Q).solved.all()
    Q[2, 0] = np.nan
    assert batch.step(Q).statuses() == (Status.OPTIMAL, Status.OPTIMAL, Status.INVALID_STATE, Status.OPTIMAL)
    Q[2, 0] = session.robot.home[0]
    batch.reset([2])
    assert batch.step(Q).solved.all()


@pytest.mark.parametrize("seed", range(3))
@pytest.mark.parametrize("name", ["ur5", "kinova"])
def test_a_world_at_rest_bears_the_loads_of_its_session(name: str, seed: int) -> None:
    """Drawn loads of joints and of a hand, other ones in each world; a state is invalid, then a stop."""
    robot, rng = hqp.robots.load(name), np.random.default_rng(seed)
    hand = robot.joint_names[-1]
    loads = t.JointLoad(name="joints"), t.ExternalWrench(frame=hand, name="push"), t.Payload(frame=hand, name="held")
    stack = hqp.Stack(hqp.Level(t.Posture(law=hqp.PD(100.0, 20.0))), subject_to=[t.TorqueLimits(), *loads])
    controller = hqp.Controller(stack, hqp.Torque(holding=None), deadline=np.inf)
    alone = [controller.session(hqp.robots.load(name), 0.002) for _ in range(2)]
    batch = hqp.Batch(controller, robot, 2, 0.002, threads=1)
    for i in range(8):
        if i == 5:
            batch.stop([0])
            alone[0].stop()
        Q = np.array([robot.random_configuration(rng, 0.3) for _ in alone])
        V, given = rng.normal(size=(2, robot.nv)), rng.uniform(0.5, 2.0, (2, robot.nv + 10))
        if i == 3:
            Q[1, 0] = np.nan
        parts = {"joints": given[:, : robot.nv], "push": given[:, robot.nv : -4], "held": given[:, -4:]}
        found = batch.step(Q, V, parts)
        for k, session in enumerate(alone):
            references = [hqp.Reference(part, numbers[k]) for part, numbers in parts.items()]
            own = session.step(session.robot.state(Q[k], V[k]), *references)
            assert own.status is found.statuses()[k]
            np.testing.assert_array_equal(own.x, found.x[k])


def test_worlds_are_small() -> None:
    session, _ = scene("g1")
    batch = hqp.Batch(session.controller, session.robot, 64, session.dt)
    for _ in range(3):
        batch.step(np.tile(session.robot.home, (64, 1)))
    assert batch.bytes / 64 < 20_000


def test_what_does_not_fit_is_refused() -> None:
    session, _ = scene("ur5")
    controller, robot = session.controller, session.robot
    with pytest.raises(DeclarationError, match="count"):
        hqp.Batch(controller, robot, 0)
    with pytest.raises(DeclarationError, match="threads"):
        hqp.Batch(controller, robot, 2, threads=-1)
    batch = hqp.Batch(controller, robot, 2)
    Q = np.tile(robot.home, (2, 1))
    with pytest.raises(DeclarationError, match="wrong shape"):
        batch.step(Q[:1])
    with pytest.raises(DeclarationError, match="no element 'hands'"):
        batch.step(Q, None, {"hands": np.zeros((2, 3))})
    with pytest.raises(DeclarationError, match=r"hand: targets must have shape \(2, 3\)"):
        batch.step(Q, None, {"hand": np.zeros((2, 4))})
    with pytest.raises(DeclarationError, match="0 to 1"):
        batch.reset(2)


def test_no_world_is_late() -> None:
    session, _ = scene("ur5")
    hurried = hqp.Controller(session.controller.stack, session.controller.formulation, deadline=1e-5)
    found = [
        hqp.Batch(controller, session.robot, 64, session.dt).step(
            np.tile(session.robot.home, (64, 1)), None, {"hand": np.tile([0.4, 0.1, 0.5], (64, 1))}
        )
        for controller in (hurried, session.controller)
    ]
    assert found[0].solved.all()
    np.testing.assert_array_equal(found[0].x, found[1].x)


def test_worlds_advance_as_the_robot_does() -> None:
    session, _ = scene("g1", "velocity")
    robot, rng = session.robot, np.random.default_rng(4)
    batch = hqp.Batch(session.controller, robot, 5, session.dt)
    Q = np.array([robot.integrate(robot.home, rng.uniform(-0.3, 0.3, robot.nv), 1.0) for _ in range(5)])
    V = batch.step(Q).x[:, : robot.nv] + rng.normal(size=(5, robot.nv))
    for dt, period in ((None, session.dt), (0.05, 0.05)):
        moved = batch.advance(Q, V, dt)
        for q, v, found in zip(Q, V, moved, strict=True):
            np.testing.assert_allclose(found, robot.integrate(q, v, period), atol=1e-12)
    with pytest.raises(DeclarationError, match="wrong shape"):
        batch.advance(Q[:3], V[:3])


def test_tensors_in_and_out() -> None:
    torch = pytest.importorskip("torch", reason="an environment of make test-environments has it")
    session, _ = scene("ur5", "velocity")
    robot, goal = session.robot, np.array([0.3, 0.2, 0.4])
    arrays, tensors = (hqp.Batch(session.controller, robot, 3, session.dt) for _ in range(2))
    Q = np.tile(robot.home, (3, 1))
    same = arrays.step(Q, None, {"hand": np.tile(goal, (3, 1))})
    tick = tensors.step(torch.tensor(Q), None, {"hand": torch.tensor(goal).repeat(3, 1)})
    assert torch.is_tensor(tick.commands)
    np.testing.assert_array_equal(tick.commands.numpy(), same.commands)
    assert tick.solved.all()
    assert tick.statuses() == same.statuses()
    np.testing.assert_array_equal(tensors.advance(torch.tensor(Q), tick.x).numpy(), arrays.advance(Q, same.x))
    tensors.reset(torch.tensor([True, False, True]))
