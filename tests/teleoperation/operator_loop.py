"""A robot in closed loop that follows an operator through disturbed packets."""

from __future__ import annotations

from collections.abc import Callable, Iterator
from dataclasses import dataclass, field
from typing import Any, TypeAlias

import numpy as np

import hqp
from hqp import PD, Level, P, Stack
from hqp.arrays import Mat, Vec
from hqp.tasks import CenterOfPressure, Com, FixedContact, FrictionCone, JointLimits, Pose, Posture

DT = 0.002
HOLD = 0.2
"""Initial rest of the operator [s]."""

Spoil: TypeAlias = "Callable[[float, Mat], Iterator[dict[str, Any]]]"
"""Disturbance of a packet: from its time and pose to keywords of ``Follow.receive``, ``value`` among them."""


def plain(t: float, pose: Mat) -> Iterator[dict[str, Any]]:
    """Forward a packet unchanged."""
    yield {"value": pose, "sent": t}


@dataclass
class Done:
    """By tick: distance of hand and of reference from the operator ``(n,)`` [m], commands ``(n, k)``, notes."""

    time: Vec
    off: Vec
    turned: Vec
    commands: Mat
    statuses: set[str]
    notes: dict[str, float] = field(default_factory=dict)
    drift: float = 0.0

    @property
    def jump(self) -> float:
        """Largest change of the command in a tick."""
        return float(np.abs(np.diff(self.commands, axis=0)).max())

    def worst(self, begin: float, end: float = np.inf) -> float:
        """Largest distance between two times [m]."""
        return float(self.off[(self.time >= begin) & (self.time <= end)].max())


def setup(name: str, torque: bool = False) -> tuple[Any, Pose, Stack, Vec]:
    """Robot, hand, stack, start."""
    robot = hqp.robots.load(name)
    law = PD(200.0) if torque else P(8.0)
    if name == "ur5":
        hand = Pose(frame="tool0", law=law, name="hand")
        start = robot.integrate(robot.home, np.array([0.3, -1.4, 1.5, -1.2, -1.3, 0.2]), 1.0)
        return robot, hand, Stack(Level(hand), Level(Posture()), subject_to=[JointLimits()]), start
    frame = {"g1": "right_rubber_hand", "talos": "gripper_right_base_link"}[name]
    soles = robot.landmarks["soles"]
    feet: list[Any] = [FixedContact(frame=sole) for sole in soles]
    if torque:
        feet += [FrictionCone(contact=sole, mu=0.7) for sole in soles]
        feet += [CenterOfPressure(contact=sole, rectangle=(-0.08, 0.08, -0.03, 0.03)) for sole in soles]
    hand = Pose(frame=frame, law=law, name="hand")
    stack = Stack(Level(Com(axes="xy")), Level(hand), Level(Posture()), subject_to=[*feet, JointLimits()])
    bent = np.zeros(robot.nv)
    if name == "g1":
        bent[robot.joints(["left_elbow_joint", "right_elbow_joint"])] = 0.5
    return robot, hand, stack, robot.integrate(robot.home, bent, 1.0)


def swing(home: Mat, t: float) -> Mat:
    """The operator's pose: on a circle of 7 cm, once in 2 s, with rotation, eased in within 1 s."""
    angle = np.pi * max(t - HOLD, 0.0)
    u = min(max(t - HOLD, 0.0), 1.0)
    ease = u**3 * (10.0 - 15.0 * u + 6.0 * u * u)
    pose = home.copy()
    pose[:3, 3] += ease * 0.05 * np.array([1.0 - np.cos(angle), np.sin(angle), np.sin(angle)])
    c, s = np.cos(0.3 * ease * np.sin(angle)), np.sin(0.3 * ease * np.sin(angle))
    pose[:3, :3] = np.array([[c, -s, 0.0], [s, c, 0.0], [0.0, 0.0, 1.0]]) @ home[:3, :3]
    return pose


def run(
    robot: Any,
    hand: Pose,
    stack: Stack,
    start: Vec,
    spoil: Spoil = plain,
    *,
    follow: hqp.Follow | None = None,
    torque: bool = False,
    rate: float = 72.0,
    delay: float = 0.0,
    seconds: float = 2.4,
    dt: float = DT,
    motion: Callable[[Mat, float], Mat] = swing,
) -> Done:
    """Follow for some seconds; packets arrive ``delay`` [s] after they were sent."""
    controller = hqp.Controller(stack, hqp.Torque() if torque else hqp.Velocity(), deadline=np.inf)
    session = controller.session(robot, dt)
    follow = hqp.Follow(hand) if follow is None else follow
    q, v = start.copy(), np.zeros(robot.nv)
    state = robot.state(q, v)
    home = hand.value(state)
    soles = [e for e in stack.subject_to if isinstance(e, FixedContact)]
    places = [e.value(state) for e in soles]
    n, sent = round(seconds / dt), 0
    off, turned, commands = np.zeros(n), np.zeros(n), np.zeros((n, len(robot.joint_names)))
    statuses, notes, drift = set(), {}, 0.0
    for k in range(n):
        t = k * dt
        while sent / rate + delay <= t:
            for packet in spoil(sent / rate, motion(home, sent / rate)):
                follow.receive(packet.pop("value"), received=sent / rate + delay, **packet)
            sent += 1
        state = robot.state(q, v)
        tick = session.step(state, follow.reference(state, now=t))
        error = hand.error(state, motion(home, t))
        off[k], turned[k] = np.linalg.norm(error[:3]), np.linalg.norm(error[3:])
        drift = max(drift, *(float(np.abs(e.error(state, p)).max()) for e, p in zip(soles, places, strict=True)), 0.0)
        commands[k] = tick.command
        statuses.add(tick.status.name)
        for note in tick.notes:
            notes.setdefault(note.detail, t)
        q, v = tick.advance()
    return Done(np.arange(n) * dt, off, turned, commands, statuses, notes, drift)
