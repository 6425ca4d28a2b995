"""The plant: any robot's MJCF simulated in MuJoCo, in the coordinates of the robot that controls it.

plant = Plant(hqp.robots.load("dreamer"), "dreamer_rollers", terrain=Ramp(angle=0.12))
q, v = plant.reset()
plant.step(torque, steps=2)                 # two steps of 1 ms
q, v = plant.state()                        # the truth;  plant.measure(): readings of the sensors
"""

from __future__ import annotations

import math
from collections import deque
from collections.abc import Callable, Mapping, Sequence
from pathlib import Path
from typing import Any, get_args

import numpy as np

from hqp.arrays import Index, Mat, Vec
from hqp.errors import DeclarationError, JointNotFound, ModelError

from . import file_kind, scene
from .actuators import Actuation, Servo, fit
from .assembly import add_imu, find, root_of, set_armature
from .frames import Frames
from .ground_contact import Contacts, out_of_ground, watch
from .model_map import ModelMap, quaternion
from .mujoco_extra import full_inertia, mujoco
from .overlaps import exclude
from .rotors import rotor_inertia
from .sensors import Noise, Reading, Sensors, rotation_vector
from .terrain import Bumps, Plane, Ramp, Step, Terrain, Tiles

__all__ = [
    "Bumps",
    "Contacts",
    "ModelMap",
    "Noise",
    "Plane",
    "Plant",
    "Ramp",
    "Reading",
    "Sensors",
    "Servo",
    "Step",
    "Terrain",
    "Tiles",
]  # fmt: skip

_LEVEL, _PERFECT = Plane(), Sensors()
_SITE, _BODY = int(mujoco.mjtObj.mjOBJ_SITE), int(mujoco.mjtObj.mjOBJ_XBODY)
_LINEAR_FIRST = np.array([3, 4, 5, 0, 1, 2])


class Plant:
    """A simulated robot that takes commands and gives states, forces and sensor readings.

    robot: the Robot that controls, or a pinocchio.Model; states and commands are in its order.  mjcf: a path, or the
    stem of one of our own files (``cbi``, ``dreamer``, ``dreamer_rollers``); by default our own of the robot's name,
    else the robot's file: a URDF through MuJoCo's reader, with a motor for each of its joints.  actuation: ``torque``,
    ``position`` (servos with the gains of ``servo``, by default of the robot's description, else
    ``Servo.stiff(robot)``), or ``native``, the file's own actuators.  terrain: the ground, which takes the place of
    planes in the file, None to keep those.  Links that overlap at the robot's home do not collide, in any file
    format.  timestep, delay: duration of a step, and delay from command to motor [s].
    armature: reflected rotor inertia by joint or group [kg m^2] in place of the default (our own models, and URDF
    files, which have no word for it: rotor inertia of the robot's model, else min(0.01, effort limit / 5000)) or the
    file's; ``plant.armature`` has the value of each joint.  imu: a frame of the root body.
    watched: frames whose ground contact is measured, each with the links that are fixed to its own and all that hangs
    on them; soles or wheels by default.  edit: changes the MjSpec before it is compiled
    (payloads, other masses).  seed: seed of the sensors' noise.  Raises ModelError, JointNotFound, FrameNotFound,
    DeclarationError.
    """

    def __init__(
        self,
        robot: Any,
        mjcf: str | Path | None = None,
        *,
        actuation: Actuation = "torque",
        servo: Servo | None = None,
        terrain: Terrain | None = _LEVEL,
        sensors: Sensors = _PERFECT,
        timestep: float = 0.001,
        delay: float = 0.0,
        armature: Mapping[str, float] | None = None,
        imu: str | None = None,
        watched: Sequence[str] | None = None,
        edit: Callable[[Any], None] | None = None,
        seed: int = 0,
    ) -> None:
        if not timestep > 0.0 or not delay >= 0.0:
            raise DeclarationError("plant", "bad timestep or delay", value=(timestep, delay), unit="s")
        if actuation not in get_args(Actuation):
            allowed = ", ".join(get_args(Actuation))
            raise DeclarationError("plant", "unknown actuation", value=actuation, allowed=allowed)
        spec, path, about = find(robot, mjcf, timestep)
        self.servo = servo or Servo.from_description(about)
        if actuation == "position" and self.servo is None:
            if not hasattr(robot, "actuated"):
                raise DeclarationError("plant", "a pinocchio.Model has no servos", allowed="servo=Servo(kp=...)")
            self.servo = Servo.stiff(robot)
        driven = fit(spec, actuation, self.servo, getattr(robot, "joint_names", None), _tendons(robot))
        inertia = _armature(robot, path, about) if armature is None else armature
        set_armature(spec, inertia, {**about.get("groups", {}), **getattr(robot, "groups", {})})
        if edit is not None:
            edit(spec)
        root = root_of(spec, robot)
        site = add_imu(spec, imu or about.get("imu", root))
        scene.dress(spec, root, terrain)
        self.model, self.terrain, self.sensors, self.actuation = exclude(spec, robot, root), terrain, sensors, actuation
        scene.light(self.model)
        self.data = mujoco.MjData(self.model)
        self._frames = Frames(self.model)
        self._gyro, self._accelerometer = (self.data.sensor(f"plant_{s}").data for s in ("gyro", "accelerometer"))
        self.map = ModelMap(self.model, robot)
        self._home: Vec | None = getattr(robot, "home", None) if path == getattr(robot, "source", None) else None
        self._root, self._site = self.model.body(root).id, self.model.site(site).id
        if self.map.floating and self.model.body_weldid[self.model.site_bodyid[self._site]] != self._root:
            raise ModelError(f"IMU {imu!r} is not fixed to the root body {root!r}")
        self.joint_names: tuple[str, ...] = tuple(getattr(robot, "joint_names", driven))
        for name in self.joint_names:
            if name not in driven:
                raise JointNotFound(name, driven, f"{path.name}, among its motors,")
        self._order: Index = np.array([driven.index(name) for name in self.joint_names], dtype=np.intp)
        self._wheels: Index = np.array([driven.index(name) for name in self.map.wheels], dtype=np.intp)
        self._contacts, self.watched = watch(self.model, self._frames, watched, _default_watched(robot, about))
        self._start = self._initial()
        if file_kind.of(path) == "urdf":
            self._start = out_of_ground(self.model, self.map, self._start)
        self._delay, self._seed = round(delay / timestep), seed
        self.timestep = timestep
        self.reset()

    def reset(self, q: Vec | None = None, v: Vec | None = None) -> tuple[Vec, Vec]:
        """Start at (q, v); noise starts anew.  Returns the state.

        The default is at rest in the robot's home if it came from the same file, else in the file's first keyframe or
        its initial configuration.  A robot from a URDF, which does not define the height of its base, is lifted out of
        the ground.
        """
        mujoco.mj_resetData(self.model, self.data)
        if q is None:
            q = self._start.copy()
        self.data.qpos[:], self.data.qvel[:] = self.map.to_mujoco(q, np.zeros(self.map.nv) if v is None else v)
        self._rng = np.random.default_rng(self._seed)
        self._turned = np.array([q[i] for i, *_ in self.map.wheels.values()])
        self._control = np.zeros(self.model.nu)
        if self.actuation == "position":
            joints = self.model.actuator_trnid[:, 0]
            self._control[:] = self.data.qpos[self.model.jnt_qposadr[joints]]
        self._pending = deque(self._control.copy() for _ in range(self._delay))
        self.data.ctrl[:] = self._control  # else servos jerk in the first accelerometer reading
        mujoco.mj_forward(self.model, self.data)
        self._contacts.keep(self.data)
        self._specific_force = self._accelerometer.copy()
        return self.state()

    def step(self, command: Vec, rate: Vec | None = None, *, steps: int = 1) -> None:
        """Hold a command for some steps.

        command: torques [N m] or joint positions [rad], ``(n,)`` in the order of ``joint_names``.
        rate: joint velocities a position servo follows ``(n,)`` [rad/s], zero by default.
        Forces of ``push`` act during this call.  Raises DeclarationError for a wrong shape or number.
        """
        command = np.asarray(command, dtype=np.float64)
        if command.shape != self._order.shape or not all(map(math.isfinite, command.tolist())):
            allowed = f"finite, shape {self._order.shape}"
            raise DeclarationError("plant", "bad command", value=command, allowed=allowed)
        if rate is not None:
            if self.actuation != "position" or self.servo is None:
                raise DeclarationError("plant", "a command rate needs position servos", allowed="actuation='position'")
            command = command + self.servo.damping_time * rate
        self._control[self._order] = command
        model, data = self.model, self.data
        before = self._imu_motion()
        for left in range(steps - 1, -1, -1):
            if self._delay:
                self._pending.append(self._control.copy())
                data.ctrl[:] = self._pending.popleft()
            else:
                data.ctrl[:] = self._control
            # mj_step in two halves, so that positions and velocities are those of the new state
            mujoco.mj_step2(model, data)
            if not left:
                self._contacts.keep(data)
            mujoco.mj_step1(model, data)
            if self._wheels.size:
                self._turned += self.timestep * data.actuator_velocity[self._wheels]
        data.xfrc_applied[:] = 0.0
        change, turned = (after - ahead for after, ahead in zip(self._imu_motion(), before, strict=True))
        gained = change / (steps * self.timestep) - model.opt.gravity  # implicit steps gain less than the sensor's qacc
        self._specific_force = (before[1] + 0.5 * turned).T @ gained

    def state(self) -> tuple[Vec, Vec]:
        """The true (q, v) in Pinocchio's coordinates; the angle of a ball wheel is the integral of its rate."""
        q, v = self.map.to_pinocchio(self.data.qpos, self.data.qvel)
        for angle, (i, *_) in zip(self._turned.tolist(), self.map.wheels.values(), strict=True):
            q[i] = angle
        return q, v

    @property
    def time(self) -> float:
        """Time since the reset [s]."""
        return float(self.data.time)

    def push(self, frame: str, force: Vec, moment: Vec | None = None, at: Vec | None = None) -> None:
        """Add a force ``(3,)`` [N] and moment ``(3,)`` [N m], world axes, during the next call of ``step``.

        The force acts at the frame's origin, or at the point ``at`` of its body ``(3,)`` in the world [m].
        """
        body = self._frames.body(frame)
        point = self.place(frame)[0] if at is None else np.asarray(at)
        (x, y, z), (a, b, c) = (point - self.data.xipos[body]).tolist(), np.asarray(force).tolist()
        wrench = self.data.xfrc_applied[body]
        wrench += (a, b, c, y * c - z * b, z * a - x * c, x * b - y * a)
        if moment is not None:
            wrench[3:] += moment

    def move_hand(self, position: Vec) -> None:
        """Draw the human hand with its fingers at a point ``(3,)`` in the world [m]."""
        self.data.mocap_pos[self.model.body(scene.HAND).mocapid[0]] = position

    def _imu_motion(self) -> tuple[Vec, Mat]:
        """Velocity ``(3,)`` [m/s] and axes ``(3, 3)`` of the IMU in the world."""
        found = np.zeros(6)
        mujoco.mj_objectVelocity(self.model, self.data, _SITE, self._site, found, 0)
        return found[3:], self.data.site_xmat[self._site].reshape(3, 3).copy()

    @property
    def torque(self) -> Vec:
        """Torques of the motors during the last step ``(n,)`` [N m], after limits and delay."""
        return np.array(self.data.actuator_force[self._order])

    def place(self, frame: str) -> tuple[Vec, Mat]:
        """Position ``(3,)`` [m] and rotation ``(3, 3)`` of a site or body in the world."""
        site, index = self._frames.find(frame)
        data = self.data
        position = data.site_xpos[index] if site else data.xpos[index]
        rotation = data.site_xmat[index] if site else data.xmat[index]
        return np.array(position), np.array(rotation).reshape(3, 3)

    def velocity(self, frame: str) -> Vec:
        """Velocity ``(6,)`` of a frame's origin [m/s] and its rotation [rad/s], world axes."""
        site, index = self._frames.find(frame)
        angular_linear = np.zeros(6)
        mujoco.mj_objectVelocity(self.model, self.data, _SITE if site else _BODY, index, angular_linear, 0)
        linear_first: Vec = angular_linear[_LINEAR_FIRST]
        return linear_first

    def com(self) -> Vec:
        """The robot's centre of mass ``(3,)`` [m]."""
        return np.array(self.data.subtree_com[self._root])

    def momentum(self) -> Vec:
        """Linear [kg m/s] and angular momentum about the centre of mass [kg m^2/s], world axes ``(6,)``."""
        mujoco.mj_subtreeVel(self.model, self.data)
        linear = self.model.body_subtreemass[self._root] * self.data.subtree_linvel[self._root]
        return np.concatenate((linear, self.data.subtree_angmom[self._root]))

    def mass_matrix(self) -> Mat:
        """Inertia in Pinocchio's coordinates ``(nv, nv)``, armature included; rollers stand still on their hub."""
        B = self.map.tangent(self.data.qpos)
        return np.asarray(B.T @ full_inertia(self.model, self.data) @ B)

    def contacts(self) -> Contacts:
        """Ground contact of the watched frames during the last step, without noise."""
        return self._contacts.contacts()

    def measure(self) -> Reading:
        """Read every sensor; each call draws new noise."""
        sensors, rng, nv = self.sensors, self._rng, self.map.nv
        q, v = self.state()
        first = 6 if self.map.floating else 0
        if sensors.angle != _PERFECT.angle:
            angles = np.zeros(nv)
            angles[first:] = sensors.angle.read(angles[first:], rng)
            self.map.turn_joints(q, angles)
        v[first:] = sensors.rate.read(v[first:], rng)
        true = self.data.site_xmat[self._site].reshape(3, 3)
        rotation = true @ rotation_vector(sensors.orientation.read(np.zeros(3), rng))
        gyro = sensors.gyro.read(self._gyro, rng)
        if self.map.floating:
            mounting = self.data.xmat[self._root].reshape(3, 3).T @ true  # IMU axes in the base
            q[3:7] = quaternion(rotation @ mounting.T)
            v[3:6] = mounting @ gyro
        accelerometer = sensors.accelerometer.read(self._specific_force, rng)
        exact = sensors.force == _PERFECT.force
        contacts = self._contacts.contacts(None if exact else lambda force: sensors.force.read(force, rng))
        return Reading(self.time, q, v, rotation, gyro, accelerometer, contacts)

    @property
    def armature(self) -> dict[str, float]:
        """Reflected rotor inertia of each joint, in the order of ``joint_names`` [kg m^2], [kg] of slides."""
        joints = {self.model.joint(i).name for i in range(self.model.njnt)}
        return {name: float(self.model.joint(name).armature[0]) for name in self.joint_names if name in joints}

    def _initial(self) -> Vec:
        if self._home is not None:
            return np.array(self._home)
        qpos = self.model.key_qpos[0] if self.model.nkey else self.model.qpos0
        return self.map.to_pinocchio(qpos, np.zeros(self.model.nv))[0]


def _armature(robot: Any, path: Path, about: Mapping[str, Any]) -> Mapping[str, float]:
    """Default armature of joints."""
    if not about:
        return rotor_inertia(robot) if file_kind.of(path) == "urdf" else {}
    return dict(about.get("plant", {}).get("armature", {}))


def _tendons(robot: Any) -> dict[str, tuple[dict[str, float], float]]:
    """Coefficients of the joints of motors that pull several, and their largest torques, by the motor's joint."""
    found = {}
    if hasattr(robot, "actuation"):
        for name, own, row in zip(robot.joint_names, robot.actuated, robot.actuation, strict=True):
            if np.count_nonzero(row) > 1:
                pulled = {robot.joint_name(j): float(row[j]) for j in np.flatnonzero(row).tolist()}
                found[name] = pulled, float(robot.effort_limit[own])
    return found


def _default_watched(robot: Any, about: Mapping[str, Any]) -> tuple[str, ...]:
    """Feet and wheels of our own models, soles of others."""
    if not about:
        return tuple(getattr(robot, "landmarks", {}).get("soles", ()))
    return tuple(c["frame"] for c in (*about.get("contacts", ()), *about.get("wheels", ())))
