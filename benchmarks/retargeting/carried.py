"""A planned clip in MuJoCo: the CoM's plan fed forward, landings where the measured DCM needs them, disturbances."""

from __future__ import annotations

import math
from dataclasses import dataclass
from typing import Any

import numpy as np

from benchmarks.retargeting.physics import ASTRAY, DT, SINK, Fate, Tracking
from hqp.declare.law import PD
from hqp.declare.stack import Level, Stack
from hqp.loop.controller import Controller
from hqp.motion.dynamics import Dynamics
from hqp.motion.rates import velocities
from hqp.motion.smoothing import filtered
from hqp.motion.targets import Targets
from hqp.tasks import Com
from hqp.torque.program import Torque
from hqp.walking.stacks import BOTH, FIRM, HASTE, Laws

REACH = 0.08
"""Largest change of a landing by the DCM [m]."""

SPARE = 0.4
"""Share of a sole's half sides within which the ankle alone corrects the DCM."""

SETTLED = 0.08
"""Time before a landing in which its place stays [s]."""

WEIGHS = 0.3
"""Time over which the robot weighs itself [s]."""


@dataclass(frozen=True)
class Disturbance:
    """heavier: share by which all masses grow.  push [m/s]: change of the base's velocity, heading [rad], at [s]."""

    heavier: float = 0.0
    push: float = 0.0
    heading: float = 0.0
    at: float = 0.0

    @staticmethod
    def drawn(seed: int, seconds: float) -> Disturbance:
        """Masses 10 % up or down, and a push of 0.1 m/s in the middle of the clip."""
        rng = np.random.default_rng(seed)
        return Disturbance(
            float(rng.choice([-0.1, 0.1])), 0.1, float(rng.uniform(0.0, 2.0 * math.pi)),
            float(rng.uniform(0.3, 0.7)) * seconds,
        )  # fmt: skip


class Carrying(Tracking):
    """The robot in MuJoCo and the plan that it follows.

    The CoM follows the plan's acceleration and, with the gains of the walker's DCM law, its place and velocity.  A foot
    in the air lands where the DCM's error at that time is made up for; from there the rest of the plan is moved along.
    The robot weighs itself on its soles: its mass over the model's scales its torques.
    """

    def __init__(self, robot: Any, targets: Targets, q: Any, plan: Dynamics, disturbance: Disturbance) -> None:
        self._disturbance = disturbance
        super().__init__(robot, targets, q)
        self.com, self.rate, self.push = plan.com, plan.velocity, plan.acceleration
        self.calm = filtered(robot, q, self.fps)
        self.calm_v, self.body = velocities(robot, self.calm, self.fps), robot.copy()
        k = Laws().balance.k
        law = PD(self.omega * k, self.omega + k)
        self.balance = Com(axes="xy", law=law, weight=FIRM, name="balance")
        stacks = self.stacks
        body = Level(*stacks.swing, self.balance, stacks.height, stacks.trunk, name="body", price=HASTE)
        rest = [] if stacks.posture is None else [Level(stacks.posture, name="posture")]
        knees = Level(stacks.knees, name="knees")
        stack = Stack(knees, body, *rest, Level(stacks.share, name="share"), subject_to=list(stacks.stack.subject_to))
        controller = Controller(stack, Torque(contact_law=Laws().contact, holding=None), deadline=math.inf)
        self.session = controller.session(robot, DT)
        self.moved, self.landing = np.zeros(2), np.zeros(2)
        gravity = float(-robot.gravity[2])
        self.load, self.lift, self.rises = robot.mass * gravity, gravity, float(self.rate[0, 2])

    def _furnish(self, spec: Any) -> None:
        super()._furnish(spec)
        more = 1.0 + self._disturbance.heavier
        for body in spec.bodies:
            if body.mass > 0.0:
                body.mass *= more
                body.inertia, body.fullinertia = more * np.array(body.inertia), more * np.array(body.fullinertia)

    def run(self) -> Fate:
        """Simulate to the end of the clip or to the fall."""
        end, usable, ticks, pushed = (len(self.q) - 2) / self.fps, 0, 0, False
        steps = round(DT / self.plant.timestep)
        while self.plant.time < end:
            i = int(self.plant.time * self.fps)
            off = self.plant.com() - self.com[i] - [*self.moved, 0.0]
            if not np.isfinite(self.plant.data.qpos).all() or float(np.linalg.norm(off)) > ASTRAY:
                break
            given = self._disturbance
            if given.push and not pushed and self.plant.time >= given.at:
                pushed = True
                self.plant.data.qvel[:2] += given.push * np.array([math.cos(given.heading), math.sin(given.heading)])
            tick = self._tick(i, self.plant.time - i / self.fps)
            usable, ticks = usable + tick.status.usable, ticks + 1
            command = self.load / (self.lift * self.robot.mass) * tick.command
            self.plant.step(np.clip(command, -self._limit, self._limit), steps=steps)
        return Fate(self.plant.time, end, usable / max(ticks, 1), math.nan, self._body())

    def _weigh(self, load: float, rate: float) -> None:
        """Mean the load of the soles [N] and the CoM's acceleration against free fall [m/s^2], from its rate [m/s]."""
        lift = (rate - self.rises) / DT - float(self.robot.gravity[2])
        self.load += DT / WEIGHS * (load - self.load)
        self.lift += DT / WEIGHS * (lift - self.lift)
        self.rises = rate

    def _tick(self, i: int, since: float) -> Any:
        reading = self.plant.measure()
        state = self.robot.state(reading.q, reading.v)
        told = self.clip.state(self.robot.integrate(self.q[i], self.v[i], since), self.v[i])
        calm = self.body.state(self.robot.integrate(self.calm[i], self.calm_v[i], since), self.calm_v[i])
        self._compare(state, told, [*self.moved, 0.0])
        self._weigh(float(np.sum(reading.contacts.load)), float(state.com_velocity()[2]))
        before = self.phase
        self._stand(i, reading.contacts.load)
        stacks = self.stacks
        com, rate, push = (x[i] + since * self.fps * (x[i + 1] - x[i]) for x in (self.com, self.rate, self.push))
        if before != BOTH and self.phase != before:
            self._landed(before, state, told)
        place = com[:2] + self.moved
        zmp, dcm = self._led(np.array([*place, com[2]]), rate, push)
        found = [
            self.balance.at(place, velocity=rate[:2], acceleration=push[:2]),
            stacks.height.at(com[2:], velocity=rate[2:], acceleration=push[2:]),
            stacks.trunk.at(calm.rotation(stacks.trunk.frame), velocity=calm.jacobian(stacks.trunk.frame)[3:] @ calm.v),
        ]
        if stacks.posture is not None:
            columns = self.robot.joints(stacks.posture.joints)
            found.append(stacks.posture.at(calm.angles[columns], velocity=calm.v[columns]))
        if self.phase == BOTH:
            found.append(stacks.share.at(self._shared(i, state, zmp)))
        else:
            side = 1 - [foot.name for foot in self.feet].index(self.phase)
            frame = self.feet[side].frame
            self._aim(i, side, state, dcm)
            pose = np.eye(4)
            pose[:3, :3], pose[:3, 3] = told.rotation(frame), told.position(frame)
            pose[:2, 3] += self.moved + self.landing
            pose[2, 3] -= SINK * self.late[side]
            found.append(stacks.swing[side].at(pose, velocity=told.jacobian(frame) @ told.v))
        return self.session.step(state, *found, phase=self.phase)

    def _aim(self, i: int, side: int, state: Any, dcm: Any) -> None:
        """Move the landing of a swing foot by the DCM's error at that time, less that which the ankle makes up for."""
        rests = self.rests[side][i:]
        left = float(np.argmax(rests)) / self.fps if rests.any() else math.inf
        if not SETTLED < left < 1.0:
            return
        stance = self.feet[1 - side]
        R = state.rotation(stance.frame)[:2, :2]
        xi = state.com()[:2] + state.com_velocity()[:2] / self.omega
        error = R.T @ (xi - dcm)
        x_min, x_max, y_min, y_max = stance.rectangle
        most = 0.5 * SPARE * np.array([x_max - x_min, y_max - y_min])
        beyond = np.sign(error) * np.maximum(np.abs(error) - most, 0.0) * math.exp(self.omega * left)
        aim = R @ np.clip(beyond, -REACH, REACH)
        self.landing += np.clip(aim - self.landing, -1.0 * DT, 1.0 * DT)  # at most 1 m/s

    def _landed(self, stance: str, state: Any, told: Any) -> None:
        """Move the rest of the plan to where the foot came down."""
        side = 1 - [foot.name for foot in self.feet].index(stance)
        frame = self.feet[side].frame
        self.moved = state.position(frame)[:2] - told.position(frame)[:2]
        self.landing = np.zeros(2)


def carry(robot: Any, targets: Targets, q: Any, plan: Dynamics, disturbance: Disturbance | None = None) -> Fate:
    """Simulate a planned clip q ``(T, nq)`` with the contacts of its schedule."""
    return Carrying(robot, targets, q, plan, disturbance or Disturbance()).run()
