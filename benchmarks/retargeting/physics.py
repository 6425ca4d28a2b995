"""A clip in MuJoCo, tracked by one torque controller with the walker's gains: time until the robot falls."""

from __future__ import annotations

import math
from dataclasses import dataclass
from typing import Any

import mujoco
import numpy as np

from hqp.estimation.rotations import yaw_of
from hqp.loop.controller import Controller
from hqp.motion.clip import low_pass
from hqp.motion.contacts import runs
from hqp.motion.joints import SIDES
from hqp.motion.rates import velocities
from hqp.motion.smoothing import LIVELY
from hqp.motion.targets import Targets
from hqp.robots.on_mujoco import Plane, Plant
from hqp.torque.program import Torque
from hqp.walking.feet import Foot, feet_of
from hqp.walking.pendulum import natural_frequency
from hqp.walking.stacks import BOTH, Laws, Stacks
from hqp.walking.walker import LIMITS, TAKE, TOUCH

DT = 0.002
FRICTION = 0.8

ASTRAY = 0.25
"""Distance of the CoM from the clip's beyond which the robot counts as fallen [m]."""

OUTSIDE = 0.01
"""Distance of a ZMP from the soles beyond which ``Fate.beyond`` counts its frame [m]."""

RAISED = 0.02
"""Height of a resting foot above which the scene puts a plate under it [m]."""

PLATE = 0.15, 0.12, 0.01
"""Half its length along the foot, width and thickness [m]."""

FEET = 2
"""Bit of the plates, which feet alone touch: the extent of a box around its footholds is unknown."""

EACH = 10
"""Ticks between two comparisons of the links with the reference's."""

SINK = 0.2
"""Downward speed of a foot that should stand but bears no load [m/s]."""


@dataclass(frozen=True)
class Fate:
    """Outcome of a clip: time until the fall and its length [s]; share of ticks with a usable command.

    beyond: share of the clip's frames with a foot on the ground whose ZMP is more than ``OUTSIDE`` off the soles.
    body: mean distance of the links from the reference's until then [m].
    """

    seconds: float
    of: float
    usable: float
    beyond: float
    body: float


def plates(targets: Targets) -> list[Any]:
    """Centre of each place at which feet rest above the floor ``(3,)`` [m], with the foot's number and a frame."""
    found = []
    for k, side in enumerate(SIDES):
        ground, place = targets.contacts.ground[f"{side}_foot"], targets.places[f"{side}_sole"]
        for first, last in runs(targets.contacts.resting[f"{side}_foot"]):
            if ground[first] > RAISED:
                middle = np.median(place[first:last, :2], axis=0)
                found.append(([*middle, ground[first]], k, (first + last) // 2))
    return found


def _neighbours(spec: Any) -> list[tuple[str, str]]:
    """Links at most two joints apart: convex hulls of their meshes overlap where the links themselves do not."""
    fixed: dict[str, str] = {}  # each body's link: bodies without a joint belong to their parent's
    above: dict[str, str] = {}
    for body in spec.bodies:
        if body.name == "world":
            continue
        over = body.parent.name
        fixed[body.name] = body.name if len(list(body.joints)) or over == "world" else fixed[over]
        if fixed[body.name] == body.name and over in fixed:
            above[body.name] = fixed[over]
    found = []
    for one in fixed:
        for other in fixed:
            a, b = fixed[one], fixed[other]
            near = {a, above.get(a), above.get(above.get(a, ""))}
            if one < other and (b in near or a in {b, above.get(b), above.get(above.get(b, ""))}):
                found.append((one, other))
    return found


class Tracking:
    """The robot in MuJoCo and the clip that it follows.

    A foot stands if the clip has its contact and it bears load.  The DCM and the ZMP of the clip, below 6 Hz, lead
    the balance; swing feet, the height of the CoM, the trunk's axes and the joints of the rest are the clip's own.
    """

    def __init__(self, robot: Any, targets: Targets, q: Any) -> None:
        self.robot, self.targets, self.q, self.fps = robot, targets, q, targets.fps
        self.v = velocities(robot, q, self.fps)
        self.clip = robot.copy()
        self.feet: tuple[Foot, Foot] = feet_of(robot)
        com = low_pass(np.array([robot.state(at).com() for at in q]), LIVELY, self.fps)
        self.com, self.rate = com, np.gradient(com, axis=0) * self.fps
        self.push = np.gradient(self.rate, axis=0) * self.fps
        first = robot.state(q[0])
        level = float(np.mean([first.position(foot.frame)[2] for foot in self.feet]))
        self.height = float(com[0, 2]) - level
        self.omega = natural_frequency(self.height, -self.robot.gravity[2])
        self.stacks = Stacks(robot, self.feet, self.height, FRICTION, Laws(), LIMITS, q[0])
        controller = Controller(self.stacks.stack, Torque(contact_law=Laws().contact, holding=None), deadline=math.inf)
        self.session = controller.session(robot, DT)
        self.rests = [targets.contacts.resting[f"{side}_foot"] for side in SIDES]
        self.plant = Plant(
            robot,
            terrain=Plane(friction=FRICTION),
            watched=[foot.frame for foot in self.feet],
            edit=self._furnish,
        )
        self.plant.reset(q[0], self.v[0])
        self.down = [True, True]
        self.late = [0.0, 0.0]
        self.share, self.phase = 0.5, BOTH
        self.off: list[float] = []

    def _furnish(self, spec: Any) -> None:
        for foot in self.feet:
            site = spec.site(foot.frame)
            for geom in (spec.body(foot.frame) if site is None else site.parent).geoms:
                geom.conaffinity |= FEET
        for (x, y, z), k, frame in plates(self.targets):
            place, friction = (x, y, z - PLATE[2]), (FRICTION, 0.005, 0.0001)
            half = 0.5 * yaw_of(self.clip.state(self.q[frame]).rotation(self.feet[k].frame))
            spec.worldbody.add_geom(
                type=mujoco.mjtGeom.mjGEOM_BOX, size=PLATE, pos=place, quat=(math.cos(half), 0.0, 0.0, math.sin(half)),
                friction=friction, contype=FEET, conaffinity=0,
            )  # fmt: skip

        for one, other in _neighbours(spec):
            spec.add_exclude(bodyname1=one, bodyname2=other)

    def run(self) -> Fate:
        """Simulate to the end of the clip or to the fall."""
        end, usable, ticks = (len(self.q) - 2) / self.fps, 0, 0
        steps = round(DT / self.plant.timestep)
        while self.plant.time < end:
            i = int(self.plant.time * self.fps)
            off = self.plant.com() - self.com[i]
            if not np.isfinite(self.plant.data.qpos).all() or float(np.linalg.norm(off)) > ASTRAY:
                break
            tick = self._tick(i, self.plant.time - i / self.fps)
            usable, ticks = usable + tick.status.usable, ticks + 1
            self.plant.step(np.clip(tick.command, -self._limit, self._limit), steps=steps)
        return Fate(self.plant.time, end, usable / max(ticks, 1), self._beyond(), self._body())

    def _body(self) -> float:
        return float(np.mean(self.off)) if self.off else math.nan

    def _compare(self, state: Any, told: Any, moved: Any = 0.0) -> None:
        """Note how far the links are from the reference's."""
        if round(self.plant.time / DT) % EACH == 0:
            places = []
            for at in (state, told):
                at.kinematics()
                places.append(np.array([p.copy() for *_, (p, _) in at.robot.bodies[1:]]))
            self.off.append(float(np.linalg.norm(places[0] - places[1] - moved, axis=1).mean()))

    def _beyond(self) -> float:
        """Share of frames whose ZMP lies outside the feet on the ground."""
        off = []
        for i, at in enumerate(self.q):
            down = [bool(rests[i]) for rests in self.rests]
            if any(down):
                phase = BOTH if all(down) else self.feet[down.index(True)].name
                zmp, _ = self._led(self.com[i], self.rate[i], self.push[i])
                state = self.clip.state(at, self.v[i])
                own = self.stacks.supports[phase].dcm(state)
                reached, wanted = self.stacks.supports[phase].zmp(state, np.concatenate((zmp, own)))
                off.append(float(np.linalg.norm(reached - wanted)) > OUTSIDE)
        return float(np.mean(off)) if off else math.nan

    def _led(self, com: Any, rate: Any, push: Any) -> tuple[Any, Any]:
        """ZMP and DCM of the clip ``(2,)`` each [m]."""
        return com[:2] - push[:2] / self.omega**2, com[:2] + rate[:2] / self.omega

    @property
    def _limit(self) -> Any:
        return self.robot.effort_limit[self.robot.actuated]

    def _tick(self, i: int, since: float) -> Any:
        reading = self.plant.measure()
        state = self.robot.state(reading.q, reading.v)
        told = self.clip.state(self.robot.integrate(self.q[i], self.v[i], since), self.v[i])
        self._compare(state, told)
        self._stand(i, reading.contacts.load)
        stacks = self.stacks
        com, rate, push = (x[i] + since * self.fps * (x[i + 1] - x[i]) for x in (self.com, self.rate, self.push))
        zmp, dcm = self._led(com, rate, push)
        found = [
            stacks.balance.at(zmp, dcm),
            stacks.height.at(com[2:], velocity=rate[2:], acceleration=push[2:]),
            stacks.trunk.at(told.rotation(stacks.trunk.frame), velocity=told.jacobian(stacks.trunk.frame)[3:] @ told.v),
        ]
        for posture in (stacks.posture, stacks.legs):
            if posture is not None and posture.name in self.session:
                columns = self.robot.joints(posture.joints)
                found.append(posture.at(told.angles[columns], velocity=told.v[columns]))
        if self.phase == BOTH:
            found.append(stacks.share.at(self._shared(i, state, zmp)))
        else:
            side = 1 - [foot.name for foot in self.feet].index(self.phase)
            frame = self.feet[side].frame
            pose = np.eye(4)
            pose[:3, :3], pose[:3, 3] = told.rotation(frame), told.position(frame)
            pose[2, 3] -= SINK * self.late[side]
            found.append(stacks.swing[side].at(pose, velocity=told.jacobian(frame) @ told.v))
        return self.session.step(state, *found, phase=self.phase)

    def _stand(self, i: int, loads: Any) -> None:
        """Set the standing feet: feet in contact in the clip, once they bear load."""
        for side in (0, 1):
            asked = bool(self.rests[side][i])
            touched = self.down[side] or float(loads[side]) > -TOUCH * self.robot.mass * self.robot.gravity[2]
            self.late[side] = self.late[side] + DT if asked and not touched else 0.0
            self.down[side] = asked and touched
        if all(self.down):
            if self.phase != BOTH:
                self.share = float(self.phase == self.feet[1].name)  # the other foot bears nothing yet
            self.phase = BOTH
        elif any(self.down):
            self.phase = self.feet[self.down.index(True)].name

    def _shared(self, i: int, state: Any, zmp: Any) -> float:
        """Load share of the right foot by the ZMP's place between the feet; zero for a foot that is about to lift."""
        one, other = (foot.placed(state).xy for foot in self.feet)
        between = other - one
        share = min(max(float((zmp - one) @ between / max(between @ between, 1e-9)), 0.0), 1.0)
        soon = min(len(self.q) - 1, i + round(2.0 * TAKE * self.fps))
        for side, rests in enumerate(self.rests):
            if not rests[i : soon + 1].all() and self.rests[1 - side][i : soon + 1].all():
                share = float(1 - side)
        most = DT / TAKE
        self.share += min(max(share - self.share, -most), most)
        return self.share


def fate(robot: Any, targets: Targets, q: Any) -> Fate:
    """Simulate a clip q ``(T, nq)`` with the contacts and places of the targets."""
    return Tracking(robot, targets, q).run()
