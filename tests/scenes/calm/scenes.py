"""Scenes of closed loops: the default stack and the targets of its hand."""

from __future__ import annotations

import math
from collections.abc import Callable, Mapping
from dataclasses import dataclass
from functools import cache, partial
from typing import Any

import numpy as np

import hqp
from hqp import PD, Level, P, Stack
from hqp.arrays import Mat, Vec
from hqp.declare.element import Element, Inequality
from hqp.declare.law import Law
from hqp.declare.reference import Reference
from hqp.declare.robot import Robot, State
from hqp.programs.formulation import Formulation
from hqp.tasks import Com, JointLimits, Orientation, Position, Posture, TorqueLimits
from tests.scenes.calm.robots import Subject, subject

DT = 0.002
"""Period [s]."""

SPEED = 0.4
"""Fastest approach of the laws [m/s, rad/s]."""

RADIUS, RATE = 0.1, 3.0
"""Circles of the targets [m, rad/s]."""

FORMULATIONS: Mapping[str, Formulation] = {
    "velocity": hqp.Velocity(),
    "acceleration": hqp.Acceleration(),
    "torque": hqp.Torque(),
}

Targets = Callable[[float], tuple[Reference, ...]]
"""References at a time [s]."""


@dataclass(frozen=True, kw_only=True)
class _Wall(Inequality):
    """Keep the origin of a frame on one side of a plane: n . p <= offset, one row [m]."""

    frame: str
    normal: tuple[float, float, float]
    offset: float

    def rows(self, robot: Robot) -> int:
        """1."""
        return 1

    def jacobian(self, state: State) -> Mat:
        """n' J_v ``(1, nv)``."""
        return (np.array(self.normal) @ state.jacobian(self.frame)[:3])[None]

    def bounds(self, state: State) -> tuple[float, float]:
        """Distance from the plane."""
        return -math.inf, self.offset - float(np.array(self.normal) @ state.position(self.frame))

    def drift(self, state: State) -> Vec:
        """n' dJ_v/dt v ``(1,)``."""
        return np.array([np.array(self.normal) @ state.drift(self.frame)[:3]])


@dataclass(frozen=True)
class Scene:
    """A stack on a robot and the references of its hands over time.

    tracked: the task with the reported error, its reference the first.  above: elements of levels above it.  within:
    true if it can be reached.  dt: period [s].
    """

    name: str
    subject: Subject
    formulation: str
    stack: Stack
    targets: Targets
    tracked: str = "hand"
    above: tuple[str, ...] = ()
    within: bool = False
    dt: float = DT


def law(formulation: str, gain: float) -> Law:
    """P(gain) or a critically damped PD of the same bandwidth, both with the scenes' top speed."""
    if formulation == "velocity":
        return P(gain, max_velocity=SPEED)
    return PD(gain * gain, 2.0 * gain, max_velocity=SPEED)


def default_stack(who: Subject, formulation: str, limits: Mapping[str, Any], *middle: Level) -> Stack:
    """CoM over the ground > ``middle``, hand by default > base > posture, s.t. contacts and limits."""
    of = partial(law, formulation)
    levels = []
    if who.contacts:
        levels.append(Level(Com(axes="xy", law=of(5.0), name="com"), name="balance"))
    levels += middle or (Level(Position(frame=who.hands[0], law=of(5.0), name="hand"), name="hand"),)
    if who.base is not None:
        levels.append(Level(Orientation(frame=who.base, law=of(2.0), name="base"), name="base"))
    levels.append(Level(Posture(law=of(1.0)), name="posture"))
    hard: list[Element] = [*who.contacts, JointLimits(**limits)]
    if formulation == "torque":
        hard.append(TorqueLimits())
    return Stack(*levels, subject_to=hard)


@cache
def reach(name: str, hand: int = 0) -> float:
    """Reach of a hand ahead of its start in this stack [m], measured in a run with weighted sums."""
    who = subject(name)
    stack = default_stack(
        who, "velocity", {}, Level(Position(frame=who.hands[hand], law=P(5.0, max_velocity=1.0), name="hand"))
    )
    session = hqp.Controller(stack, solver="weighted").session(who.robot, DT)
    q, v = who.robot.home.copy(), np.zeros(who.robot.nv)
    start = who.robot.state(q).position(who.hands[hand])
    goal = stack.find("hand", Position).at(start + 3.0 * who.ahead)
    for _ in range(2500):
        q, v = session.step(who.robot.state(q, v), goal).advance()
    return float(who.ahead @ (who.robot.state(q).position(who.hands[hand]) - start))


def still(task: Position, place: Vec) -> Targets:
    """A step at t = 0 to a fixed place."""
    goal = (task.at(place),)
    return lambda t: goal


def circle(task: Position, centre: Vec) -> Targets:
    """A circle around a place, vertical and across the reaching direction, with its velocity and acceleration."""
    y, z = np.array((0.0, RADIUS, 0.0)), np.array((0.0, 0.0, RADIUS))

    def at(t: float) -> tuple[Reference, ...]:
        c, s = math.cos(RATE * t), math.sin(RATE * t)
        out = c * y + s * z
        return (task.at(centre + out, velocity=RATE * (c * z - s * y), acceleration=-RATE * RATE * out),)

    return at


def both(*goals: Targets) -> Targets:
    """References of several targets."""
    return lambda t: tuple(reference for goal in goals for reference in goal(t))


PLACES = {"within": 0.5, "edge": 1.0}
"""Share of the reach; ``beyond`` is one metre more than the reach."""


def scenes(name: str, formulation: str, limits: Mapping[str, Any]) -> dict[str, Callable[[], Scene]]:
    """Makers of the scenes of one robot by name; ``limits`` are given to JointLimits."""
    who = subject(name)
    task = Position(frame=who.hands[0], law=law(formulation, 5.0), name="hand")
    above = (*(c.name for c in who.contacts), *(("com",) if who.contacts else ()))

    def start(hand: int = 0) -> Vec:
        return who.robot.state(who.robot.home).position(who.hands[hand])

    def place(kind: str) -> Vec:
        far = reach(name)
        return start() + (far * PLACES[kind] if kind in PLACES else far + 1.0) * who.ahead

    def single(kind: str, path: Callable[[Position, Vec], Targets], label: str) -> Scene:
        stack = default_stack(who, formulation, limits)
        return Scene(label, who, formulation, stack, path(task, place(kind)), above=above, within=kind == "within")

    def hands() -> Scene:
        other = Position(frame=who.hands[1], law=task.law, name="other hand")
        stack = default_stack(who, formulation, limits, Level(task, other, name="hands"))
        goals = both(still(task, place("beyond")), still(other, start(1) + (reach(name, 1) + 1.0) * who.ahead))
        return Scene("both hands", who, formulation, stack, goals, above=above)

    def contradictory() -> Scene:
        other = Position(frame=who.hands[0], law=task.law, name="elsewhere")
        stack = default_stack(who, formulation, limits, Level(task, name="hand"), Level(other, name="elsewhere"))
        aside = start() + 0.5 * np.cross((0.0, 0.0, 1.0), who.ahead)
        return Scene(
            "contradictory", who, formulation, stack, both(still(task, place("within")), still(other, aside)),
            above=(*above, "hand"), within=True,
        )  # fmt: skip

    def wall() -> Scene:
        there = start() + 0.3 * reach(name) * who.ahead
        plane = _Wall(
            name="wall", frame=who.hands[0], normal=tuple(who.ahead.tolist()), offset=float(who.ahead @ there)
        )
        stack = default_stack(who, formulation, limits)
        stack = Stack(*stack.levels, subject_to=[*stack.subject_to, plane])
        goals = still(task, there + 0.2 * who.ahead)
        return Scene("wall", who, formulation, stack, goals, above=(*above, "wall"), within=True)

    found: dict[str, Callable[[], Scene]] = {}
    for kind in (*PLACES, "beyond"):
        found[kind] = partial(single, kind, still, kind)
        found[f"circle {kind}"] = partial(single, kind, circle, f"circle {kind}")
    if len(who.hands) > 1:
        found["both hands"] = hands
    found["wall"], found["contradictory"] = wall, contradictory
    if name == "talos":
        found["knee"] = partial(knee, formulation, limits)
    return found


def knee(formulation: str, limits: Mapping[str, Any]) -> Scene:
    """Talos, a reachable hand and a posture of its arm below: the base gains little if the other arm swings."""
    who = subject("talos")
    task = Position(frame=who.hands[0], law=law(formulation, 5.0), name="hand")
    arm = [joint for joint in who.robot.groups["arms"] if "right" in joint]
    stack = default_stack(
        who, formulation, {**limits, "margin": 0.1}, Level(task, name="hand"),
        Level(Posture(joints=arm, law=law(formulation, 1.0), name="arm"), name="arm"),
    )  # fmt: skip
    start = who.robot.state(who.robot.home).position(who.hands[0])
    above = (*(c.name for c in who.contacts), "com")
    return Scene("knee", who, formulation, stack, still(task, start + (0.06, -0.05, 0.06)), above=above, within=True)
