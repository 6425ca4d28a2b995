"""CBi and Panda in MuJoCo: a hand moves from below a table's edge to a place above the top without contact."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any

import numpy as np

import hqp
from hqp import Level, P, Stack, shapes
from hqp.arrays import Vec
from hqp.tasks import CollisionAvoidance, Position
from tests.scenes.calm.robots import subject
from tests.scenes.calm.scenes import DT, default_stack

EDGE, THICK, TOP = 0.12, 0.04, 0.25
"""Distance of the table's edge ahead of the hand's start, thickness of the top, height of goal above start [m]."""
CLEARANCE = 0.02
TOUCHES_TABLE = 4
"""Bit of MuJoCo's contact masks."""
AHEAD = {"cbi": 0.2, "panda": 0.22}
"""Distance of the goal ahead of the start [m]."""


@dataclass(frozen=True)
class Around:
    """error: distance of the hand at the end [m].  touched: pairs of geoms in contact on the way, without the ground's.

    nearest: the least distance of a geom of the robot to the table [m].  com: largest error of the CoM [m].
    """

    error: float
    touched: frozenset[tuple[str, str]]
    nearest: float
    com: float


def around(name: str, *, avoid: bool = True, seconds: float = 5.0) -> Around:
    """Integrate commands and send them to stiff servos; evaluate rows at the measured state."""
    import mujoco

    from hqp.robots.on_mujoco import Plane, Plant, Servo

    who = subject(name)
    robot = who.robot
    start = robot.state(robot.home).position(who.hands[0])
    goal = start + AHEAD[name] * who.ahead + [0.0, 0.0, TOP]
    middle = start + (EDGE + 0.2) * who.ahead + [0.0, 0.0, 0.5 * TOP]
    table = shapes.box("table", (0.4, 0.8, THICK), tuple(middle.tolist()))
    hand = Position(frame=who.hands[0], law=P(2.0, max_velocity=0.25), name="hand")
    stack = default_stack(who, "velocity", {}, Level(hand, name="hand"))
    if avoid:
        around = CollisionAvoidance(world=table, clearance=CLEARANCE)
        stack = Stack(*stack.levels, subject_to=[*stack.subject_to, around])

    def edit(spec: Any) -> None:
        for geom in spec.geoms:
            geom.conaffinity |= TOUCHES_TABLE  # most links of the project's models are visual only
        spec.worldbody.add_geom(
            name="table",
            contype=1 | TOUCHES_TABLE,
            type=mujoco.mjtGeom.mjGEOM_BOX,
            pos=middle,
            size=[0.2, 0.4, 0.5 * THICK],
        )

    servo = Servo(other=2000.0, damping_time=0.05) if name == "panda" else None
    plant = Plant(robot, actuation="position", servo=servo, terrain=Plane(friction=0.8), edit=edit)
    session = hqp.Controller(stack, hqp.Velocity(), deadline=np.inf).session(robot, DT)
    home = robot.home.copy()
    if name == "panda":
        home[robot.positions(robot.joints(["panda_finger_joint1", "panda_finger_joint2"]))] = 0.02  # else they touch
    q, v = plant.reset(home)
    places = robot.positions(robot.actuated)
    assert places is not None  # neither has a continuous joint
    command, centre = q[places].copy(), plant.com()[:2].copy()
    touched: set[tuple[str, str]] = set()
    nearest, off = np.inf, 0.0
    at = plant.model.geom("table").id
    others = [g for g in range(plant.model.ngeom) if _solid(plant.model, g) and g != at]
    for i in range(round(seconds / DT)):
        tick = session.step(robot.state(q, v), hand.at(goal))
        command = command + DT * tick.command
        plant.step(command, rate=tick.command, steps=round(DT / plant.timestep))
        q, v = plant.state()
        touched |= _touching(plant.model, plant.data)
        if i % 5 == 0:
            nearest = min(nearest, min(_distance(plant, g, at) for g in others))
        off = max(off, float(np.linalg.norm(plant.com()[:2] - centre)))
    error = float(np.linalg.norm(robot.state(q).position(who.hands[0]) - goal))
    return Around(error, frozenset(touched), nearest, off if who.feet else 0.0)


def _solid(model: Any, geom: int) -> bool:
    """Return true if a geom of a moving body can collide."""
    return (
        bool(model.geom_contype[geom] or model.geom_conaffinity[geom])
        and int(model.body_weldid[model.geom_bodyid[geom]]) > 0
    )


def _distance(plant: Any, one: int, two: int) -> float:
    import mujoco

    return float(mujoco.mj_geomDistance(plant.model, plant.data, one, two, 1.0, None))


def _touching(model: Any, data: Any) -> set[tuple[str, str]]:
    """Names of geoms, or of their bodies, in contact; contacts with the ground are ignored."""
    found = set()
    for contact in data.contact:
        pair: list[Vec | str] = []
        for geom in contact.geom:
            pair.append(model.geom(geom).name or model.body(model.geom_bodyid[geom]).name)
        if contact.dist < 0.0 and "ground" not in pair:
            found.add((str(pair[0]), str(pair[1])))
    return found
