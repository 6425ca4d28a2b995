"""Closed loops of stacks of every level on any robot, in a world that may be rotated and moved."""

from __future__ import annotations

import math
from collections.abc import Callable, Iterator, Mapping
from dataclasses import dataclass, field, replace
from functools import cache
from typing import Any

import numpy as np
import pinocchio as pin

import hqp
from hqp import PD, Level, P, Stack
from hqp.arrays import Mat, Vec
from hqp.declare.element import Element
from hqp.declare.law import Law
from hqp.robots import Robot
from hqp.tasks import (
    Com,
    FixedContact,
    FrictionCone,
    JointLimits,
    Orientation,
    PointContact,
    Position,
    Posture,
    TorqueLimits,
    UnilateralContact,
)

KINDS = ("velocity", "acceleration", "torque")
FORMULATIONS = {"velocity": hqp.Velocity, "acceleration": hqp.Acceleration, "torque": hqp.Torque}
REACHES = {"within": 0.05, "edge": 0.35, "beyond": 1.2}
"""Displacement of the tool [m], for an arm of about 0.6 m."""

load = cache(hqp.robots.load)


@dataclass(frozen=True)
class World:
    """A yaw about the vertical [rad], a shift [m] and a slope [rad] of everything: robot, targets, ground, gravity."""

    yaw: float = 0.0
    shift: tuple[float, float, float] = (0.0, 0.0, 0.0)
    slope: float = 0.0

    @property
    def placement(self) -> pin.SE3:
        return pin.SE3(pin.utils.rotate("x", self.slope) @ pin.utils.rotate("z", self.yaw), np.array(self.shift))

    @property
    def normal(self) -> Vec:
        """Normal of the ground."""
        return self.placement.rotation[:, 2].copy()


@dataclass(frozen=True, eq=False)
class Scene:
    """A robot that moves its tool and its CoM from its start.

    flat: frames of soles; points: frames of point feet.  reach: offset of the tool [m].  unit: model's lengths per
    metre.  tool_turn: rotation of the tool's frame in its link that the task undoes.  mirror: reflect targets in y = 0.
    com: axes of the CoM's task.  sway: size of a quick motion of the CoM, which takes feet to the edges of their
    friction cones at 1.  options: further arguments of the Controller.
    """

    robot: Robot
    tool: str
    kind: str = "velocity"
    flat: tuple[str, ...] = ()
    points: tuple[str, ...] = ()
    reach: float = 0.05
    price: float | None = None
    dt: float = 0.002
    ticks: int = 30
    world: World = field(default_factory=World)
    unit: float = 1.0
    mu: float = 0.6
    tool_turn: Mat = field(default_factory=lambda: np.eye(3))
    start: Vec | None = None
    mirror: bool = False
    com: str = "xy"
    sway: float = 0.0
    options: Mapping[str, Any] = field(default_factory=dict)
    rewritten: Callable[[hqp.Controller], hqp.Controller] = lambda controller: controller
    order: Callable[[list[Element]], list[Element]] = list

    def law(self, gain: float) -> Law:
        return P(gain) if self.kind == "velocity" else PD(gain * gain, 2.0 * gain)

    @property
    def floating(self) -> bool:
        return self.robot.floating

    def controller(self) -> hqp.Controller:
        feet: list[Element] = [FixedContact(frame=f) for f in self.flat] + [PointContact(frame=f) for f in self.points]
        held = [*feet, JointLimits()]
        if self.kind == "torque":
            held += [UnilateralContact(contact=foot.name) for foot in feet]
            held += [FrictionCone(contact=foot.name, mu=self.mu) for foot in feet]
            held.append(TorqueLimits())
        levels = [
            *([Level(Com(axes=self.com, law=self.law(2.0), name="com"))] if feet else []),
            Level(Position(frame=self.tool, law=self.law(4.0), name="tool")),
            Level(Orientation(frame=self.tool, law=self.law(3.0), name="turn")),
            Level(Posture(law=self.law(1.5), name="posture")),
        ]
        stack = Stack(*levels, subject_to=self.order(held))
        form = FORMULATIONS[self.kind]()
        made = hqp.Controller(stack, form, deadline=math.inf, price=self.price, **self.options)
        return self.rewritten(made)

    @property
    def first(self) -> Vec:
        """First configuration of the loop, in this world."""
        q = (self.robot.home if self.start is None else self.start).copy()
        if self.floating:
            q[:7] = pin.SE3ToXYZQUAT(self.world.placement * pin.XYZQUATToSE3(q[:7]))
        return q

    def references(self) -> Iterator[tuple[hqp.Reference, ...]]:
        """Targets of each tick: CoM and tool leave their start and come to rest after two thirds of the loop."""
        home = self.robot.copy().state(self.first)
        at, R = home.position(self.tool).copy(), home.rotation(self.tool) @ self.tool_turn.T
        com, turn = home.com()[: len(self.com)].copy(), self.world.placement.rotation if self.floating else np.eye(3)
        tool, turned, balance = (
            Position(frame=self.tool, name="tool"),
            Orientation(frame=self.tool, name="turn"),
            Com(axes=self.com, name="com"),
        )
        S = np.diag([1.0, -1.0 if self.mirror else 1.0, 1.0])
        for i in range(self.ticks):
            part = min(1.0, 1.5 * i / self.ticks)
            away = self.unit * self.reach * part * turn @ S @ np.array([1.0, 0.2, 0.1])
            bent = turn @ S @ pin.exp3(0.3 * part * np.array([0.2, 1.0, -0.4])) @ S @ turn.T @ R @ self.tool_turn
            sway = self.sway * np.array([0.03 * math.sin(25.0 * i * self.dt), 0.06 * math.sin(30.0 * i * self.dt), 0.0])
            moved = (self.unit * turn @ S @ (part * np.array([0.02, 0.01, 0.0]) + sway))[: len(self.com)]
            given: list[hqp.Reference] = [tool.at(at + away), turned.at(bent)]
            if self.flat or self.points:
                given.append(balance.at(com + moved))
            if self.kind == "torque" and self.world.slope:
                given += [FixedContact(frame=foot).at(normal=self.world.normal) for foot in self.flat]
            yield tuple(given)

    def run(self, *, state: Callable[[Vec, Vec], tuple[Vec, Vec]] = lambda q, v: (q, v)) -> Run:
        """Commands of a closed loop that executes every answer; state: measurement of (q, v) for the session."""
        session = self.controller().session(self.robot, self.dt)
        q, v = self.first, np.zeros(self.robot.nv)
        commands, statuses, speeds = [], [], []
        for references in self.references():
            tick = session.step(self.robot.state(*state(q, v)), *references)
            commands.append(np.array(tick.command))
            statuses.append(tick.status.name)
            q, v = tick.advance()
            speeds.append(v.copy())
        return Run(np.array(commands), tuple(statuses), np.array(speeds), q)

    def but(self, **changes: object) -> Scene:
        return replace(self, **changes)  # type: ignore[arg-type]


@dataclass(frozen=True, eq=False)
class Run:
    """By tick: command ``(ticks, n_actuated)``, status, velocity after it ``(ticks, nv)``; the last configuration."""

    commands: Mat
    statuses: tuple[str, ...]
    speeds: Mat
    last: Vec

    @property
    def largest(self) -> float:
        return float(np.abs(self.commands).max())


def off(a: Mat, b: Mat) -> float:
    """Largest difference of two loops' commands, relative to the largest command."""
    return float(np.abs(a - b).max() / max(float(np.abs(a).max()), 1e-9))


BIPEDS = ("talos", "g1", "cbi", "icub", "romeo")
ARMS = {"ur5": "tool0", "panda": "panda_hand_tcp"}


def catalogue(rng: np.random.Generator, kind: str, names: tuple[str, ...] = (*BIPEDS, *ARMS), **more: object) -> Scene:
    """A scene on a drawn robot of the catalogue, within reach, at its edge or beyond it."""
    name = str(rng.choice(names))
    robot = load(name)
    tool = ARMS.get(name) or robot.landmarks["palms"][int(rng.integers(2))]
    flat = tuple(robot.landmarks.get("soles", ()))
    reach = float(rng.choice(list(REACHES.values())))
    return Scene(robot=robot, tool=tool, kind=kind, flat=flat, reach=reach, **more)  # type: ignore[arg-type]
