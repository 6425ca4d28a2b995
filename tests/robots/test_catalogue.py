"""Every robot of the catalogue loads, has its home inside its limits and its soles on the ground."""

from __future__ import annotations

import numpy as np
import pinocchio as pin
import pytest

import hqp.robots
from hqp.robots import geometry
from hqp.robots.catalogue import _catalogue

NAMES = hqp.robots.names()
VARIANTS = {name for name, entry in _catalogue().items() if "like" in entry}
STANDING = ("cbi", "dreamer", "talos", "g1", "icub", "romeo", "solo12", "anymal", "go2")
_LEVEL, _HEIGHT = 0.005, 0.001  # tilt of a sole [rad], height of the lowest point of a foot's shape [m]


@pytest.mark.parametrize("name", NAMES)
def test_loads_with_home_inside_its_limits(name: str) -> None:
    robot = hqp.robots.load(name)
    angles = robot.state().angles
    assert (angles >= robot.lower - 1e-12).all()
    assert (angles <= robot.upper + 1e-12).all()
    assert np.isfinite(robot.state().jacobian(robot.frame_names[-1])).all()
    assert robot.source is not None
    assert robot.source.is_file()


def test_all_of_the_package_are_listed() -> None:
    assert len(NAMES) >= 70
    assert set(STANDING) <= set(NAMES)


@pytest.mark.parametrize(
    "name", ["talos", "g1", "icub", "romeo", "solo12", "anymal", "go2", "talos_full_v2", "g1_29dof_with_hand_rev_1_0"]
)
def test_feet_stand_on_the_ground(name: str) -> None:
    """Soles are level, at the lowest point of the foot's shape and at height zero."""
    robot = hqp.robots.load(name)
    state = robot.state()
    state.kinematics()
    soles = robot.landmarks.get("soles", ())
    for frame in soles or robot.landmarks["feet"]:
        lowest = geometry.lowest(robot.model, robot.data, robot.geometry, robot.body(robot.frame(frame)))
        assert abs(lowest) < _HEIGHT
        if soles:
            assert abs(state.position(frame)[2] - lowest) < _HEIGHT
            assert np.hypot(*state.rotation(frame)[2, :2]) < _LEVEL


@pytest.mark.parametrize("name", [pytest.param(n, marks=[pytest.mark.slow] * (n in VARIANTS)) for n in NAMES])
def test_no_floating_robot_stands_in_the_ground(name: str) -> None:
    robot = hqp.robots.load(name)
    if not robot.floating:
        pytest.skip("its base is fixed")
    robot.state().kinematics()
    joints = {item.parentJoint for item in robot.geometry.geometryObjects} - {0}
    heights = [geometry.lowest(robot.model, robot.data, robot.geometry, k) for k in joints]
    if not heights or not np.isfinite(heights).any():
        pytest.skip("it has no shapes")
    assert min(heights) > -_HEIGHT
    if name != "pr2":  # pr2's wheels have no shape
        assert min(heights) < _HEIGHT


@pytest.mark.long
@pytest.mark.parametrize("name", ["talos", "panda", "ur5"])
def test_shapes_to_touch_and_to_draw(name: str) -> None:
    robot = hqp.robots.load(name)
    for shapes in (robot.geometry, robot.visual):
        assert isinstance(shapes, pin.GeometryModel)
        assert shapes.ngeoms >= 6
        assert max(item.parentJoint for item in shapes.geometryObjects) < robot.model.njoints
