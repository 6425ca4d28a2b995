"""A walker in MuJoCo, on the state that its simulated sensors give."""

from __future__ import annotations

from collections import deque
from typing import TYPE_CHECKING, Any

import numpy as np
from numpy.typing import ArrayLike

from hqp.arrays import Vec
from hqp.estimation import FeetEstimator, MomentumObserver
from hqp.robots.on_mujoco import Noise, Plane, Plant, Sensors, Servo, Terrain
from hqp.walking.feet import Foot, base_of
from hqp.walking.walker import Walker

if TYPE_CHECKING:
    from hqp.declare.robot import State
    from hqp.loop.tick import Tick

NOISY = Sensors(
    orientation=Noise(0.002),
    gyro=Noise(0.01),
    accelerometer=Noise(0.05),
    angle=Noise(1e-4),
    rate=Noise(0.02),
    force=Noise(2.0),
)
"""Noise of a usual humanoid: IMU, encoders, foot forces [rad, rad/s, m/s^2, N]."""

LEAST = 0.9
"""Load of a standing foot for the estimator, per mass of the robot [N/kg]."""

FALLEN = 0.7
"""Share of the CoM's height below which a robot counts as fallen."""


BANDWIDTH = 50.0
"""Bandwidth of the observers of legs [1/s]: a touch-down is seen within 6 ms, noise of encoders makes 4 N of a light
leg."""


def observer(robot: Any, foot: Foot, period: float) -> MomentumObserver:
    """Observer of the force at a sole from the torques of its leg."""
    return MomentumObserver(robot, foot.frame, foot.leg, period, bandwidth=BANDWIDTH)


class Course:
    """A walker, the plant that it moves and the estimator between; ``step`` is one tick of it.

    sensors: sensors of the plant; None for none at all: then the walker gets the true state.  delay: delay of torques
    [s].  terrain: level, with mu 0.6, for None.  height: height of the ground at the start [m].  offsets: errors of the
    encoders ``(nq,)`` [rad].  servo: position servos in place of torque motors.  feels: true if feet have force
    sensors; else their loads are those of momentum observers of the legs.  edit, seed: arguments of Plant.
    """

    def __init__(
        self,
        walker: Walker,
        *,
        sensors: Sensors | None = NOISY,
        delay: float = 0.004,
        terrain: Terrain | None = None,
        height: float = 0.0,
        offsets: Vec | None = None,
        servo: Servo | None = None,
        feels: bool = True,
        edit: Any = None,
        seed: int = 0,
    ) -> None:
        self.walker, robot = walker, walker.robot
        soles = [foot.frame for foot in walker.feet]
        self.base: str = base_of(robot)
        placed = robot.copy()
        placed.set_home(walker.start)  # links that overlap there do not collide in the plant
        self.plant = Plant(
            placed,
            terrain=terrain or Plane(friction=0.6),
            sensors=sensors or Sensors(),
            imu=self.base,
            watched=soles,
            delay=delay,
            actuation="torque" if servo is None else "position",
            servo=servo,
            edit=edit,
            seed=seed,
        )
        start = walker.start.copy()
        start[2] += height
        q, _ = self.plant.reset(start)
        self.offsets: Vec = np.zeros(robot.nq) if offsets is None else offsets
        self.estimator: FeetEstimator | None = None
        if sensors is not None:
            self.estimator = FeetEstimator(robot, soles, walker.dt, q, least_load=LEAST * robot.mass)
        self.state: State = robot.state(q)
        """Latest state given to the walker."""
        self.observers = () if feels else tuple(observer(robot, foot, walker.dt) for foot in walker.feet)
        self._twin = robot.copy()
        self._loads = np.full(2, 0.5 * walker.weight)
        self._sent = deque([np.zeros(len(self.plant.joint_names))] * round(delay / walker.dt))
        self._kp = None if servo is None else np.array([servo.gain(name) for name in self.plant.joint_names])
        self._steps, self._delay = round(walker.dt / self.plant.timestep), delay

    def step(self, push: ArrayLike | None = None) -> Tick:
        """One tick; push: a force on the base during it ``(3,)`` [N]."""
        reading = self.plant.measure()
        q, v, loads = reading.q + self.offsets, reading.v, self._loads if self.observers else reading.contacts.load
        if self.estimator is not None:
            q, v = self.estimator.update(q, v, reading.accelerometer, loads)
        time = None if self.walker.max_age is None else self.plant.time
        self.state = self.walker.robot.state(q, v, time=time)
        tick = self.walker.step(self.state, loads, now=time)
        self._sent.append(tick.command.copy())
        acts = self._sent.popleft()
        if self.observers:
            felt = self._twin.state(q, v)
            self._loads = np.array([each.update(felt, acts)[2] for each in self.observers])
        if push is not None:
            self.plant.push(self.base, np.asarray(push, dtype=np.float64))
        if self._kp is None:
            self.plant.step(tick.command, steps=self._steps)
        else:
            angles, rates = self.walker.positions(tick, self._kp, self._delay)
            self.plant.step(angles, rates, steps=self._steps)
        return tick

    @property
    def fallen(self) -> bool:
        """True if the CoM is far below its desired height above the lower foot."""
        if not np.isfinite(self.plant.data.qpos).all():
            return True
        ground = min(self.plant.place(foot.frame)[0][2] for foot in self.walker.feet)
        return bool(self.plant.com()[2] - ground < FALLEN * self.walker.height)
