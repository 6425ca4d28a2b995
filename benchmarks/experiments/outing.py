"""One run of Dreamer: a scene, a controller, a human who pulls, and what came of it."""

from __future__ import annotations

import math
import time
from collections.abc import Callable
from dataclasses import dataclass, field
from typing import Any

import numpy as np

import hqp
from benchmarks.experiments.compliance import COM_GOAL, HAND_GOAL, Compliance, Targets, stack
from benchmarks.experiments.ground import ContactNormals, HeightMap, Odometry
from benchmarks.experiments.human import SpringHand, Walk
from benchmarks.experiments.recorder import Recorder, level_residuals
from hqp.arrays import Vec
from hqp.robots.on_mujoco import Contacts, Plane, Plant, Ramp, Sensors, Terrain
from hqp.session import Tick
from hqp.solvers.base import Solver

ARMATURE = 0.02
"""Rotor inertia of torso and arm [kg m^2], known to the controller as the plant has it."""

GROUND = {"impedance": (0.99, 0.99), "solref": (0.03, 1.0)}
"""Hard but damping ground.  With MuJoCo's defaults the rollers, 10 g each, make a contact so soft that the robot rocks
on it at 15 Hz; with a shorter time constant wheels bounce off the lower edge of the ramp."""

RAMP_START = 0.35
"""From the middle of the base to the ramp's lower edge, at the start [m]."""

OFF = (0.20, 0.12, 0.25, 0.20, -0.12, 0.35, -0.20, 0.15, 0.20)
"""Posture error of a start out of place, upper body's order, 7 to 20 degrees [rad]."""


@dataclass(frozen=True, kw_only=True)
class Scene:
    """Where and how: everything of a run but the controller.

    plant: ``dreamer`` (ball wheels) or ``dreamer_rollers``.  slope [deg], top: height of a plateau [m].  heading: of
    the robot, the ramp rises towards 0 [rad].  out_of_place: posture errors at the start, of those in OFF.
    enable: when upper body and base motors come on [s]; brakes hold them before.
    payload at the hand [kg], extra_mass: factor on the upper body's masses, both unknown to the controller.
    push: force on the hand ``(3,)`` [N] in place of the walk, from 1 s to 2.5 s.
    tilt: by which a helper lifts the front of the base [rad].
    """

    plant: str = "dreamer"
    slope: float = 7.0
    top: float | None = None
    friction: float = 0.8
    walk: Walk = field(default_factory=Walk)
    hand: SpringHand = field(default_factory=SpringHand)
    heading: float = 0.0
    out_of_place: float = 0.0
    enable: tuple[float, float] = (0.0, 0.0)
    delay: float = 0.0
    sensors: Sensors = field(default_factory=Sensors)
    payload: float = 0.0
    extra_mass: float = 1.0
    push: tuple[float, float, float] | None = None
    tilt: float = 0.0
    seconds: float | None = None
    seed: int = 0

    @property
    def duration(self) -> float:
        """Of the run [s]."""
        return self.walk.end + 1.5 if self.seconds is None else self.seconds

    def terrain(self) -> Terrain:
        """The ground."""
        ground: dict[str, Any] = {"friction": self.friction, **GROUND}
        if self.slope == 0.0:
            return Plane(**ground)
        return Ramp(start=RAMP_START, angle=math.radians(self.slope), top=self.top, **ground)


class Outing:
    """Robot, plant, session; ``run`` carries it out and returns the log."""

    def __init__(
        self,
        scene: Scene,
        choice: Compliance,
        solver: str | Solver,
        seen: Callable[[Outing], None] | None = None,
    ) -> None:
        self.scene, self.choice, self._seen = scene, choice, seen
        self.robot = hqp.robots.load("dreamer")
        self.robot.model.armature[self.robot.joints(("torso", "arm"))] = ARMATURE
        tasks = stack(choice)
        formulation = hqp.Torque(gravity_compensation=True)
        self.session = hqp.Controller(tasks, formulation, solver=solver).session(self.robot, choice.period)
        self.plant = Plant(
            self.robot,
            scene.plant,
            terrain=scene.terrain(),
            sensors=scene.sensors,
            delay=scene.delay,
            edit=self._edit,
            seed=scene.seed,
        )
        self._upper = self.robot.joints("upper_body")
        self.posture = self.robot.state(self.robot.home).angles[self._upper]
        self.q, self.v = self.plant.reset(self._start())
        self._targets = Targets(choice, tasks, self.posture, scene.heading)
        self._normals = ContactNormals(3, choice.period)
        self._map = HeightMap(choice.period) if choice.normals == "map" else None
        self._odometry = Odometry(self.robot)
        self._actuated = self.robot.actuated
        self._limit = self.robot.effort_limit[self._actuated]
        damping = self.robot.model.damping.copy()
        damping[self.robot.joints("torso_hip")] += damping[self.robot.joints("torso_thorax")]  # one motor, both joints
        self._damping = damping[self._actuated]
        model = self.plant.model
        self._subtree = int(model.joint("torso_yaw").bodyid[0])
        self._perfect = scene.sensors == Sensors()
        self._held = self.q.copy()
        self.hand_at_rest = self.plant.place("hand_point")[0]
        self.pull: Vec = np.zeros(3)
        self._com_error: Vec = np.zeros(2)
        self.t, self.wall, self.processor = 0.0, 0.0, 0.0
        self.log = Recorder()

    def _edit(self, spec: Any) -> None:
        if self.scene.payload:
            body = spec.body("hand").add_body(name="payload")
            body.mass, body.inertia, body.explicitinertial = self.scene.payload, [1e-4] * 3, True
            body.pos = [0.07, 0.0, 0.0]
        if self.scene.extra_mass != 1.0:
            upper = spec.body("torso_pan")
            for body in (upper, *upper.find_all("body")):
                body.mass *= self.scene.extra_mass
                body.inertia = self.scene.extra_mass * np.asarray(body.inertia)

    def _start(self) -> Vec:
        step = np.zeros(self.robot.nv)
        if self.scene.out_of_place:
            step[self._upper] = self.scene.out_of_place * np.array(OFF)
            step[self.robot.joints("torso_thorax")] = self.scene.out_of_place * OFF[1]
        q = self.robot.integrate(self.robot.home, step, 1.0)
        q[3:7] = [0.0, 0.0, math.sin(0.5 * self.scene.heading), math.cos(0.5 * self.scene.heading)]
        return q

    @property
    def fallen(self) -> bool:
        """Whether the base has tipped, the upper body is off by 30 cm, or the state is no longer finite."""
        upright = 1.0 - 2.0 * (self.q[3] ** 2 + self.q[4] ** 2)  # cosine of the base's tilt
        error = float(np.linalg.norm(self._com_error))
        return not (upright > math.cos(math.radians(self.scene.slope + 20.0)) and error < 0.3)

    @property
    def real_time(self) -> tuple[float, float]:
        """Simulated over processor time, and over wall time, of controller and plant together."""
        return self.t / max(self.processor, 1e-9), self.t / max(self.wall, 1e-9)

    def run(self) -> Outing:
        """Until the end of the scene or a fall."""
        ticks = round(self.scene.duration / self.choice.period)
        for i in range(ticks):
            self.t = i * self.choice.period
            began, burnt = time.perf_counter(), time.thread_time()
            seen = self._step()
            self.wall += time.perf_counter() - began
            self.processor += time.thread_time() - burnt
            self._record(*seen)
            if self._seen is not None:
                self._seen(self)
            if self.fallen:
                break
        return self

    def _step(self) -> tuple[Vec, Contacts, Tick, float]:
        plant, choice = self.plant, self.choice
        began = time.perf_counter()
        if self._perfect:
            q, v, contacts = self.q.copy(), self.v.copy(), plant.contacts()
        else:
            reading = plant.measure()
            q, v, contacts = reading.q, reading.v, reading.contacts
        q[:3] = 0.0  # nobody knows where the base is, and no task asks
        v[:3] = self._odometry.velocity(v)
        if not choice.gyro:
            v[3:5] = 0.0  # what wheels on the base's own plane say
        state = self.robot.state(q, v)
        rotation = state.rotation("base")
        normals = self._normals.update(contacts) if self._map is None else self._map.update(rotation, v[:3])
        tick = self.session.step(state, *self._targets(rotation, v[:3], normals))
        torque = tick.command + self._damping * v[self._actuated]
        self._brake(torque)
        np.clip(torque, -self._limit, self._limit, out=torque)
        spent = time.perf_counter() - began
        self._disturb()
        plant.step(torque, steps=round(choice.period / plant.timestep))
        self.q, self.v = plant.state()
        return torque, contacts, tick, spent

    def _brake(self, torque: Vec) -> None:
        """Before the motors are on, brakes hold joints and wheels."""
        upper_on, base_on = self.scene.enable
        if self.t < upper_on:
            places = self.robot.positions(self._upper)
            stiff = np.where(np.arange(9) < 2, 2000.0, 300.0)
            own = torque[:9]
            gravity = self.robot.state(self.q, self.v).gravity_force()
            own[:] = gravity[self._upper] - stiff * (self.q - self._held)[places] - 0.05 * stiff * self.v[self._upper]
            own[1] += gravity[self.robot.joints("torso_thorax")[0]]
        if self.t < base_on:
            torque[9:] = -20.0 * self.v[self._actuated][9:]

    def _disturb(self) -> None:
        scene, plant = self.scene, self.plant
        if scene.tilt:
            self._lift()
        if scene.push is not None:
            self.pull = np.array(scene.push) if 1.0 <= self.t < 2.5 else np.zeros(3)
        elif self.t >= scene.walk.start:
            place, velocity = plant.place("hand_point")[0], plant.velocity("hand_point")[:3]
            self.pull = scene.hand.force(scene.walk, self.t, self.hand_at_rest, place, velocity)
        else:
            self.hand_at_rest = plant.place("hand_point")[0]
        if self.pull.any():
            plant.push("hand_point", self.pull)

    def _lift(self) -> None:
        """A helper lifts the front of the base, whose wheels have their brakes on, and sets it down again."""
        scene = self.scene
        goal = 0.36 * math.sin(scene.tilt) * math.sin(math.pi * self.t / scene.duration) ** 2
        height, rate = self.plant.place("wheel_contact_0")[0][2], self.plant.velocity("wheel_contact_0")[2]
        force = 1e5 * (goal - height) - 5e3 * rate if goal > 1e-3 else 0.0
        self.plant.push("wheel_contact_0", np.array([0.0, 0.0, min(max(force, 0.0), 600.0)]))

    def _record(self, torque: Vec, contacts: Contacts, tick: Tick, spent: float) -> None:
        plant, q, v = self.plant, self.q, self.v
        place, rotation = plant.place("base")
        yaw = math.atan2(rotation[1, 0], rotation[0, 0])
        heading = np.array([[math.cos(yaw), math.sin(yaw)], [-math.sin(yaw), math.cos(yaw)]])
        com = plant.data.subtree_com[self._subtree] - place
        hand = plant.place("hand_point")[0] - place
        world = rotation @ v[:3]
        hip, thorax = self.robot.positions(self.robot.joints(("torso_hip", "torso_thorax")))
        self._com_error = heading @ com[:2] - COM_GOAL
        self.log.add(
            t=self.t,
            com=self._com_error,
            hand=np.append(heading @ hand[:2], hand[2]) - HAND_GOAL,
            posture=q[self.robot.positions(self._upper)] - self.posture,
            base=(*place, yaw, math.asin(max(-1.0, min(1.0, rotation[2, 0])))),
            velocity=world,
            pull=self.pull,
            load=contacts.load,
            torque=torque,
            rate=v[self._actuated],
            coupling=q[hip] - q[thorax],
            slip=self._odometry.slip(v),
            residuals=level_residuals(tick),
            status=tick.status.severity,
            tick=spent,
        )


@dataclass(frozen=True)
class Measures:
    """Numbers of one run: errors [mm], forces [N], angles [deg], speeds [m/s], torques [N m]; NaN where not reached.

    com_up, com_back: largest CoM error before and after the turn.  speed: median over the pull's steady part.
    load_quantile: 0.5 % quantile of the least wheel load from half a second on; unloaded: seconds without load.
    rate_ratio: largest joint speed over its table limit, and whose.
    """

    fell: float
    com_up: float
    com_back: float
    travel: float
    speed: float
    peak_speed: float
    pull: float
    hand_pulled: float
    hand_rest: float
    posture: float
    coupling: float
    load_least: float
    load_quantile: float
    unloaded: float
    wheel_torque: float
    torque_ratio: float
    slip: float
    yaw: float
    rate_ratio: float
    rate_joint: str
    tick_us: float
    real_time: float

    @property
    def com(self) -> float:
        """Largest CoM error of the whole run [mm], inf after a fall."""
        return math.inf if math.isfinite(self.fell) else max(self.com_up, self.com_back)


def measure(outing: Outing, since: float = 0.5) -> Measures:
    """The numbers of a run, from ``since`` [s] on (after the robot has settled on its wheels)."""
    log, scene, robot = outing.log, outing.scene, outing.robot
    t = log["t"]
    on = t >= since
    com = 1e3 * np.linalg.norm(log["com"], axis=1)
    turn = scene.walk.turn if scene.push is None else 2.5
    up, back = on & (t < turn), on & (t >= turn)
    speed = np.linalg.norm(log["velocity"][:, :2], axis=1)
    easing = scene.walk.start + scene.walk.easing
    steady = (t >= easing) & (t < max(scene.walk.start + scene.walk.distance / scene.walk.speed, easing + 0.01))
    hand = 1e3 * np.linalg.norm(log["hand"], axis=1)
    rest = on & (t < scene.walk.start) & (t >= max(since, scene.walk.start - 0.1))
    moved = np.linalg.norm(log["base"][:, :2] - log["base"][0, :2], axis=1)
    load = log["load"][on].min(axis=1)
    limit = robot.velocity_limit[robot.actuated]
    ratio = np.abs(log["rate"][on]) / limit
    worst = int(np.argmax(ratio.max(axis=0))) if len(ratio) else 0
    return Measures(
        fell=float(t[-1]) if outing.fallen else math.nan,
        com_up=_largest(com[up]),
        com_back=_largest(com[back]),
        travel=_largest(moved),
        speed=float(np.median(speed[steady])) if steady.any() else math.nan,
        peak_speed=_largest(speed[on]),
        pull=_largest(np.linalg.norm(log["pull"], axis=1)),
        hand_pulled=_largest(hand[on]),
        hand_rest=_largest(hand[rest]),
        posture=math.degrees(_largest(np.abs(log["posture"][on]).max(axis=1))),
        coupling=math.degrees(_largest(np.abs(log["coupling"][on]))),
        load_least=float(load.min()) if load.size else math.nan,
        load_quantile=float(np.quantile(load, 0.005)) if load.size else math.nan,
        unloaded=float(np.count_nonzero(load <= 0.0) * outing.choice.period),
        wheel_torque=_largest(np.abs(log["torque"][on][:, 9:]).max(axis=1)),
        torque_ratio=_largest((np.abs(log["torque"][on]) / robot.effort_limit[robot.actuated]).max(axis=1)),
        slip=_largest(np.abs(log["slip"][on]).max(axis=1)),
        yaw=math.degrees(_largest(np.abs(np.unwrap(log["base"][on][:, 3]) - scene.heading))),
        rate_ratio=float(ratio.max()) if ratio.size else math.nan,
        rate_joint=robot.joint_names[worst],
        tick_us=float(1e6 * np.median(log["tick"])),
        real_time=outing.real_time[0],
    )


def _largest(values: Vec) -> float:
    return float(values.max()) if values.size else math.nan
