"""Pairs of capsules that overlap at home: a warning names them, and a row keeps them as far apart as there."""

from __future__ import annotations

import itertools
import re
import warnings
from typing import Any

import coal
import numpy as np
import pinocchio as pin
import pytest

import hqp
from hqp import Level, P, Stack
from hqp.collision_library import convex_hull, solid
from hqp.errors import ModelWarning
from hqp.robots.surface import surface
from hqp.shapes import LinkCapsule
from hqp.tasks import CollisionAvoidance, JointLimits, Posture, PrescribedMotion


def rails(rng: Any) -> tuple[Any, list[tuple[str, str, float]]]:
    """Balls on slides of one base, at drawn places; the pairs that overlap at home, with their depth [mm]."""
    model, capsules, places = pin.Model(), [], rng.uniform(-0.15, 0.15, (5, 3))
    for k, place in enumerate(places):
        joint = model.addJoint(0, pin.JointModelPX(), pin.SE3(np.eye(3), place), f"slide{k}")
        model.appendBodyToJoint(joint, pin.Inertia(1.0, np.zeros(3), np.eye(3)), pin.SE3.Identity())
        model.addFrame(pin.Frame(f"ball{k}", joint, 0, pin.SE3.Identity(), pin.FrameType.BODY))
        capsules.append(LinkCapsule(f"ball{k}", joint, (0.0,) * 3, (0.0,) * 3, 0.06))
    gaps = {(i, j): float(np.linalg.norm(places[i] - places[j])) - 0.12 for i in range(5) for j in range(i)}
    apart = [(f"ball{j}", f"ball{i}", -1e3 * gap) for (i, j), gap in gaps.items() if gap <= 0.0]
    return hqp.robots.Robot(model, name="rails").with_capsules(capsules), apart


@pytest.mark.parametrize("seed", range(6))
def test_pairs_that_overlap_at_home_are_named(seed: int) -> None:
    robot, overlapping = rails(np.random.default_rng(seed))
    names = [f"ball{k}" for k in range(5)]
    avoid = CollisionAvoidance(pairs=tuple((a, b) for i, a in enumerate(names) for b in names[i + 1 :]))
    with warnings.catch_warnings(record=True) as told:
        warnings.simplefilter("always")
        session = hqp.Controller(Stack(Level(Posture(law=P(1.0))), subject_to=[avoid])).session(robot, 0.01)
    texts = [
        str(w.message) for w in told if issubclass(w.category, ModelWarning) and "overlap at home" in str(w.message)
    ]
    assert bool(texts) == bool(overlapping)
    for one, two, depth in overlapping:
        assert all(f"{one} - {two} ({depth:.1f} mm)" in text for text in texts)
    if texts:
        assert texts[0].count(" - ") == len(overlapping)
        depths = [float(found) for found in re.findall(r"\((\S+) mm\)", texts[0])]
        assert depths == sorted(depths, reverse=True)
    assert [n.detail for n in session.step(robot.state()).notes if n.element == "collision"] == texts
    assert not [n for n in session.step(robot.state()).notes if n.element == "collision"]


@pytest.mark.long
def test_capsules_that_overlap_at_home_keep_shapes_apart() -> None:
    """G1's upper arm is sent to drawn postures inside the trunk; judge the hulls of the shapes by coal."""
    robot = hqp.robots.load("g1")
    links = ("torso_link", "left_shoulder_yaw_link")
    joints = robot.joints(tuple(f"left_shoulder_{axis}_joint" for axis in ("pitch", "roll", "yaw")))
    body = [robot.body(robot.frame(link)) for link in links]
    data, shapes = robot.model.createData(), robot.geometry.geometryObjects
    hulls = [
        [solid(convex_hull(surface(item).triangles.reshape(-1, 3))) for item in shapes if item.parentJoint == b]
        for b in body
    ]

    def distance(q: Any) -> float:
        pin.forwardKinematics(robot.model, data, q)
        places = [coal.Transform3s(data.oMi[b].rotation, data.oMi[b].translation) for b in body]
        ask = coal.DistanceRequest(), coal.DistanceResult()
        return min(float(coal.distance(a, places[0], b, places[1], *ask)) for a, b in itertools.product(*hulls))

    posture, deepest = Posture(law=P(3.0)), {}
    for rows in (True, False):
        subject_to = [JointLimits(), *([CollisionAvoidance(pairs=(links,))] if rows else [])]
        stack = Stack(Level(posture, price=0), subject_to=[PrescribedMotion(name="base"), *subject_to])
        rng, least = np.random.default_rng(0), []
        for _ in range(12):
            angles = robot.state(robot.home).angles.copy()
            while distance(robot.configuration(angles)) > -0.01:
                angles[joints] = rng.uniform(robot.lower[joints], robot.upper[joints])
            q, v = robot.home.copy(), np.zeros(robot.nv)
            with warnings.catch_warnings():
                warnings.simplefilter("ignore")
                session = hqp.Controller(stack, deadline=np.inf).session(robot, 0.02, stuck=False)
            for _ in range(100):
                q, v = session.step(robot.state(q, v), posture.at(angles[robot.actuated])).advance()
                least.append(distance(q))
        deepest[rows] = -min(least)
    assert deepest[False] > 0.04
    assert deepest[True] < 0.0
