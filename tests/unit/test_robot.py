from __future__ import annotations

import pickle
from itertools import product
from pathlib import Path

import numpy as np
import pinocchio as pin
import pytest

import hqp
from hqp.errors import DeclarationError, FrameNotFound, JointNotFound, ModelError, StaleState
from hqp.robots import Robot
from hqp.tasks import Posture


@pytest.fixture(scope="module")
def cbi() -> Robot:
    return hqp.robots.load("cbi")


def test_cbi_is_the_published_robot(cbi: Robot) -> None:
    assert (cbi.nv, len(cbi.joint_names), cbi.floating) == (57, 51, True)
    assert cbi.mass == pytest.approx(87.0, abs=1e-6)
    state = cbi.state()
    assert state.position("l_sole")[2] == pytest.approx(0.0, abs=1e-9)
    assert cbi.actuation.shape == (51, 57)


def test_errors_name_the_closest(cbi: Robot) -> None:
    with pytest.raises(FrameNotFound, match="r_palm"):
        cbi.frame("r_plam")
    with pytest.raises(JointNotFound, match="R_KFE"):
        cbi.joints("R_KFF")
    with pytest.raises(ModelError, match="cbi"):
        hqp.robots.load("cbii")
    with pytest.raises(ModelError, match="no such file"):
        hqp.robots.load("nowhere.urdf")
    with pytest.raises(DeclarationError, match="allowed"):
        hqp.robots.load(3)  # type: ignore[arg-type]


def test_wrong_shapes_are_refused(cbi: Robot) -> None:
    with pytest.raises(ModelError, match=r"q \(58,\) and v \(57,\)"):
        cbi.state(np.zeros(57))


def test_a_stale_state_refuses(cbi: Robot) -> None:
    old = cbi.state()
    old.kinematics()
    cbi.state()
    with pytest.raises(StaleState):
        old.kinematics()
    with pytest.raises(StaleState):
        old.com()


def test_a_copy_has_data_of_its_own(cbi: Robot) -> None:
    state, other = cbi.state(), cbi.copy()
    other.state(other.random_configuration(np.random.default_rng(0))).kinematics()
    before = state.position("r_palm")
    assert np.array_equal(before, cbi.state().position("r_palm"))


def test_quantities_do_not_disturb_each_other(cbi: Robot) -> None:
    """Pinocchio shares one Data: each quantity is independent of the quantities computed before it."""
    rng = np.random.default_rng(5)
    q, v = cbi.random_configuration(rng), rng.standard_normal(cbi.nv)
    chest = cbi.subtree("B_TFE")
    asks = {
        "com": lambda s: s.com(),
        "subtree": lambda s: s.com(chest),
        "com_jacobian": lambda s: s.com_jacobian().copy(),
        "subtree_jacobian": lambda s: s.com_jacobian(chest),
        "com_drift": lambda s: s.com_drift(),
        "subtree_drift": lambda s: s.com_drift(chest),
        "jacobian": lambda s: s.jacobian("r_palm"),
        "drift": lambda s: s.drift("r_palm"),
        "mass": lambda s: s.mass_matrix().copy(),
        "bias": lambda s: s.bias_force().copy(),
        "gravity": lambda s: s.gravity_force(),
        "position": lambda s: s.position("l_sole"),
        "velocity": lambda s: s.velocity("r_palm"),
        "inertia_rate": lambda s: s.inertia_rate(),
        "momentum": lambda s: np.column_stack(s.momentum_map()),
    }
    alone = {name: ask(cbi.state(q, v)) for name, ask in asks.items()}
    for one, other in product(asks, repeat=2):
        state = cbi.state(q, v)
        for name in (one, other, one):  # the second quantity may overwrite the cache of the first
            assert np.allclose(asks[name](state), alone[name], atol=1e-10), f"{name} of {one}, {other}, {one}"
    for _ in range(30):
        state = cbi.state(q, v)
        for name in rng.permutation(list(asks)):
            assert np.allclose(asks[name](state), alone[name], atol=1e-10), name


def test_subtree_is_divided_by_its_own_mass(cbi: Robot) -> None:
    state = cbi.state()
    whole = cbi.subtree("B_TR")
    below = state.com(whole)
    data, model = cbi.data, cbi.model
    members = [i for i in range(1, model.njoints) if whole in list(model.supports[i])]
    masses = np.array([model.inertias[i].mass for i in members])
    centres = np.array([data.oMi[i].act(model.inertias[i].lever) for i in members])
    assert np.allclose(below, masses @ centres / masses.sum(), atol=1e-12)


def test_subtree_motion_matches_finite_differences(cbi: Robot) -> None:
    rng = np.random.default_rng(6)
    q, v, h = cbi.random_configuration(rng), rng.standard_normal(cbi.nv), 1e-5
    chest = cbi.subtree("B_TFE")
    ahead, behind = (cbi.state(cbi.integrate(q, v, s), v) for s in (h, -h))
    values = {}
    for name, state in (("ahead", ahead), ("behind", behind)):
        cbi.current = state
        values[name] = state.com(chest), state.com_velocity(chest)
    state = cbi.state(q, v)
    rate = (values["ahead"][0] - values["behind"][0]) / (2 * h)
    drift = (values["ahead"][1] - values["behind"][1]) / (2 * h)
    assert np.allclose(state.com_velocity(chest), rate, atol=1e-7)
    assert np.allclose(state.com_drift(chest), drift, atol=1e-6)


def test_limits_of_the_free_base_are_infinite(cbi: Robot) -> None:
    assert np.isinf(cbi.lower[:6]).all()
    assert np.isinf(cbi.velocity_limit[:6]).all()
    assert np.all(cbi.lower[6:] < cbi.upper[6:])


def test_a_pinocchio_model_and_files_load(tmp_path: object) -> None:
    fixed = Robot(pin.buildSampleModelManipulator(), name="arm")
    assert not fixed.floating
    assert fixed.state().finite
    assert hqp.robots.load(pin.buildSampleModelHumanoid()).floating


def test_nan_is_seen(cbi: Robot) -> None:
    q = cbi.home.copy()
    q[8] = np.nan
    assert not cbi.state(q).finite
    assert cbi.state().finite


@pytest.mark.parametrize("source", ["cbi", "dreamer", "ur5", "talos", "two_legs.xml", "path"])
def test_robots_pickle(source: str) -> None:
    """Pickle a robot after use of its cached properties; rebuild its live parts."""
    if source.endswith(".xml"):
        robot = hqp.robots.load(Path(__file__).parent.parent / "data" / "mjcf" / source)
    else:
        robot = hqp.robots.load("ur5" if source == "path" else source)
    if source == "path":
        assert robot.source is not None
        robot = hqp.robots.load(robot.source).with_frame("tip", robot.frame_names[-1], [0.0, 0.0, 0.1])
    robot.state().com()
    _ = robot.bodies, robot.tree_joints, robot.couplings
    twin = pickle.loads(pickle.dumps(robot))
    q = robot.random_configuration(np.random.default_rng(1), 0.3)
    one, other = robot.state(q), twin.state(q)
    assert twin.joint_names == robot.joint_names
    np.testing.assert_array_equal(one.com(), other.com())
    np.testing.assert_array_equal(one.position(robot.frame_names[-1]), other.position(robot.frame_names[-1]))
    stack = hqp.Stack(hqp.Level(Posture()))
    first, second = (hqp.Controller(stack, deadline=np.inf).session(each, 0.002) for each in (robot, twin))
    goal = Posture().at(np.zeros(robot.joints().size))
    for _ in range(2):
        np.testing.assert_array_equal(
            first.step(robot.state(q), goal).command, second.step(twin.state(q), goal).command
        )
