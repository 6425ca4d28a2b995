"""One run of Dreamer: scene, controller, a human who pulls, log."""

from __future__ import annotations

import math
import time
from collections.abc import Callable
from typing import Any

import numpy as np

import hqp
from benchmarks.lab.recorder import Recorder, level_residuals
from benchmarks.sentis2012.experiments.compliance import COM_GOAL, HAND_GOAL, Compliance, Targets, stack
from benchmarks.sentis2012.experiments.ground import GROUND_PUSH, ContactNormals, GroundForce, Odometry
from benchmarks.sentis2012.experiments.ground_map import GroundMap
from benchmarks.sentis2012.experiments.hand_loads import HandLoads
from benchmarks.sentis2012.experiments.released import MOTORS, MovingLimits, ReleasedWheels
from benchmarks.sentis2012.experiments.scene import OFF, Scene
from hqp.arrays import Vec
from hqp.loop.session import Tick
from hqp.robots.on_mujoco import Contacts, Plant, Sensors
from hqp.solvers.base import Solver
from hqp.tasks import ExternalWrench
from tests.scenes.sentis2012 import EXACT


class Outing:
    """Robot, plant, session; ``run`` simulates and logs.

    residuals: true to log those of every level, which no figure needs.
    """

    def __init__(
        self,
        scene: Scene,
        choice: Compliance,
        solver: str | Solver,
        seen: Callable[[Outing], None] | None = None,
        residuals: bool = True,
    ) -> None:
        self.scene, self.choice, self._seen, self._residuals = scene, choice, seen, residuals
        self.robot = hqp.robots.load("dreamer", rotors=True)
        tasks = stack(choice)
        formulation = hqp.Torque(gravity_compensation=True, loop_law=EXACT)
        self.session = hqp.Controller(tasks, formulation, solver=solver, price=0, deadline=math.inf).session(
            self.robot, choice.period
        )
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
        self._places = self.robot.positions(self._upper)
        self._coupled = self.robot.positions(self.robot.joints(("torso_hip", "torso_thorax")))
        self.posture = self.robot.state(self.robot.home).angles[self._upper]
        self.q, self.v = self.plant.reset(self._start())
        self._targets = Targets(choice, tasks, self.posture, scene.heading, 9.81 * self.robot.mass)
        self._normals = ContactNormals(3, choice.period)
        self._map = GroundMap(self.robot, choice.period) if choice.normals == "map" else None
        pushed = tasks.find(GROUND_PUSH, ExternalWrench) if choice.normals == "felt" else None
        self._odometry = Odometry(self.robot)
        self._released: ReleasedWheels | None = None
        if choice.released:
            limits = tasks.find(MOTORS, MovingLimits)
            self._released = ReleasedWheels(self.robot, limits, choice.released, choice.period)
        self._was, self._shaken = self.v[:3].copy(), np.random.default_rng(scene.seed)
        lag, most, share = choice.felt
        weight = 9.81 * self.robot.mass
        self._ground_force = GroundForce(self.robot, pushed, choice.period, lag, most, share * weight)
        self._actuated = self.robot.actuated
        self._limit = scene.strength * self.robot.effort_limit[self._actuated]
        model = self.plant.model
        # fed forward.  A ball wheel has half of the table's damping, since it turns about two axes at once; feeding
        # the whole forward would balance the drag, but spin up a wheel that leaves the ground
        self._damping = np.array([model.joint(name).damping[0] for name in self.robot.joint_names])
        one_motor = self.robot.joint_names.index("torso_hip")  # bends the thorax as much
        self._damping[one_motor] += model.joint("torso_thorax").damping[0]
        self.loads = HandLoads(self.robot, choice, tasks, self._damping, scene.payload)
        data = self.plant.data  # live views, which the log is made from
        self._com = data.subtree_com[int(model.joint("torso_yaw").bodyid[0])]
        self._base_place, self._base_axes = data.body("base").xpos, data.body("base").xmat
        self._hand = data.site("hand_point").xpos
        self._perfect = scene.sensors == Sensors()
        self._held = self.q.copy()
        self.hand_at_rest = self.plant.place("hand_point")[0]
        self.pull: Vec = np.zeros(3)
        self._com_error = 0.0, 0.0
        self.t, self.wall, self.processor = 0.0, 0.0, 0.0
        self.log = Recorder()

    def _edit(self, spec: Any) -> None:
        for motor in spec.actuators:
            motor.ctrlrange = self.scene.strength * np.asarray(motor.ctrlrange)
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
        """Return true if the base has tipped, the upper body is off by 30 cm, or the state is not finite."""
        upright = 1.0 - 2.0 * (self.q[3] ** 2 + self.q[4] ** 2)  # cosine of the base's tilt
        error = math.hypot(*self._com_error)
        return not (upright > math.cos(math.radians(self.scene.slope + 20.0)) and error < 0.3)

    @property
    def ignored_normals(self) -> int:
        """Number of contact normals that were too far off the base's to be ground."""
        return self._normals.ignored

    @property
    def real_time(self) -> tuple[float, float]:
        """Simulated over processor time, and over wall time, of controller and plant together."""
        return self.t / max(self.processor, 1e-9), self.t / max(self.wall, 1e-9)

    def run(self) -> Outing:
        """Simulate until the end of the scene or a fall."""
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
        q[:3] = 0.0  # the base's place is unknown, and no task needs it
        free = self._released
        v[:3] = (
            self._odometry.velocity(v) if free is None else self._odometry.velocity(v, self._gained(q), free.bearing)
        )
        if not choice.gyro:
            v[3:5] = 0.0  # as for wheels on the base's own plane
        state = self.robot.state(q, v)
        rotation = state.rotation("base")
        if self._map is None:
            normals = self._normals.update(contacts, rotation[:, 2])
        else:
            normals = self._map.update(rotation, v[:3])
        loads = contacts.load if choice.normals in ("contact", "contact in all") else None
        acting = self.loads.references(state, self.pull)
        push = self._ground_force.references()
        tick = self.session.step(state, *self._targets(rotation, v[:3], normals, loads), *acting, *push)
        torque = tick.command + self._damping * v[self._actuated]
        self._brake(torque)
        torque = np.minimum(np.maximum(torque, -self._limit), self._limit)
        self.loads.sent(state, torque)
        if choice.normals == "felt":
            apart = self._odometry.contradiction
            place = state.position("hand_point") - state.position("base")
            out = free is not None and not all(free.bearing)
            self._ground_force.update(self.loads.residual, rotation, self.loads.observed, place, apart, out)
        if free is not None:
            free.update(self._ground_force.loads, self._odometry.spinning(v))
        spent = time.perf_counter() - began
        self._disturb()
        plant.step(torque, steps=round(choice.period / plant.timestep))
        self.q, self.v = plant.state()
        return torque, contacts, tick, spent

    def _gained(self, q: Vec) -> Vec:
        """Velocity gained since the last tick by the accelerometer: noise of 0.1 m/s^2, gravity by the IMU's tilt."""
        dt, true, (x, y, z, w) = self.choice.period, self._base_axes.reshape(3, 3)[2], q[3:7].tolist()
        up = np.array([2.0 * (x * z - w * y), 2.0 * (y * z + w * x), 1.0 - 2.0 * (x * x + y * y)])
        gained = self.v[:3] - self._was + 9.81 * dt * (true - up) + self._shaken.normal(0.0, 0.1 * dt, 3)
        self._was = self.v[:3].copy()
        return gained

    def _brake(self, torque: Vec) -> None:
        """Before the motors are on, brakes hold joints and wheels."""
        upper_on, base_on = self.scene.enable
        if self.t < upper_on:
            stiff = np.where(np.arange(9) < 2, 2000.0, 300.0)
            own = torque[:9]
            gravity = self.robot.state(self.q, self.v).gravity_force()
            own[:] = (
                gravity[self._upper] - stiff * (self.q - self._held)[self._places] - 0.05 * stiff * self.v[self._upper]
            )
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
        q, v = self.q, self.v
        x, y, z = place = self._base_place.tolist()
        axes = self._base_axes.tolist()
        yaw = math.atan2(axes[3], axes[0])
        c, s = math.cos(yaw), math.sin(yaw)
        (com_x, com_y, _), (hand_x, hand_y, hand_z) = self._com.tolist(), self._hand.tolist()
        com_x, com_y, hand_x, hand_y = com_x - x, com_y - y, hand_x - x, hand_y - y
        error = self._com_error = c * com_x + s * com_y - COM_GOAL[0], c * com_y - s * com_x - COM_GOAL[1]
        hip, thorax = self._coupled
        self.log.add(
            t=self.t,
            com=error,
            hand=(
                c * hand_x + s * hand_y - HAND_GOAL[0],
                c * hand_y - s * hand_x - HAND_GOAL[1],
                hand_z - z - HAND_GOAL[2],
            ),
            q=q,
            v=v,
            posture=q[self._places] - self.posture,
            base=(*place, yaw, math.asin(max(-1.0, min(1.0, axes[6])))),
            velocity=self._base_axes.reshape(3, 3) @ v[:3],
            pull=self.pull,
            felt=self.loads.force,
            carried=self.loads.mass,
            load=contacts.load,
            torque=torque,
            rate=v[self._actuated],
            coupling=q[hip] - q[thorax],
            slip=self._odometry.slip(v),
            **({"residuals": level_residuals(tick)} if self._residuals else {}),
            status=tick.status.severity,
            lost=float(any(note.status is hqp.Status.CONTACT_LOST for note in tick.notes)),
            tick=spent,
        )
