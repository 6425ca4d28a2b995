"""Elements: values, masks, wrapping, relative motion, ranks, and refused arguments."""

from __future__ import annotations

import dataclasses
import math
from collections.abc import Callable
from typing import Any

import numpy as np
import pinocchio as pin
import pytest

import hqp
import hqp.robots
import hqp.tasks as t
from hqp import Level, P, Stack
from hqp.declare.element import REGISTRY, Constraint, Element, Task
from hqp.errors import DeclarationError, FrameNotFound, JointNotFound

Written = Callable[..., Any]


@pytest.fixture(scope="module")
def cbi() -> Any:
    return hqp.robots.load("cbi")


@pytest.fixture
def state(cbi: Any) -> Any:
    rng = np.random.default_rng(5)
    return cbi.state(cbi.random_configuration(rng), rng.normal(size=cbi.nv))


def test_every_class_is_public() -> None:
    ours = {name for name, cls in REGISTRY.items() if cls.__module__.startswith("hqp.tasks")}
    assert ours == set(t.__all__)


@pytest.mark.parametrize(
    ("cls", "fields", "what"),
    [
        (t.Position, {"frame": ""}, "frame"),
        (t.Position, {"frame": 3}, "frame"),
        (t.Position, {"frame": "hand", "axes": ""}, "axes"),
        (t.Position, {"frame": "hand", "axes": "xx"}, "axes"),
        (t.Position, {"frame": "hand", "axes": "xw"}, "axes"),
        (t.Position, {"frame": "hand", "offset": (1.0, 2.0)}, "offset"),
        (t.Position, {"frame": "hand", "offset": (1.0, 2.0, math.inf)}, "offset"),
        (t.Position, {"frame": "hand", "heading": True}, "heading"),
        (t.Position, {"frame": "hand", "relative_to": ""}, "relative_to"),
        (t.Position, {"frame": "hand", "weight": math.nan}, "weight"),
        (t.Position, {"frame": "hand", "law": 3.0}, "law"),
        (t.Orientation, {"frame": "hand", "axes": "rol"}, "roll, pitch, yaw"),
        (t.Orientation, {"frame": "hand", "axes": ("roll", "roll")}, "axes"),
        (t.Orientation, {"frame": "hand", "axes": ()}, "axes"),
        (t.Pose, {"frame": None}, "frame"),
        (t.Com, {"axes": 2}, "axes"),
        (t.Com, {"subtree": ""}, "subtree"),
        (t.Com, {"heading": True}, "heading"),
        (t.Posture, {"joints": []}, "joints"),
        (t.Posture, {"joints": [1]}, "joints"),
        (t.FixedContact, {"frame": ""}, "frame"),
        (t.EdgeContact, {"frame": "foot", "axis": "w"}, "axis"),
        (t.EdgeContact, {"frame": "foot", "axis": (0.0, 0.0, 0.0)}, "axis"),
        (t.EdgeContact, {"frame": "foot", "axis": (1.0, 0.0)}, "axis"),
    ],
)
def test_bad_fields_are_refused(cls: Any, fields: dict[str, Any], what: str) -> None:
    with pytest.raises(DeclarationError, match=what):
        cls(**fields)


@pytest.mark.parametrize(
    ("element", "references"),
    [
        (t.Position(frame="r_palm", axes="xz"), [{"value": [1, 2, 3]}, {"velocity": [1]}, {"acceleration": [[1, 2]]}]),
        (t.Position(frame="r_palm"), [{"value": "here"}, {"value": 1.0}, {"value": [1, 2, "z"]}]),
        (t.Com(axes="z"), [{"value": [1, 2]}]),
        (t.Orientation(frame="r_palm"), [{"value": [1, 2, 3]}, {"value": np.ones((3, 3))}, {"value": np.zeros(4)}]),
        (t.Orientation(frame="r_palm"), [{"value": -np.eye(3)}, {"value": 1.001 * np.eye(3)}, {"velocity": [1, 2]}]),
        (t.Orientation(frame="r_palm", axes="roll"), [{"value": [1, 2]}, {"value": np.eye(3)}]),
        (t.Pose(frame="r_palm"), [{"value": np.zeros((4, 4))}, {"value": ([1, 2], np.eye(3))}, {"value": np.eye(3)}]),
        (t.Pose(frame="r_palm"), [{"velocity": [1, 2, 3]}]),
        (t.FixedContact(frame="l_sole"), [{"value": np.eye(4)[::-1]}]),
        (t.PointContact(frame="l_sole"), [{"value": np.eye(4)}]),
        (
            t.EdgeContact(frame="l_sole", axis="y"),
            [{"value": np.ones(6)}, {"value": np.ones(3)}, {"velocity": [0] * 6}],
        ),
        (t.Posture(joints=["R_EB", "L_EB"]), [{"value": [[1, 2]]}, {"value": [1, 2], "velocity": [1]}]),
        (t.JointCoupling({"R_EB": 1.0}), [{"value": [1, 2]}]),
    ],
)
def test_bad_references_are_refused(element: Any, references: list[dict[str, Any]]) -> None:
    for reference in references:
        with pytest.raises(DeclarationError, match=element.name):
            element.at(**reference)


@pytest.mark.parametrize(
    ("element", "value"),
    [
        (t.Position(frame="r_palm"), [0, np.nan, 0]),
        (t.Orientation(frame="r_palm"), np.full((3, 3), np.nan)),
        (t.Orientation(frame="r_palm"), [np.nan, 0, 0, 1]),
        (t.Pose(frame="r_palm"), np.full((4, 4), np.inf)),
        (t.Orientation(frame="r_palm"), [np.inf, 0, 0, 1]),
        (t.EdgeContact(frame="l_sole", axis="y"), [0, 0, 0, np.nan, 0, 0]),
        (t.EdgeContact(frame="l_sole", axis="y"), [0, 0, 0, np.inf, 0, 0]),
    ],
)
def test_not_finite_references_are_left_to_the_loop(element: Any, value: Any) -> None:
    with np.errstate(invalid="ignore"):
        assert not element.at(value).finite


@pytest.mark.parametrize(
    ("element", "error"),
    [
        (t.Position(frame="r_plam"), FrameNotFound),
        (t.Position(frame="r_palm", relative_to="pelvs"), FrameNotFound),
        (t.Orientation(frame="r_plam"), FrameNotFound),
        (t.Pose(frame="r_plam"), FrameNotFound),
        (t.Com(relative_to="pelvs"), FrameNotFound),
        (t.Com(subtree="B_T"), JointNotFound),
        (t.Posture(joints="upper_bdy"), JointNotFound),
        (t.FixedContact(frame="l_soel"), FrameNotFound),
        (t.PointContact(frame="l_soel"), FrameNotFound),
        (t.EdgeContact(frame="l_soel", axis="y"), FrameNotFound),
        (t.JointCoupling({"R_EBB": 1.0}), JointNotFound),
        (t.JointLimits(joints="R_EBB"), JointNotFound),
    ],
)
def test_unknown_names_are_told_with_the_closest(cbi: Any, element: Element, error: Any) -> None:
    with pytest.raises(error, match="closest"):
        element.rows(cbi)


def test_declarations_compare_and_hash() -> None:
    one, other = t.Position(frame="r_palm", offset=[0, 0, 1]), t.Position(frame="r_palm", offset=(0.0, 0.0, 1.0))  # type: ignore[arg-type]
    assert one == other
    assert hash(one) == hash(other)
    assert one.name == "r_palm"
    assert t.Com().name == "com"
    assert t.JointLimits().name == "joint_limits"
    with pytest.raises(dataclasses.FrozenInstanceError):
        one.frame = "l_palm"  # type: ignore[misc]


def test_masks_choose_and_order(state: Any) -> None:
    p = state.position("r_palm")
    np.testing.assert_array_equal(t.Position(frame="r_palm", axes="zx").value(state), p[[2, 0]])
    np.testing.assert_array_equal(t.Com(axes="y").value(state), state.com()[[1]])
    angles = pin.rpy.matrixToRpy(state.rotation("r_palm"))
    found = t.Orientation(frame="r_palm", axes=["yaw", "roll"]).value(state)  # type: ignore[arg-type]
    np.testing.assert_allclose(found, angles[[2, 0]], atol=1e-12)
    elbows = t.Posture(joints=["R_EB", "L_EB"])
    np.testing.assert_array_equal(elbows.value(state), state.angles[state.robot.joints(["R_EB", "L_EB"])])


def test_orientations_given_either_way(state: Any, written: Written) -> None:
    task, R = t.Orientation(frame="r_palm"), pin.exp3(np.array([0.3, -1.2, 0.8]))
    quaternion = pin.Quaternion(R).coeffs()
    np.testing.assert_allclose(task.at(2.0 * quaternion).value, R, atol=1e-12)
    one, other = (written(task, state, task.at(x)).error for x in (R, quaternion))
    np.testing.assert_allclose(one, other, atol=1e-12)
    pose = t.Pose(frame="r_palm")
    np.testing.assert_allclose(pose.at(([1, 2, 3], quaternion)).value, pin.SE3(R, np.array([1.0, 2, 3])).homogeneous)


@pytest.mark.parametrize("length", [1e-3, 0.99, 1.0, 1.0 + 5e-4, 1.01, 2.0])
def test_a_target_that_is_normalised_is_noted(length: float) -> None:
    """In each way of passing the quaternion, the command is that of the normalised quaternion."""
    turned = np.array([0.1, -0.2, 0.05, 0.97])
    turned /= np.linalg.norm(turned)
    cbi = hqp.robots.load("cbi", floating=False)
    hand = t.Pose(frame="r_palm", name="hand")
    place = cbi.state().position("r_palm")
    sessions = [hqp.Controller(Stack(Level(hand))).session(cbi, 0.002) for _ in range(3)]
    q, v = cbi.home, np.zeros(cbi.nv)
    ticks = [
        sessions[0].step(cbi.state(q, v), hand.at((place, turned))),
        sessions[1].step(cbi.state(q, v), hand.at((place, length * turned))),
        sessions[2].tick(q, v, {"hand": (place, length * turned)}),
    ]
    told = [[note.detail for note in tick.notes if "quaternion" in note.detail] for tick in ticks]
    assert told[0] == []
    assert (
        told[1]
        == told[2]
        == (
            [f"target quaternion x, y, z, w of length {length:.4g} was normalised; allowed: 1 +- 0.001"]
            if abs(length - 1.0) > 1e-3
            else []
        )
    )
    for tick in ticks[1:]:
        np.testing.assert_allclose(tick.command, ticks[0].command, atol=1e-9)


def test_angles_are_wrapped(state: Any, written: Written) -> None:
    task = t.Orientation(frame="r_palm", axes=("roll", "yaw"))
    angles = task.value(state)
    np.testing.assert_allclose(
        written(task, state, task.at(angles + [2 * np.pi - 0.1, -4 * np.pi + 0.2])).error, [0.1, -0.2]
    )
    assert t.Orientation(frame="r_palm", axes="yaw").at(0.3, velocity=0.1).velocity.shape == (1,)  # type: ignore[union-attr]


def test_continuous_joints_are_wrapped(written: Written) -> None:
    if "tiago" not in hqp.robots.names():
        pytest.skip("needs example-robot-data")
    robot = hqp.robots.load("tiago")
    wheel, other = (robot.joint_name(int(c)) for c in (robot.continuous[0], robot.actuated[0]))
    posture, state = t.Posture(joints=[wheel, other]), robot.state()
    angles = posture.value(state)
    for error in (
        written(posture, state, posture.at(angles + 2 * np.pi - 0.1)).error,
        posture.error(state, angles + 2 * np.pi - 0.1),
    ):
        np.testing.assert_allclose(error, [0.1, 0.1 - 2 * np.pi], atol=1e-12)


def test_a_posture_of_another_length_is_refused(state: Any, written: Written) -> None:
    posture = t.Posture(joints="r_arm")
    with pytest.raises(DeclarationError, match=r"shape \(2,\)"):
        written(posture, state, posture.at([0.0, 0.0]))
    with pytest.raises(DeclarationError, match="do not overlap"):
        t.Posture(joints=["r_arm", "R_EB"]).rows(state.robot)


def test_pitch_at_90_degrees_stays_finite(cbi: Any, written: Written) -> None:
    task = t.Orientation(frame="pelvis", axes=("roll", "pitch", "yaw"))
    for pitch in (np.pi / 2, -np.pi / 2, np.pi / 2 - 1e-9):
        q = cbi.home.copy()
        q[3:7] = pin.Quaternion(pin.rpy.rpyToMatrix(0.4, pitch, -0.7)).coeffs()
        state = cbi.state(q, np.ones(cbi.nv))
        block = written(task, state, task.at([0.0, 0.0, 0.0]))
        assert np.isfinite(block.J).all()
        assert np.isfinite(block.drift).all()
        assert block.error[1] == pytest.approx(pitch, abs=1e-7)


def test_a_subtree_is_divided_by_its_own_mass(cbi: Any, state: Any) -> None:
    joint = int(cbi.model.getJointId("B_TR"))
    masses = [
        (cbi.model.inertias[j].mass, cbi.data.oMi[j] * cbi.model.inertias[j].lever) for j in cbi.model.subtrees[joint]
    ]
    state.kinematics()
    masses = [
        (cbi.model.inertias[j].mass, cbi.data.oMi[j] * cbi.model.inertias[j].lever) for j in cbi.model.subtrees[joint]
    ]
    expected = sum(m * c for m, c in masses) / sum(m for m, _ in masses)
    np.testing.assert_allclose(t.Com(subtree="B_TR").value(state), expected, atol=1e-12)


@pytest.mark.parametrize(
    "task",
    [
        t.Position(frame="r_palm", relative_to="pelvis"),
        t.Orientation(frame="r_palm", relative_to="pelvis"),
        t.Pose(frame="r_palm", relative_to="pelvis"),
        t.Com(subtree="B_TR", relative_to="pelvis"),
    ],
)
def test_relative_tasks_do_not_see_the_base(cbi: Any, task: Any) -> None:
    rng = np.random.default_rng(3)
    q = cbi.random_configuration(rng)
    before = task.value(cbi.state(q))
    assert np.abs(task.jacobian(cbi.state(q))[:, :6]).max() < 1e-12
    q[:7] = [1.0, 2.0, 3.0, *pin.Quaternion(pin.exp3(rng.normal(size=3))).coeffs()]
    np.testing.assert_allclose(task.value(cbi.state(q)), before, atol=1e-12)


def test_a_heading_turns_with_yaw_alone(cbi: Any) -> None:
    task = t.Position(frame="r_palm", relative_to="pelvis", heading=True)
    state = cbi.state(cbi.random_configuration(np.random.default_rng(3)))
    _, _, yaw = pin.rpy.matrixToRpy(state.rotation("pelvis"))
    difference = state.position("r_palm") - state.position("pelvis")
    np.testing.assert_allclose(task.value(state), pin.rpy.rpyToMatrix(0.0, 0.0, yaw).T @ difference, atol=1e-12)


def test_an_edge_is_two_of_its_points(cbi: Any, state: Any) -> None:
    """Same row space as the six rows of the two points, rank 5 (Mistry 2008, condition 3)."""
    state.kinematics()
    edge = t.EdgeContact(frame="l_sole", axis=(1.0, 2.0, 0.0)).jacobian(state)
    points = [t.Position(frame="l_sole", offset=(a, 2 * a, 0.0)).jacobian(state) for a in (0.0, 0.1)]  # type: ignore[arg-type]
    rank = np.linalg.matrix_rank
    assert rank(edge) == rank(np.vstack(points)) == rank(np.vstack((edge, *points))) == 5


@pytest.mark.parametrize("turn", [0.4, -2.0])
def test_an_edge_may_turn_about_itself(cbi: Any, written: Written, turn: float) -> None:
    contact = t.EdgeContact(frame="pelvis", axis="y")
    q = cbi.home.copy()
    hold = contact.hold(cbi.state(q))
    q[3:7] = (pin.Quaternion(q[6], *q[3:6]) * pin.Quaternion(pin.exp3(np.array([0.0, turn, 0.0])))).coeffs()
    state = cbi.state(q)
    np.testing.assert_allclose(written(contact, state, hold).error, 0.0, atol=1e-12)
    q[3:7] = (pin.Quaternion(pin.exp3(np.array([0.01, 0.0, 0.0]))) * pin.Quaternion(q[6], *q[3:6])).coeffs()
    assert np.linalg.norm(written(contact, cbi.state(q), hold).error) == pytest.approx(0.01, rel=1e-4)


CONSTRAINTS: list[Any] = [
    t.FixedContact(frame="l_sole"),
    t.PointContact(frame="l_sole"),
    t.EdgeContact(frame="l_sole", axis="y"),
    t.OmniWheelContact(wheel="l_sole", radius=0.1, axle=(0.0, 1.0, 0.0)),
    t.WheelContact(wheel="l_sole", radius=0.1, axle=(0.0, 1.0, 0.0)),
    t.JointCoupling({"R_EB": 1.0, "L_EB": -1.0}),
    t.JointLimits(joints="arms"),
]


@pytest.mark.parametrize("constraint", CONSTRAINTS, ids=lambda c: type(c).__name__)
@pytest.mark.parametrize("formulation", [hqp.Velocity(), hqp.Acceleration()], ids=["velocity", "acceleration"])
def test_every_constraint_binds_in_subject_to_and_in_a_level(cbi: Any, constraint: Any, formulation: Any) -> None:
    """A first level of priority acts like a constraint; feedback brings the hand as near as the rest allows."""
    assert isinstance(constraint, Constraint)
    hand = t.Position(frame="r_palm")
    answers = []
    for stack in (
        Stack(Level(hand), subject_to=[constraint]),
        Stack(Level(constraint), Level(hand)),
    ):
        session = hqp.Controller(stack, formulation, solver="cascade:proxqp").session(cbi, dt=0.002)
        rng = np.random.default_rng(11)
        state = cbi.state(cbi.home, 0.01 * rng.normal(size=cbi.nv))
        tick = session.step(state, hand.at(state.position("r_palm") + [0.05, 0.0, 0.02]))
        assert tick.status is hqp.Status.OPTIMAL
        assert np.abs(tick.solution.residuals[0]).max() < 1e-8  # type: ignore[union-attr]
        answers.append(tick.solution.x)  # type: ignore[union-attr]
    np.testing.assert_allclose(answers[0], answers[1], atol=1e-5)


def test_contacts_are_constraints_and_tasks() -> None:
    for name in ("FixedContact", "PointContact", "EdgeContact", "OmniWheelContact", "WheelContact"):
        assert issubclass(REGISTRY[name], Constraint)
        assert issubclass(REGISTRY[name], Task)
        assert REGISTRY[name].is_contact
    assert not t.JointCoupling({"a": 1.0}).is_contact
    assert not t.Position(frame="hand", law=P(1.0)).is_contact


def test_the_package_has_one_name() -> None:
    import runpy
    from pathlib import Path

    with pytest.raises(ImportError, match=r"import hqp\.tasks"):
        runpy.run_path(str(Path(t.__file__).resolve()))
