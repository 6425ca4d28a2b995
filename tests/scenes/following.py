"""Robots in MuJoCo behind a delay and noise, with pushes and contacts; and sensors and joints that fail."""

from __future__ import annotations

import math
from collections import deque
from dataclasses import dataclass, field
from functools import cache
from typing import Any

import numpy as np

import hqp
from hqp import PD, Braking, Level, P, Stack, Status
from hqp.arrays import Index, Vec
from hqp.robots import Robot
from hqp.robots.on_mujoco import Plane, Plant, Servo
from hqp.robots.soles import sole as corners
from hqp.tasks import CenterOfPressure, Com, FixedContact, FrictionCone, JointLimits, Position, Posture, TorqueLimits
from hqp.tasks.polygons import shrunk

DT = 0.002
MAX_AGE = 0.02
HANDS = {"ur5": "tool0", "ur10": "tool0", "panda": "panda_hand_tcp"}
SERVO = Servo(other=4000.0, damping_time=0.05)


@cache
def load(name: str) -> Robot:
    """The robot, with its rotors."""
    return hqp.robots.load(name, rotors=True)


@dataclass
class Fault:
    """Fault from ``at`` [s] on: "frozen", "blocked", "exchanged"; joints: indices of motors."""

    kind: str
    joints: tuple[int, ...] = ()
    at: float = 0.3


@dataclass
class Loop:
    """A hand on its way to a drawn target: measured ``late`` ticks late with noise [rad/s], pushed [N] for 50 ms
    repeatedly, with a wall in its way, or with a fault; exact: integrated, without MuJoCo."""

    name: str
    level: str
    seed: int
    late: int = 0
    noise: float = 0.0
    push: float = 0.0
    wall: bool = False
    fault: Fault | None = None
    ticks: int = 500
    statuses: list[Status] = field(default_factory=list)
    notes: list[str] = field(default_factory=list)
    commands: list[Vec] = field(default_factory=list)
    braking: Braking = field(default_factory=Braking)
    exact: bool = False

    def __post_init__(self) -> None:
        self.robot = robot = load(self.name)
        self.twin = robot.copy()
        self.draw = np.random.default_rng(self.seed)
        frame = HANDS.get(self.name) or robot.landmarks["palms"][-1]
        self.hand = Position(frame=frame, name="hand", law=P(5.0) if self.level == "velocity" else PD(60.0, 15.0))
        feet = robot.landmarks["soles"] if robot.floating else ()
        guards = [JointLimits()] + ([TorqueLimits()] if self.level == "torque" else [])
        held: list[Any] = [FixedContact(frame=sole, name=sole) for sole in feet]
        if feet and self.level == "torque":
            held += [FrictionCone(contact=sole, mu=0.6) for sole in feet]
            held += [CenterOfPressure(contact=sole, polygon=shrunk(corners(robot, sole), 0.01)) for sole in feet]
        first = [Level(Com(law=P(5.0) if self.level == "velocity" else PD(60.0, 15.0)))] if feet else []
        stack = Stack(*first, Level(self.hand), Level(Posture()), subject_to=[*held, *guards])
        torque = hqp.Torque(contact_law=PD(0.0, 20.0)) if feet else hqp.Torque()
        formulation = {"velocity": hqp.Velocity(), "acceleration": hqp.Acceleration(), "torque": torque}[self.level]
        controller = hqp.Controller(stack, formulation, deadline=math.inf, braking=self.braking)
        self.session = controller.session(robot, DT, max_age=MAX_AGE, stuck=False)
        start = robot.state(robot.home).position(frame)
        self.goal = start + self.draw.uniform(-0.25, 0.25, 3)

        def edit(spec: Any) -> None:
            import mujoco

            if self.wall:  # in the way of the hand
                way = self.goal - start
                z = way / np.linalg.norm(way)
                box = spec.worldbody.add_geom(name="wall", pos=start + 0.06 * z + 0.3 * way, size=[0.3, 0.3, 0.02])
                box.type, box.quat = mujoco.mjtGeom.mjGEOM_BOX, turn_to(z)  # pyright: ignore

        servo: dict[str, Any] = {"actuation": "position", "servo": SERVO} if self.level == "velocity" else {}
        self.plant = Plant(robot, timestep=DT / 2, edit=edit, terrain=Plane() if feet else None, **servo)
        self.motors = robot.actuated
        self.places = self.motors + (robot.nq - robot.nv)
        self.q, self.v = self.plant.reset(robot.home.copy())
        self._sent = self.q[self.places].copy()
        self._measured: deque[tuple[float, Vec, Vec]] = deque(maxlen=self.late + 1)
        self._frozen: tuple[Vec, Vec] | None = None
        self._locked: dict[int, Any] = {}

    def run(self) -> Loop:
        """Run all ticks."""
        while len(self.statuses) < self.ticks:
            self.step()
        return self

    def step(self) -> None:
        """Run one tick."""
        k, q, v = len(self.statuses), self.q, self.v
        now, fault = k * DT, self.fault or Fault("none", at=math.inf)
        at, speed = q.copy(), v.copy()
        at[self.places] += 0.02 * self.noise * self.draw.normal(size=self.motors.size)
        speed[self.motors] += self.noise * self.draw.normal(size=self.motors.size)
        self._measured.append((now, at, speed))
        told, at, speed = self._measured[0]
        if now >= fault.at and fault.kind == "frozen":
            self._frozen = self._frozen or (at, speed)
            at, speed = self._frozen
        if now >= fault.at and fault.kind == "exchanged":
            at, speed = exchanged(at, self.places, fault.joints), exchanged(speed, self.motors, fault.joints)
        tick = self.session.step(self.robot.state(at, speed, time=told), self.hand.at(self.goal), now=now)
        self.statuses.append(tick.status)
        self.notes += [note.detail for note in tick.notes if note.element == "joints"]
        self.commands.append(tick.command)
        if self.push and k % 150 < 25:  # 50 ms in another direction each time
            self.plant.push(self.hand.frame, self.push * np.array([math.cos(k // 150), math.sin(k // 150), 0.3]))
        if self.exact:
            self.q, self.v = tick.advance()
            return
        if self.level == "velocity":
            self._sent = self._sent + DT * tick.command
            self.plant.step(self._sent, tick.command, steps=2)
        elif self.level == "acceleration":
            true = self.twin.state(q, v)
            self.plant.step((true.mass_matrix() @ tick.x + true.bias_force())[self.motors], steps=2)
        else:
            self.plant.step(tick.command, steps=2)
        self.q, self.v = self.plant.state()
        if now >= fault.at and fault.kind == "blocked":  # a brake locks the joint in place
            for i in fault.joints:
                self.q[self.places[i]] = self._locked.setdefault(i, q[self.places[i]])
                self.v[self.motors[i]] = 0.0
            self.plant.data.qpos[:], self.plant.data.qvel[:] = self.plant.map.to_mujoco(self.q, self.v)

    def place(self) -> Vec:
        """Place of the hand in the plant [m]."""
        if self.exact:
            return self.twin.state(self.q).position(self.hand.frame).copy()
        return self.plant.place(self.hand.frame)[0].copy()

    @property
    def caught(self) -> float:
        """Time from the fault to NOT_FOLLOWING [s], inf for never."""
        first = next((k for k, s in enumerate(self.statuses) if s is Status.NOT_FOLLOWING), None)
        return math.inf if first is None else first * DT - (0.0 if self.fault is None else self.fault.at)


def exchanged(numbers: Vec, places: Index, joints: tuple[int, ...]) -> Vec:
    """The numbers with those of two joints exchanged."""
    found, (i, j) = numbers.copy(), places[list(joints)]
    found[[i, j]] = numbers[[j, i]]
    return found


def turn_to(z: Vec) -> Vec:
    """The quaternion that turns the z axis there."""
    turn = np.array([1.0 + z[2], -z[1], z[0], 0.0])
    return np.asarray(turn / np.linalg.norm(turn))
