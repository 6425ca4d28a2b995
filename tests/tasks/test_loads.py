"""Known loads enter dynamics, contact forces, gravity compensation, rest and explain."""

from __future__ import annotations

import math
from typing import Any

import numpy as np
import pinocchio as pin
import pytest

import hqp
import hqp.tasks as t
from hqp import PD, Level, Stack, serial
from hqp.errors import DeclarationError, FrameNotFound
from hqp.problem import Status
from tests.loop.readable_tick import ReadableSession

DT = 0.002


@pytest.fixture(scope="module")
def robots() -> dict[str, Any]:
    if "panda" not in hqp.robots.names():
        pytest.skip("needs example-robot-data")
    return {name: hqp.robots.load(name) for name in ("cbi", "g1", "panda")}


def heavier(robot: Any, frame: str, mass: float, com: Any) -> Any:
    """The robot with a point mass in its model."""
    model = robot.model.copy()
    host = model.frames[model.getFrameId(frame)]
    model.appendBodyToJoint(host.parentJoint, pin.Inertia(mass, np.array(com), np.zeros((3, 3))), host.placement)
    return hqp.robots.Robot(model, actuated=robot.joint_names, home=robot.home, landmarks=robot.landmarks)


def feet(robot: Any) -> list[Any]:
    return [t.FixedContact(frame=f, name=f) for f in robot.landmarks.get("soles", ())] if robot.floating else []


@pytest.mark.parametrize("compensated", [False, True])
@pytest.mark.parametrize(("name", "frame"), [("cbi", "r_palm"), ("g1", "left_wrist_yaw_link"), ("panda", "panda_hand")])
def test_a_payload_is_a_mass_in_the_model(robots: dict[str, Any], name: str, frame: str, compensated: bool) -> None:
    robot, (mass, com) = robots[name], (3.0, (0.1, -0.05, 0.2))
    load = t.Payload(frame=frame)
    hand = t.Position(frame=frame, name="hand")
    rest = [*feet(robot), *robot.couplings]
    formulation = hqp.Torque(gravity_compensation=compensated)
    rng = np.random.default_rng(0)
    twin = heavier(robot, frame, mass, com)
    with_load = hqp.Controller(Stack(Level(hand), subject_to=[*rest, load]), formulation, deadline=math.inf)
    plain = hqp.Controller(Stack(Level(hand), subject_to=rest), formulation, deadline=math.inf)
    one, two = with_load.session(robot, DT), plain.session(twin, DT)
    for _ in range(3):
        q, v = robot.integrate(robot.home, rng.uniform(-0.3, 0.3, robot.nv), 1.0), rng.normal(size=robot.nv)
        goal = hand.at(robot.state(q).position(frame) + rng.uniform(-0.2, 0.2, 3))
        a = one.step(robot.state(q, v), goal, load.at(mass, com))
        b = two.step(twin.state(q, v), goal)
        assert a.status is b.status is Status.OPTIMAL
        size = 1.0 + np.abs(b.command).max()
        assert np.allclose(a.command, b.command, atol=1e-7 * size)
        assert np.allclose(one.program.acceleration(a.x), two.program.acceleration(b.x), atol=1e-6 * size)
        found, expected = one.program.contact_forces(a.x, world=True), two.program.contact_forces(b.x, world=True)
        for foot in expected:
            assert np.allclose(found[foot], expected[foot], atol=1e-6 * size)


@pytest.mark.parametrize(("name", "frame"), [("cbi", "r_palm"), ("panda", "panda_hand")])
def test_centres_of_mass_and_momenta_are_those_of_the_heavier_robot(
    robots: dict[str, Any], name: str, frame: str
) -> None:
    robot, mass, com = robots[name], 3.0, np.array([0.1, -0.05, 0.2])
    twin, rng = heavier(robot, frame, mass, com), np.random.default_rng(3)
    other = heavier(twin, frame, 0.5, -com)
    last = robot.model.frames[robot.frame(frame)].parentJoint
    for loads, expected in (((frame, mass, com),), twin), (((frame, mass, com), (frame, 0.5, -com)), other):
        q, v = robot.integrate(robot.home, rng.uniform(-0.3, 0.3, robot.nv), 1.0), rng.normal(size=robot.nv)
        state, there = robot.state(q, v), expected.state(q, v)
        state.loads = loads
        for subtree in (0, last, int(robot.model.parents[last]), 1):
            assert np.allclose(state.com(subtree), there.com(subtree), atol=1e-12)
            assert np.allclose(state.com_jacobian(subtree), there.com_jacobian(subtree), atol=1e-12)
            assert np.allclose(state.com_drift(subtree), there.com_drift(subtree), atol=1e-10)
        for a, b in zip(state.momentum_map(), there.momentum_map(), strict=True):
            assert np.allclose(a, b, atol=1e-9)


@pytest.mark.parametrize("native", [True, False])
def test_balance_sees_a_payload(robots: dict[str, Any], native: bool, monkeypatch: pytest.MonkeyPatch) -> None:
    """Com, SupportPolygon and Momentum need the same torques as on the robot with the mass in its model."""
    robot, frame, mass, com = robots["cbi"], "r_palm", 3.0, (0.1, -0.05, 0.2)
    if not native:
        monkeypatch.setattr(hqp.programs.assembly, "native", None)
    twin, load = heavier(robot, frame, mass, com), t.Payload(frame=frame)
    centre, momentum = t.Com(axes="xy"), t.Momentum(linear="", angular="xyz")
    polygon = t.SupportPolygon(sole=(-0.1, 0.12, -0.06, 0.06), margin=0.05)
    arm = t.Com(subtree="r_elbow" if "r_elbow" in robot.model.names else robot.joint_names[-1], name="arm")
    levels = Level(centre), Level(momentum), Level(arm), Level(t.Posture())
    one = hqp.Controller(
        Stack(*levels, subject_to=[*feet(robot), polygon, load]), hqp.Torque(), price=0, deadline=math.inf
    )
    two = hqp.Controller(Stack(*levels, subject_to=[*feet(robot), polygon]), hqp.Torque(), price=0, deadline=math.inf)
    make: Any = hqp.Controller.session if native else ReadableSession
    a, b = make(one, robot, DT), make(two, twin, DT)
    rng, goal = np.random.default_rng(4), centre.at(twin.state().com()[:2] + [0.02, 0.01])
    reach = arm.at(arm.value(twin.state()))
    for k in range(3):
        q, v = robot.integrate(robot.home, rng.uniform(-0.1, 0.1, robot.nv), 1.0), rng.normal(size=robot.nv) * 0.3
        if k == 0:
            q, v = robot.home, np.zeros(robot.nv)  # hold values for the posture
        here, there = ((robot.state(q, v),), (twin.state(q, v),)) if native else ((q, v), (q, v))
        x = a.step(*here, goal, reach, load.at(mass, com))
        y = b.step(*there, goal, reach)
        assert x.status is y.status is Status.OPTIMAL
        assert np.allclose(x.x, y.x, atol=1e-6 * (1.0 + np.abs(y.x).max()))
    monkeypatch.undo()
    blind = two.session(robot, DT).step(robot.state(q, v), goal, reach)
    assert not np.allclose(blind.x, y.x, atol=1.0)


@pytest.mark.parametrize("formulation", [hqp.Velocity(), hqp.Acceleration()], ids=["velocity", "acceleration"])
def test_balance_sees_a_payload_where_forces_do_not_count(robots: dict[str, Any], formulation: Any) -> None:
    """The centre of mass with the load reaches its goal and stays; a NaN mass gets a note, the declared one is used."""
    robot, frame, com = robots["cbi"], "r_palm", np.array([0.1, 0.0, 0.0])
    load, centre = t.Payload(frame=frame), t.Com(axes="xy")
    stack = Stack(Level(centre), Level(t.Posture()), subject_to=[*feet(robot), t.JointLimits(), load])
    session = hqp.Controller(stack, formulation, deadline=math.inf).session(robot, DT)
    q, v, goal = robot.home, np.zeros(robot.nv), robot.state().com()[:2].copy()
    for _ in range(1500):
        tick = session.step(robot.state(q, v), centre.at(goal), load.at(4.0, com))
        assert tick.status is Status.OPTIMAL
        q, v = tick.advance()
    there = heavier(robot, frame, 4.0, com).state(q).com()[:2]
    assert np.allclose(there, goal, atol=1e-6)
    assert np.linalg.norm(robot.state(q).com()[:2] - goal) > 0.01
    tick = session.step(robot.state(q, v), centre.at(goal), load.at(math.nan))
    assert tick.status is Status.INVALID_REFERENCE
    wrench = t.ExternalWrench(frame=frame)
    with pytest.raises(DeclarationError, match="Torque for contact forces"):
        hqp.Controller(Stack(Level(centre), subject_to=[wrench]), formulation).session(robot, DT)
    found = hqp.reach(stack, robot, centre.at(goal), load.at(4.0, com))
    assert found.success, found.reason
    assert np.linalg.norm(heavier(robot, frame, 4.0, com).state(found.q).com()[:2] - goal) < 1e-3


@pytest.mark.parametrize("local", [False, True])
@pytest.mark.parametrize(("name", "frame"), [("cbi", "r_palm"), ("panda", "panda_hand")])
def test_a_wrench_is_one_of_pinocchio(robots: dict[str, Any], name: str, frame: str, local: bool) -> None:
    """tau, the contact forces and the wrench together give the program's acceleration."""
    robot = robots[name]
    wrench = t.ExternalWrench(frame=frame, local=local)
    hand = t.Position(frame=frame, name="hand")
    stack = Stack(Level(hand), subject_to=[*feet(robot), wrench])
    session = hqp.Controller(stack, hqp.Torque(), deadline=math.inf).session(robot, DT)
    rng = np.random.default_rng(1)
    w = np.array([30.0, -20.0, 50.0, 3.0, 2.0, -1.0])
    for _ in range(3):
        q, v = robot.integrate(robot.home, rng.uniform(-0.3, 0.3, robot.nv), 1.0), rng.normal(size=robot.nv)
        tick = session.step(robot.state(q, v), wrench.at(w))
        tau = np.zeros(robot.nv)
        tau[robot.actuated] = tick.command
        state = robot.state(q, v)
        for name_, force in session.program.contact_forces(tick.x, world=True).items():
            tau += session.stack.find(name_).jacobian(state).T @ force
        R = state.rotation(frame) if local else np.eye(3)
        tau += state.jacobian(frame).T @ np.concatenate((R @ w[:3], R @ w[3:]))
        qdd = pin.aba(robot.model, robot.model.createData(), q, v, tau)
        assert np.allclose(qdd, session.program.acceleration(tick.x), atol=1e-6 * (1.0 + np.abs(qdd).max()))


def test_the_ground_bears_it(robots: dict[str, Any]) -> None:
    """At rest the feet bear the weight, the payload, and the downward part of the wrench."""
    robot = robots["cbi"]
    load, wrench = t.Payload(frame="r_palm", mass=4.0), t.ExternalWrench(frame="l_palm")
    stack = Stack(Level(t.Posture()), subject_to=[*feet(robot), load, wrench])
    session = hqp.Controller(stack, hqp.Torque(), deadline=math.inf).session(robot, DT)
    tick = session.step(robot.state(), wrench.at([0.0, 0.0, -25.0, 0.0, 0.0, 0.0]))
    acceleration = robot.state().com_jacobian()[2] @ session.program.acceleration(tick.x)
    hand = robot.state().jacobian("r_palm")[2] @ session.program.acceleration(tick.x)
    borne = sum(f[2] for f in session.program.contact_forces(tick.x).values())
    assert borne == pytest.approx((robot.mass + 4.0) * 9.81 + 25.0 + robot.mass * acceleration + 4.0 * hand, rel=1e-6)
    told = str(session.explain(tick))
    assert "r_palm_payload: [4.0, 0.0, 0.0, 0.0], up to" in told
    assert "l_palm_wrench" in told


@pytest.mark.parametrize("told", [False, True])
def test_a_hand_lifts_what_it_carries(robots: dict[str, Any], told: bool) -> None:
    """Panda with 3 kg in its hand: at the goal with a declared load, centimetres below without."""
    robot, frame = robots["panda"], "panda_hand"
    plant = heavier(robot, frame, 3.0, (0.0, 0.0, 0.1))
    load = t.Payload(frame=frame)
    hand = t.Position(frame=frame, name="hand")
    posture = t.Posture(law=PD(25.0))
    stack = Stack(Level(hand), Level(posture), subject_to=[load])
    free = hqp.Torque(loop_law=PD(0.0, 0.0))  # the plant does not couple the fingers
    session = hqp.Controller(stack, free, deadline=math.inf).session(robot, DT)
    q, v = robot.home, np.zeros(robot.nv)
    goal = robot.state().position(frame) + [0.0, 0.1, 0.1]
    data = plant.model.createData()
    tau = np.zeros(robot.nv)
    for _ in range(1000):
        references = [hand.at(goal), load.at(3.0, [0.0, 0.0, 0.1])] if told else [hand.at(goal)]
        tick = session.step(robot.state(q, v), *references)
        tau[robot.actuated] = tick.command
        v = v + DT * pin.aba(plant.model, data, q, v, tau)
        q = robot.integrate(q, v, DT)
    off = float(np.linalg.norm(robot.state(q).position(frame) - goal))
    assert off < 1e-3 if told else off > 0.01


def test_at_rest_the_load_is_held(robots: dict[str, Any]) -> None:
    """Without a usable state, the holding torque is that of the robot with the payload."""
    robot, frame = robots["panda"], "panda_hand"
    load = t.Payload(frame=frame)
    found = []
    for mass in (0.0, 3.0):
        session = hqp.Controller(Stack(Level(t.Posture()), subject_to=[load]), hqp.Torque()).session(robot, DT)
        session.step(robot.state(), load.at(mass, [0.0, 0.0, 0.1]))
        tick = session.step(robot.state(np.full(robot.nq, np.nan)))
        assert tick.status is Status.INVALID_STATE
        found.append(tick.command)
    state = robot.state()
    arm = state.rotation(frame) @ [0.0, 0.0, 0.1]
    skew = np.array([[0, -arm[2], arm[1]], [arm[2], 0, -arm[0]], [-arm[1], arm[0], 0]])
    J = state.jacobian(frame)[:3] - skew @ state.jacobian(frame)[3:]
    expected = 3.0 * 9.81 * J[2][robot.actuated]
    assert np.allclose(found[1] - found[0], expected, atol=1e-8)


def test_what_is_not_finite_is_left_out(robots: dict[str, Any]) -> None:
    robot = robots["panda"]
    load = t.Payload(frame="panda_hand", mass=1.0)
    session = hqp.Controller(Stack(Level(t.Posture()), subject_to=[load]), hqp.Torque()).session(robot, DT)
    good = session.step(robot.state())
    tick = session.step(robot.state(), load.at(math.nan))
    assert tick.status is Status.INVALID_REFERENCE
    assert np.allclose(tick.command, good.command)
    assert session.step(robot.state()).status is Status.OPTIMAL


def test_what_is_refused(robots: dict[str, Any]) -> None:
    robot = robots["panda"]
    load = t.Payload(frame="panda_hand")
    wrench = t.ExternalWrench(frame="panda_hand")
    for formulation in (hqp.Velocity(), hqp.Acceleration()):
        with pytest.raises(DeclarationError, match="loads"):
            hqp.Controller(Stack(Level(t.Posture()), subject_to=[wrench]), formulation).session(robot, DT)
    for formulation in (hqp.Velocity(), hqp.Torque()):
        with pytest.raises(DeclarationError, match="subject_to"):
            hqp.Controller(Stack(Level(t.Posture(), load)), formulation).session(robot, DT)
    stack = Stack(Level(t.Posture()), subject_to=[t.ExternalWrench(frame="panda_hnd")])
    with pytest.raises(FrameNotFound, match="panda_hand"):
        hqp.Controller(stack, hqp.Torque()).session(robot, DT)
    with pytest.raises(DeclarationError, match="mass"):
        t.Payload(frame="hand", mass=math.inf)
    for bad in (lambda: load.at(1.0, [1.0, 2.0]), lambda: t.ExternalWrench(frame="hand").at([1.0, 2.0, 3.0])):
        with pytest.raises(DeclarationError, match="shape"):
            bad()
    stack = Stack(
        Level(t.Posture()), subject_to=[t.Payload(frame="h", mass=2.0), t.ExternalWrench(frame="h", local=True)]
    )
    assert serial.loads(serial.dumps(stack)) == stack


@pytest.mark.parametrize("seed", range(3))
@pytest.mark.parametrize("name", ["cbi", "g1", "panda"])
def test_a_joint_load_is_an_armature_and_a_torque(robots: dict[str, Any], name: str, seed: int) -> None:
    """Drawn joints, inertias and torques: Pinocchio's forward dynamics with them give the program's acceleration."""
    robot, rng = robots[name], np.random.default_rng(seed)
    chosen = tuple(rng.choice(robot.joint_names, int(rng.integers(1, 5)), replace=False).tolist())
    columns = robot.joints(chosen)
    load = t.JointLoad(joints=chosen, inertia=tuple(rng.uniform(0.0, 0.5, len(chosen)).tolist()))
    stack = Stack(Level(t.Posture()), subject_to=[*feet(robot), *robot.couplings, load])
    session = hqp.Controller(stack, hqp.Torque(), deadline=math.inf).session(robot, DT)
    model = pin.Model(robot.model)
    model.armature[columns] += load.inertia
    for _ in range(3):
        q, v = robot.integrate(robot.home, rng.uniform(-0.3, 0.3, robot.nv), 1.0), rng.normal(size=robot.nv)
        d = rng.uniform(-20.0, 20.0, len(chosen))
        tick = session.step(robot.state(q, v), load.at(d))
        assert tick.status is Status.OPTIMAL
        state, tau = robot.state(q, v), robot.actuation.T @ tick.command
        tau[columns] += d
        for held, force in session.program.contact_forces(tick.x, world=True).items():
            tau += session.stack.find(held).jacobian(state).T @ force
        found = session.program.acceleration(tick.x)
        np.testing.assert_allclose(
            pin.aba(model, model.createData(), q, v, tau), found, atol=1e-6 * np.abs(found).max()
        )


@pytest.mark.parametrize("seed", range(3))
def test_a_base_moves_freely_under_its_load(robots: dict[str, Any], seed: int) -> None:
    """Without contacts: Pinocchio's forward dynamics with the wrench in the base's axes give the acceleration."""
    robot, rng = robots["g1"], np.random.default_rng(seed)
    load = t.JointLoad(base=True, inertia=0.1)
    stack = Stack(Level(t.Posture()), subject_to=[load])
    session = hqp.Controller(stack, hqp.Torque(holding=None), deadline=math.inf).session(robot, DT)
    columns = np.concatenate((np.arange(6 * robot.floating), robot.actuated))
    model = pin.Model(robot.model)
    model.armature[robot.actuated] += 0.1
    for _ in range(3):
        q, v = robot.integrate(robot.home, rng.uniform(-0.3, 0.3, robot.nv), 1.0), rng.normal(size=robot.nv)
        d = rng.uniform(-20.0, 20.0, columns.size)
        tick = session.step(robot.state(q, v), load.at(d))
        assert tick.status is Status.OPTIMAL
        tau = robot.actuation.T @ tick.command
        tau[columns] += d
        found = session.program.acceleration(tick.x)
        np.testing.assert_allclose(
            pin.aba(model, model.createData(), q, v, tau), found, atol=1e-6 * np.abs(found).max()
        )
    with pytest.raises(DeclarationError, match="base"):
        hqp.Controller(stack.without(load.name), hqp.Torque(holding=None)).session(robot, DT)
    assert load.inertias(robots["panda"])[0].size == robots["panda"].actuated.size


@pytest.mark.parametrize("seed", range(4))
def test_constraints_change_the_nominal_torque_as_forces_of_contacts(robots: dict[str, Any], seed: int) -> None:
    """Gauss: with a task tau - tau_n = J^T f, with one joint beyond its limit a multiple of its own unit vector."""
    robot, rng = robots["panda"], np.random.default_rng(seed)
    nominal, hand = t.NominalTorque(), t.Position(frame="panda_hand", name="hand")
    q, v = robot.integrate(robot.home, rng.uniform(-0.2, 0.2, robot.nv), 1.0), np.zeros(robot.nv)
    state, tau = robot.state(q, v), rng.uniform(-10.0, 10.0, robot.actuated.size)
    goal = hand.at(state.position("panda_hand") + rng.uniform(-0.2, 0.2, 3))

    def solved(stack: Stack, *references: Any) -> Any:
        formulation = hqp.Torque(holding=None, effort_limits=False)
        session = hqp.Controller(stack, formulation, price=0, deadline=math.inf).session(robot, DT)
        tick = session.step(robot.state(q, v), nominal.at(tau), *references)
        assert tick.status is Status.OPTIMAL
        assert "nominal_torque: [" in str(tick.explain())
        assert "up to 0" not in str(tick.explain())
        return tick.command

    np.testing.assert_allclose(solved(Stack(subject_to=[nominal])), tau, rtol=1e-14)
    change = solved(Stack(Level(hand), subject_to=[nominal]), goal) - tau
    J = robot.state(q, v).jacobian("panda_hand")[:3, robot.actuated]
    force = np.linalg.lstsq(J.T, change, rcond=None)[0]
    np.testing.assert_allclose(J.T @ force, change, atol=1e-7 * np.abs(change).max())
    column = int(rng.integers(robot.actuated.size))
    tau[column] += 60.0
    limits = t.JointLimits(joints=[robot.joint_names[column]], acceleration=5.0)
    change = solved(Stack(subject_to=[nominal, limits])) - tau
    assert abs(change[column]) > 1.0
    np.testing.assert_allclose(np.delete(change, column), 0.0, atol=1e-8)


def test_a_nominal_torque_needs_an_exact_controller(robots: dict[str, Any]) -> None:
    robot, nominal = robots["panda"], t.NominalTorque()
    for formulation, price, more in (
        (hqp.Torque(), None, ()),
        (hqp.Torque(gravity_compensation=True), 0, ()),
        (hqp.Torque(), 0, (t.NominalTorque(name="another"),)),
        (hqp.Acceleration(), 0, ()),
    ):
        stack = Stack(Level(t.Posture()), subject_to=[nominal, *more])
        with pytest.raises(DeclarationError, match="nominal_torque"):
            hqp.Controller(stack, formulation, price=price).session(robot, DT)


@pytest.mark.parametrize("seed", range(3))
def test_readable_code_has_the_same_loads_of_joints(
    robots: dict[str, Any], seed: int, monkeypatch: pytest.MonkeyPatch
) -> None:
    """Python and native code: drawn torques beside the motors and nominal torques give the same command."""
    robot, rng = robots["panda"], np.random.default_rng(seed)
    load, nominal = t.JointLoad(inertia=0.1), t.NominalTorque()
    hand, n = t.Position(frame="panda_hand", name="hand"), robot.actuated.size
    stack = Stack(Level(hand), subject_to=[*robot.couplings, load, nominal])
    controller = hqp.Controller(stack, hqp.Torque(holding=None), price=0, deadline=math.inf)
    native = controller.session(robot, DT)
    monkeypatch.setattr(hqp.programs.assembly, "native", None)
    readable = ReadableSession(controller, robot, DT)
    for _ in range(3):
        q, v = robot.integrate(robot.home, rng.uniform(-0.2, 0.2, robot.nv), 1.0), rng.normal(size=robot.nv)
        references = (
            hand.at(robot.state(q).position("panda_hand") + rng.uniform(-0.1, 0.1, 3)),
            load.at(rng.uniform(-5.0, 5.0, n)), nominal.at(rng.uniform(-10.0, 10.0, n)),
        )  # fmt: skip
        one, two = native.step(robot.state(q, v), *references), readable.step(q, v, *references)
        assert one.status is two.status is Status.OPTIMAL
        np.testing.assert_allclose(one.x, two.x, atol=1e-8 * np.abs(one.x).max())
