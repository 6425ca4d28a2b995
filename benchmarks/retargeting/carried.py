"""A planned clip in MuJoCo: the CoM's plan fed forward, landings where the measured DCM needs them, disturbances."""

from __future__ import annotations

import math
from dataclasses import dataclass, replace
from typing import Any

import numpy as np

from benchmarks.retargeting.physics import ASTRAY, DT, FRICTION, SINK, Fate, Tracking
from hqp.declare.law import PD
from hqp.declare.stack import Level, Stack
from hqp.estimation.rotations import yaw_of
from hqp.loop.controller import Controller
from hqp.motion.dynamics import TAKES, Dynamics, front
from hqp.motion.rates import velocities
from hqp.motion.smoothing import filtered
from hqp.motion.targets import Targets
from hqp.tasks import CenterOfPressure, CollisionAvoidance, Com, ContactForce, EdgeContact, FrictionCone, Orientation
from hqp.torque.program import Torque
from hqp.walking.feet import Foot, feet_of
from hqp.walking.footsteps import rotation
from hqp.walking.pendulum import natural_frequency
from hqp.walking.stacks import BOTH, FIRM, HASTE, Laws
from tests.scenes.masses import scaled

REACH = 0.15
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
        """Masses 10 % up for odd seeds and down for even ones; seeds 1 and 2, 3 and 4, ... share a push of 0.1 m/s."""
        rng = np.random.default_rng((seed + 1) // 2)
        heading, at = float(rng.uniform(0.0, 2.0 * math.pi)), float(rng.uniform(0.3, 0.7)) * seconds
        return Disturbance(0.1 if seed % 2 else -0.1, 0.1, heading, at)


class Carrying(Tracking):
    """The robot in MuJoCo and the plan that it follows.

    The CoM follows the plan's acceleration and, with the gains of the walker's DCM law, its place and velocity.  A foot
    in the air lands where the DCM's error at that time is made up for; from there the rest of the plan is moved along.
    The robot weighs itself on its soles: its mass over the model's scales its torques.
    """

    def __init__(self, robot: Any, targets: Targets, q: Any, plan: Dynamics, disturbance: Disturbance) -> None:
        self._disturbance, self.toes = disturbance, plan.toes
        for foot in feet_of(robot):
            x, y = _front(foot).mean(axis=0)
            robot = robot.with_frame(toe(foot), foot.frame, [x, y, foot.depth])
        super().__init__(robot, targets, q)
        self.com, self.rate, self.push = plan.com, plan.velocity, plan.acceleration
        self.calm = filtered(robot, q, self.fps)
        self.calm_v, self.body = velocities(robot, self.calm, self.fps), robot.copy()
        k = Laws().balance.k
        law = PD(self.omega * k, self.omega + k)
        self.balance = Com(axes="xy", law=law, weight=FIRM, name="balance")
        controller = Controller(self._stack(), Torque(contact_law=Laws().contact, holding=None), deadline=math.inf)
        self.session = controller.session(robot, DT)
        self.pushes = [self._pushes(foot) for foot in self.feet]
        self.moved, self.landing = np.zeros(2), np.zeros(2)
        gravity = float(-robot.gravity[2])
        self.load, self.lift, self.rises = robot.mass * gravity, gravity, float(self.rate[0, 2])

    def _pushes(self, foot: Foot) -> Any:
        """Acceleration of a foot's place in the plan ``(T, 6)`` [m/s^2], zero for its turn.

        Turns of 100 rad/s^2 would outweigh the balance if a sole bounds both.
        """
        states = (self.clip.state(at, v) for at, v in zip(self.q, self.v, strict=True))
        twist = np.array([state.jacobian(foot.frame) @ state.v for state in states])
        rate: Any = np.gradient(twist, axis=0)
        rate[:, 3:] = 0.0
        return rate * self.fps

    def _stack(self) -> Stack:
        """The walker's stack with the CoM for the balance, links apart, and a phase for each foot on its toe."""
        stacks = self.stacks
        within: list[Any] = list(stacks.stack.subject_to)
        self.loads, self.heels = [], []
        for foot, other in zip(self.feet, self.feet[::-1], strict=True):
            name, half = toe(foot), 0.5 * float(np.ptp(_front(foot)[:, 1])) - foot.margin
            k = next(i for i, one in enumerate(within) if one.name == other.name)
            within[k] = replace(within[k], when=(*within[k].when, name))
            within += [
                EdgeContact(frame=name, axis="y", name=name, when=name),
                FrictionCone(contact=name, mu=FRICTION),
                CenterOfPressure(contact=name, rectangle=(-foot.margin, foot.margin, -half, half)),
            ]
            self.loads.append(ContactForce(contact=name, components=("fx", "fy", "fz", "mx", "mz")))
            law, heel = Laws().swing, f"{foot.name}_heel"
            self.heels.append(Orientation(frame=foot.frame, axes="pitch", law=law, name=heel, when=name))
        rest = []
        if stacks.posture is not None:
            rest = [Level(stacks.posture, name="posture")]
            within.append(CollisionAvoidance(joints=stacks.posture.joints))
        body = Level(*stacks.swing, *self.heels, self.balance, stacks.height, stacks.trunk, name="body", price=HASTE)
        shares = Level(stacks.share, *self.loads, name="share")
        return Stack(Level(stacks.knees, name="knees"), body, *rest, shares, subject_to=within)

    def _furnish(self, spec: Any) -> None:
        super()._furnish(spec)
        scaled(1.0 + self._disturbance.heavier)(spec)

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
        phase = self.phase
        raised = next((side for side in (0, 1) if phase == BOTH and self.toes[i, side]), None)
        if raised is not None:
            phase, heel = toe(self.feet[raised]), self.heels[raised]
            found.append(self._toe_load(raised, i, since, state, zmp, push))
            found.append(heel.at(heel.value(told), velocity=heel.jacobian(told) @ told.v))
        elif phase == BOTH:
            found.append(stacks.share.at(self._shared(i, state, zmp)))
        else:
            side = 1 - [foot.name for foot in self.feet].index(self.phase)
            frame = self.feet[side].frame
            speed = self._aim(i, side, state, dcm)
            pose = np.eye(4)
            pose[:3, :3], pose[:3, 3] = told.rotation(frame), told.position(frame)
            pose[:2, 3] += self.moved + self.landing
            pose[2, 3] -= SINK * self.late[side]
            twist, push = told.jacobian(frame) @ told.v, self.pushes[side]
            twist[:2] += speed
            if self.late[side] > 0.0:
                twist[2] -= SINK
            push = push[i] + since * self.fps * (push[i + 1] - push[i])
            found.append(stacks.swing[side].at(pose, velocity=twist, acceleration=push))
        return self.session.step(state, *found, phase=phase)

    def _toe_load(self, side: int, i: int, since: float, state: Any, zmp: Any, push: Any) -> Any:
        """Reference of a toe's force: its share of the load by the ZMP's place, which fades until the foot lifts."""
        foot = self.feet[side]
        place, other = state.position(toe(foot))[:2], self.feet[1 - side].placed(state).xy
        way, left = place - other, float(np.argmin(self.rests[side][i:])) / self.fps - since
        most = min(1.0, left / TAKES)
        share = min(max(float((zmp - other) @ way / (way @ way)), 0.0), most)
        self.share = share if side else 1.0 - share
        force = share * self.robot.mass * (push - self.robot.gravity)
        along = rotation(-yaw_of(state.rotation(foot.frame))) @ force[:2]
        return self.loads[side].at([*along, force[2], 0.0, 0.0])

    def _aim(self, i: int, side: int, state: Any, dcm: Any) -> Any:
        """Move the landing of a swing foot by the DCM's error at that time, less that which the ankle makes up for.

        Returns its speed ``(2,)`` [m/s]: it arrives as the foot lands, since a sudden move throws the body.
        """
        rests = self.rests[side][i:]
        left = float(np.argmax(rests)) / self.fps if rests.any() else math.inf
        if not SETTLED < left < 1.0:
            return np.zeros(2)
        stance = self.feet[1 - side]
        R = state.rotation(stance.frame)[:2, :2]
        xi = state.com()[:2] + state.com_velocity()[:2] / self.omega
        error = R.T @ (xi - dcm)
        x_min, x_max, y_min, y_max = stance.rectangle
        most = 0.5 * SPARE * np.array([x_max - x_min, y_max - y_min])
        height = float(state.com()[2] - state.position(stance.frame)[2])
        grown = math.exp(natural_frequency(height, -self.robot.gravity[2]) * left)
        beyond = np.sign(error) * np.maximum(np.abs(error) * grown - most * (grown - 1.0), 0.0)
        aim = R @ np.clip(beyond, -REACH, REACH)
        speed = np.clip((aim - self.landing) / (left - 0.5 * SETTLED), -1.0, 1.0)
        self.landing += DT * speed
        return speed

    def _landed(self, stance: str, state: Any, told: Any) -> None:
        """Move the rest of the plan to where the foot came down."""
        side = 1 - [foot.name for foot in self.feet].index(stance)
        frame = self.feet[side].frame
        self.moved = state.position(frame)[:2] - told.position(frame)[:2]
        self.landing = np.zeros(2)


def toe(foot: Foot) -> str:
    """Name of the front edge of a sole: its frame, its contact, and the phase in which it stands on it."""
    return f"{foot.name}_toe_edge"


def _front(foot: Foot) -> Any:
    """Right and left end of the front edge of a sole whose frame faces ahead ``(2, 2)`` [m]."""
    return front(np.array(foot.corners))


def carry(robot: Any, targets: Targets, q: Any, plan: Dynamics, disturbance: Disturbance | None = None) -> Fate:
    """Simulate a planned clip q ``(T, nq)`` with the contacts of its schedule."""
    return Carrying(robot, targets, q, plan, disturbance or Disturbance()).run()
