"""The centre of mass over the measured soles: drawn stances, lifted feet, and a robot that would tip in MuJoCo."""

from __future__ import annotations

import math
from typing import Any

import numpy as np
import pinocchio as pin
import pytest
from scipy.spatial import ConvexHull

from hqp import UpperBody
from hqp.errors import DeclarationError
from hqp.policies.upper_body import polygon
from hqp.robots import Robot
from hqp.robots.soles import sole
from tests.tasks.test_prescribed import legs_of, load

DT = 0.01


def stance(robot: Robot, rng: Any) -> Any:
    """A drawn step and width with level soles, drawn place and heading."""
    angles = np.array(robot.state(robot.home).angles)
    step, width = rng.uniform(0.1, 0.3) * rng.choice((-1.0, 1.0)), rng.uniform(0.0, 0.12)
    for side, sign in (("left", 1.0), ("right", -1.0)):
        for joint, by in (("hip_pitch", step), ("ankle_pitch", -step), ("hip_roll", width), ("ankle_roll", -width)):
            angles[robot.joints(f"{side}_{joint}_joint")] += sign * by
    q = robot.configuration(angles)
    yaw = rng.uniform(-math.pi, math.pi)
    q[:7] = *rng.uniform(-3.0, 3.0, 2), robot.home[2], 0.0, 0.0, math.sin(0.5 * yaw), math.cos(0.5 * yaw)
    return q


def inside(robot: Robot, q: Any, feet: list[str]) -> tuple[float, Any]:
    """Distance of the centre of mass from the nearest edge of the hull of the feet, positive inside [m], and the edge's
    outward normal, by Pinocchio."""
    data = robot.model.createData()
    centre = pin.centerOfMass(robot.model, data, q)[:2]
    pin.updateFramePlacements(robot.model, data)
    corners = [data.oMf[robot.frame(f)].act(np.array([*p, 0.0]))[:2] for f in feet for p in sole(robot, f)]
    hull = ConvexHull(corners)
    over = hull.equations[:, :2] @ centre + hull.equations[:, 2]
    return float(-over.max()), hull.equations[over.argmax(), :2]


@pytest.mark.parametrize("seed", range(4))
def test_hands_pull_the_centre_of_mass_to_the_edge_of_the_measured_soles(seed: int) -> None:
    """Drawn stances, headings and pulls: it stays a margin inside the feet as they stand, and leaves them otherwise."""
    robot, rng = load("g1"), np.random.default_rng(seed)
    q0, feet = stance(robot, rng), list(robot.landmarks["soles"])
    room, outward = inside(robot, q0, feet)
    margin = room - 0.005
    assert margin > 0.01
    pull = 0.7 * np.append(outward, 0.0)
    least = {}
    for bound in (margin, None):
        declared = UpperBody(legs=legs_of(robot), output="velocities", reach=math.inf, margin=bound)
        arms = declared.session(robot, DT, deadline=math.inf)
        q, v = q0.copy(), np.zeros(robot.nv)
        goals = [np.array(hand.value(robot.state(q))) for hand in arms.hands]
        for goal in goals:
            goal[:3, 3] += pull
        found = []
        for _ in range(200):
            tick = arms.step(robot.state(q, v), *(h.at(goal) for h, goal in zip(arms.hands, goals, strict=True)))
            v[arms.columns] = tick.velocities
            q = robot.integrate(q, v, DT)
            found.append(inside(robot, q, feet)[0])
        least[bound] = min(found)
    assert least[margin] > margin - 1e-4
    assert least[None] < margin - 2e-3


def test_a_lifted_foot_is_no_support() -> None:
    """The arms bring the centre of mass towards the foot that stands; no foot, no bound; corners are Pinocchio's."""
    robot = load("g1")
    declared = UpperBody(legs=legs_of(robot), output="velocities", reach=math.inf, margin=0.0)
    left, right = robot.landmarks["soles"]
    aside = {}
    for standing in ((left,), (right,), (left, right), ()):
        arms = declared.session(robot, DT, deadline=math.inf)
        q, v = robot.home.copy(), np.zeros(robot.nv)
        start = pin.centerOfMass(robot.model, robot.model.createData(), q)[1]
        goals = [hand.at(hand.value(robot.state(q))) for hand in arms.hands]
        for _ in range(50):
            v[arms.columns] = arms.step(robot.state(q, v), *goals, standing=standing).velocities
            q = robot.integrate(q, v, DT)
        aside[standing] = pin.centerOfMass(robot.model, robot.model.createData(), q)[1] - start
    assert aside[(left,)] > 5e-3
    assert aside[(right,)] < -5e-3
    assert abs(aside[(left, right)]) < 1e-4
    assert abs(aside[()]) < 1e-4
    with pytest.raises(DeclarationError, match=f"left_hand.*{left}"):
        arms.step(robot.state(q), standing=["left_hand"])
    corners = polygon(robot.state(robot.home), declared.feet(robot), [right])
    assert len(corners) == sum(map(len, declared.feet(robot).values()))
    data = robot.model.createData()
    pin.framesForwardKinematics(robot.model, data, robot.home)
    expected = [data.oMf[robot.frame(right)].act(np.array([*p, 0.0]))[:2] for p in sole(robot, right)]
    np.testing.assert_allclose(corners[: len(expected)], expected, atol=1e-12)
    np.testing.assert_allclose(np.unique(corners.round(9), axis=0), np.unique(np.round(expected, 9), axis=0))


def reached(margin: float | None) -> tuple[float, float]:
    """Least distance of the centre of mass from the edge of the soles in MuJoCo [m], and the pelvis' height at the end.

    G1 stands on servos of its legs and waist; its hands, with 2 kg each, reach forward.  Both are MuJoCo's own.
    """
    from hqp.robots.on_mujoco import Plane, Plant

    robot, mass = load("g1"), 2.0
    held = [*legs_of(robot), *(name for name in robot.joint_names if "waist" in name)]

    def edit(spec: Any) -> None:
        for frame in robot.landmarks["palms"]:
            load = spec.body(frame).add_body()
            load.mass, load.inertia, load.explicitinertial = mass, [1e-3] * 3, True
        for name in held:
            spec.joint(name).frictionloss = 1e4  # nearly rigid

    plant = Plant(robot, terrain=Plane(friction=0.9), edit=edit)
    plant.reset(robot.home)
    gains = {"kp": 300.0, "kd": 10.0}
    declared = UpperBody(legs=held, reach=math.inf, margin=margin, speed=0.1, output="positions", **gains)  # type: ignore[arg-type]
    arms = declared.session(robot, DT, deadline=math.inf)
    own, soles = robot.actuated, [(f, np.array([[*p, 0.0] for p in sole(robot, f)])) for f in robot.landmarks["soles"]]
    stiff = np.isin(own, robot.joints(held))
    kp, kd = np.where(stiff, 1200.0, 300.0), np.where(stiff, 20.0, 10.0)
    target = np.array(robot.state(robot.home).angles)
    goals = [np.array(hand.value(robot.state(robot.home))) for hand in arms.hands]
    for goal in goals:
        goal[:3, 3] += (0.6, 0.0, 0.2)
    least = math.inf
    for k in range(400):
        state = robot.state(*plant.state())
        given = (hand.at(goal) for hand, goal in zip(arms.hands, goals, strict=True))
        target[arms.columns] = arms.step(state, *given, loads=[mass, mass]).positions
        for _ in range(10):
            q, v = plant.state()
            angles = robot.past(q, v).angles
            torque = kp * (target[own] - angles[own]) - kd * v[own]
            plant.step(np.clip(torque, -robot.effort_limit[own], robot.effort_limit[own]))
        if k > 100:
            places = [(plant.place(f), own_corners) for f, own_corners in soles]
            corners = np.concatenate([p + c @ R.T for (p, R), c in places])[:, :2]
            hull = ConvexHull(corners)
            least = min(least, -float((hull.equations[:, :2] @ plant.com()[:2] + hull.equations[:, 2]).max()))
    return least, float(plant.state()[0][2])


@pytest.mark.slow
def test_loaded_hands_reach_forward_in_physics() -> None:
    """In MuJoCo the centre of mass stays 2 cm inside for a margin of 4 cm, as the body rocks, and less without."""
    pytest.importorskip("mujoco")
    (near, high), (beyond, _) = reached(0.04), reached(None)
    assert high > 0.7
    assert near > 0.02
    assert beyond < 0.018
