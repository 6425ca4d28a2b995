"""The ZMP of a walk stays where the ankles of its feet bear the weight."""

from __future__ import annotations

import math
from pathlib import Path
from typing import Any

import numpy as np
import pinocchio as pin
import pytest

import hqp.robots
from hqp.errors import DeclarationError
from hqp.robots.knees import knee
from hqp.tasks.polygons import shrunk
from hqp.walking import Gait, Walker, Walkers
from hqp.walking.ankle import RESERVE, supporting
from hqp.walking.feet import EDGE, PART, Foot, feet_of
from tests.scenes.masses import scaled

NAMES = "g1", "talos", "romeo", "icub"


def sole_of(foot: Foot) -> Any:
    """Corners of the support that the sole alone allows."""
    return shrunk(shrunk(foot.corners, foot.margin), min(EDGE, PART * foot.margin))


def ankle(robot: Any, foot: Foot) -> Any:
    """Columns of the joints of a leg beyond its knee."""
    name, _ = knee(robot, foot.leg, robot.home)
    return robot.joints(foot.leg[foot.leg.index(name) + 1 :])


def share(robot: Any, foot: Foot, point: Any) -> float:
    """Largest share of a limit that a joint of the ankle bears, all weight at a point of the sole, by Pinocchio's RNEA
    at home."""
    model, data = robot.model, robot.model.createData()
    pin.framesForwardKinematics(model, data, robot.home)
    frame = model.frames[robot.frame(foot.frame)]
    placed = data.oMf[robot.frame(foot.frame)]
    up = placed.rotation[:, 2] * -robot.mass * robot.gravity[2]
    at = placed.act(np.array([*point, 0.0]))
    forces = pin.StdVec_Force()
    for joint in range(model.njoints):
        forces.append(pin.Force.Zero())
        if joint == frame.parentJoint:
            forces[joint] = data.oMi[joint].actInv(pin.Force(up, np.cross(at, up)))
    v = np.zeros(robot.nv)
    tau = pin.rnea(model, data, robot.home, v, v, forces)
    columns = ankle(robot, foot)
    return float(np.max(np.abs(tau[columns]) / robot.effort_limit[columns]))


@pytest.mark.long
@pytest.mark.parametrize("seed", range(3))
@pytest.mark.parametrize("name", NAMES)
def test_support_and_planned_zmp_are_within_the_torques_of_the_ankle(name: str, seed: int) -> None:
    """Drawn torque limits; the aim is the nearest point to the middle that leaves the reserve."""
    rng = np.random.default_rng(seed)
    robot = hqp.robots.load(name)
    columns = np.concatenate([ankle(robot, foot) for foot in feet_of(robot)])
    robot.effort_limit[columns] *= rng.uniform(0.2, 1.2)
    for foot in feet_of(robot):
        assert max(share(robot, foot, corner) for corner in foot.support) < 1.0 + 1e-9
        sole, support = np.array(sole_of(foot)), np.array(foot.support)
        for point in rng.dirichlet(np.ones(len(sole)), 40) @ sole:
            inside = _inside(support, point)
            assert inside == (share(robot, foot, point) <= 1.0) or abs(share(robot, foot, point) - 1.0) < 1e-6
            if inside and share(robot, foot, point) < 1.0 - RESERVE:
                assert math.dist(point, foot.middle) >= math.dist(foot.aim, foot.middle) - 1e-9
        middle, aim = share(robot, foot, foot.middle), share(robot, foot, foot.aim)
        assert bool(foot.why) == (foot.aim != foot.middle) == (middle > 1.0 - RESERVE)
        assert aim == pytest.approx(1.0 - RESERVE) if foot.why else aim == middle


def _inside(corners: Any, point: Any) -> bool:
    side, off = np.roll(corners, -1, axis=0) - corners, point - corners
    return bool(np.all(side[:, 0] * off[:, 1] - side[:, 1] * off[:, 0] >= 0.0))


@pytest.mark.parametrize("name", NAMES)
def test_ankles_of_ample_torque_change_no_bit(name: str) -> None:
    robot = hqp.robots.load(name)
    robot.effort_limit[:] *= 10.0
    for foot in feet_of(robot):
        assert (foot.support, foot.aim, foot.why) == (sole_of(foot), foot.middle, "")
        assert foot.inwards == 0.0


def test_an_ankle_that_bears_the_weight_nowhere_is_refused() -> None:
    """A sole that begins a metre ahead of the ankle."""
    robot = hqp.robots.load("g1")
    foot, _ = feet_of(robot)
    ahead = tuple((x + 1.0, y) for x, y in sole_of(foot))
    with pytest.raises(DeclarationError, match="does not stand on one foot"):
        supporting(robot, foot.frame, foot.leg, ahead, (1.0, 0.0))


@pytest.mark.filterwarnings("ignore")
def test_a_walker_names_feet_whose_zmp_is_moved(tmp_path: Path) -> None:
    walker = Walker(hqp.robots.load("icub"), deadline=math.inf)
    named = tuple(foot.why for foot in walker.feet)
    assert all("beside the middle of the sole, which takes" in why for why in named)
    walker.go(9.0)
    assert walker.why[:2] == named
    assert len(walker.why) == 3
    walker.export(tmp_path / "walker.hqp")
    batch = Walkers.load(tmp_path / "walker.hqp", 1)
    assert batch.why(0) == named


def lifted(robot: Any, foot: Foot, q: Any) -> Any:
    """Share of its limit that each motor bears as the other foot lifts off, by Pinocchio's RNEA: links that accelerate
    as one feel another gravity."""
    model, data = robot.model.copy(), robot.model.createData()
    c = pin.centerOfMass(model, data, q)
    pin.framesForwardKinematics(model, data, q)
    p = data.oMf[robot.frame(foot.frame)].act(np.array([*foot.aim, 0.0]))
    felt = (c - p) * 9.81 / (c - p)[2]
    model.gravity.linear = -felt
    forces = pin.StdVec_Force()
    for joint in range(model.njoints):
        forces.append(pin.Force.Zero())
        if joint == model.frames[robot.frame(foot.frame)].parentJoint:
            forces[joint] = data.oMi[joint].actInv(pin.Force(robot.mass * felt, np.cross(p, robot.mass * felt)))
    v = np.zeros(robot.nv)
    tau = pin.rnea(model, model.createData(), q, v, v, forces)[robot.actuated]
    return np.abs(tau) / robot.effort_limit[robot.actuated]


@pytest.mark.long
@pytest.mark.parametrize("seed", range(4))
@pytest.mark.parametrize("name", ["g1", "romeo"])
def test_joints_that_a_step_overloads_are_named(name: str, seed: int) -> None:
    """Drawn torque limits above the feet; the base has no torque of its own in the judgement either."""
    rng = np.random.default_rng(seed)
    robot = hqp.robots.load(name)
    legs = robot.joints([joint for foot in feet_of(robot) for joint in foot.leg[:3]])
    robot.effort_limit[legs] *= rng.uniform(0.2, 1.2, legs.size)
    walker = Walker(robot, deadline=math.inf)
    expected = []
    for foot in walker.feet:
        shares = zip(robot.joint_names, lifted(robot, foot, walker.start), strict=True)
        expected += [f"{joint} needs {100.0 * share:.0f} % of" for joint, share in shares if share > 1.0]
    named = [why for why in walker.why if " needs " in why]
    assert [why.split(" its ")[0] for why in named] == expected
    slow = Walker(robot, Gait(), deadline=math.inf)
    assert slow.gait == Gait()
    assert walker.gait.single == pytest.approx((2.0 / 3.0 if expected else 1.0) * Gait().single)
    assert walker.gait.double == pytest.approx(0.5 * walker.gait.single if expected else Gait().double)
    assert [why for why in walker.why if why.startswith("steps take 0.60 s, not 0.75, 0.20 s of it on both feet")] == [
        why for why in walker.why if why not in slow.why
    ]
    assert len(walker.why) - len(slow.why) == bool(expected)


@pytest.mark.slow
@pytest.mark.parametrize("weaker", [0.3, 0.35])
def test_a_weak_ankle_walks(weaker: float) -> None:
    """G1's ankles with a third of their torque: over the middle of the sole it fell within 4 s, 10 % heavier."""
    course_of = pytest.importorskip("hqp.walking.course").Course
    robot = hqp.robots.load("g1", rotors=True)
    robot.effort_limit[np.concatenate([ankle(robot, foot) for foot in feet_of(robot)])] *= weaker

    walker = Walker(robot, deadline=math.inf)
    course = course_of(walker, edit=scaled(1.1))
    walker.go(0.2)
    start = course.plant.com()[0]
    while walker.time < 6.0:
        course.step()
        assert not course.fallen
    assert course.plant.com()[0] - start > 0.7
