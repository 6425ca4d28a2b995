"""One walk of one biped in MuJoCo: on estimated states, with noise, delay, other masses, encoder offsets."""

from __future__ import annotations

import math
import time
from collections import Counter
from typing import Any

import numpy as np

import hqp.robots
from hqp.arrays import Vec
from hqp.estimation import FeetEstimator
from hqp.robots.on_mujoco import Noise, Plane, Plant, Sensors, Terrain
from hqp.walking import Gait, Walker

DT = 0.002
NOISY = Sensors(
    orientation=Noise(0.002),
    gyro=Noise(0.01),
    accelerometer=Noise(0.05),
    angle=Noise(1e-4),
    rate=Noise(0.02),
    force=Noise(2.0),
)
MASSES, OFFSET, DELAY, FRICTION = 0.1, 0.005, 0.004, 0.5
"""Of a run: masses are so much more or less than the model's, encoders so far off [rad], delay [s], mu."""

SETTLE, STOP = 1.0, 3.0
"""Standing before the walk and after it [s]."""

CUT = 0.8
"""Share of the period after which a tick is cut off by default."""


class Course:
    """A robot, its walker and a plant; ``run`` goes on and keeps what it saw.

    seed: of noise, offsets and masses (even seeds: heavier, odd ones: lighter); None for a plant that is as the model
    says, on its true state.  height: of the ground at the start [m].
    """

    def __init__(
        self,
        name: str,
        seed: int | None = 0,
        *,
        terrain: Terrain | None = None,
        edit: Any = None,
        robot: Any = None,
        height: float = 0.0,
        gait: Gait | None = None,
        **walker: Any,
    ) -> None:
        self.robot = hqp.robots.load(name, rotors=True) if robot is None else robot
        self.walker = Walker(self.robot, gait, **{"dt": DT, "deadline": math.inf, **walker})
        self.exact = seed is None
        rng = np.random.default_rng(0 if seed is None else 1000 + seed)
        factor = 1.0 if seed is None else 1.0 + MASSES * (1 - 2 * (seed % 2))

        def changed(spec: Any) -> None:
            for body in spec.bodies:
                body.mass, body.inertia, body.fullinertia = (
                    factor * np.asarray(x) for x in (body.mass, body.inertia, body.fullinertia)
                )
            if edit is not None:
                edit(spec)

        self.plant = Plant(
            self.robot,
            terrain=terrain or Plane(friction=FRICTION),
            sensors=Sensors() if seed is None else NOISY,
            imu=self.robot.landmarks["base"][0],
            watched=[foot.frame for foot in self.walker.feet],
            delay=0.0 if seed is None else DELAY,
            edit=changed,
            seed=seed or 0,
        )
        home = self.robot.home.copy()
        home[2] += height
        q, _ = self.plant.reset(home)
        self.mass = float(self.plant.model.body_subtreemass[self.plant._root])
        self.offset = np.zeros(self.robot.nq)
        self.estimator: FeetEstimator | None = None
        if seed is not None:
            self.offset[7:] = rng.uniform(-OFFSET, OFFSET, self.robot.nq - 7)
            soles = [foot.frame for foot in self.walker.feet]
            self.estimator = FeetEstimator(self.robot, soles, DT, q, least_load=0.9 * self.robot.mass)
        self.limit = self.robot.effort_limit[self.robot.actuated]
        self.statuses: Counter[str] = Counter()
        self.jumps: list[float] = []
        self.usual: list[float] = []
        self.times: list[float] = []
        self.off: list[Any] = []
        self.edge = 0
        self.fell: float = math.nan
        self.tick: Any = None
        self._last: Vec | None = None

    def run(self, seconds: float, push: Any = None) -> bool:
        """Go on, pushed at the base by a force ``(3,)`` [N]; False once it has fallen."""
        end, steps = self.plant.time + seconds, round(DT / self.plant.timestep)
        while self.plant.time < end - 1e-9 and math.isnan(self.fell):
            reading = self.plant.measure()
            q, v = reading.q + self.offset, reading.v
            if self.estimator is not None:
                q, v = self.estimator.update(q, v, reading.accelerometer, reading.contacts.load)
                true = self.plant.state()[0]
                self.off.append([*(q[:3] - true[:3]), heading(q) - heading(true)])
            state = self.robot.state(q, v)
            start = time.thread_time()
            self.tick = tick = self.walker.step(state, reading.contacts.load)
            self.times.append(time.thread_time() - start)
            self.statuses[tick.status.name] += 1
            self.edge += self.walker.edge
            tau = np.clip(tick.command, -self.limit, self.limit)
            if self._last is not None:
                (self.jumps if self.walker.event else self.usual).append(float(np.abs(tau - self._last).max()))
            self._last = tau
            if push is not None:
                self.plant.push(self.robot.landmarks["base"][0], np.asarray(push, dtype=np.float64))
            self.plant.step(tau, steps=steps)
            if self.fallen():
                self.fell = self.plant.time
        return math.isnan(self.fell)

    def fallen(self) -> bool:
        """Whether the CoM is far below where it is to be, above the higher foot's ground."""
        if not np.isfinite(self.plant.data.qpos).all():
            return True
        ground = min(self.plant.place(foot.frame)[0][2] for foot in self.walker.feet)
        return bool(self.plant.com()[2] - ground < 0.7 * self.walker.height)

    def figures(self) -> dict[str, Any]:
        """What was seen."""
        ticks = sum(self.statuses.values())
        times, jumps, usual = (np.array(x or [math.nan]) for x in (self.times, self.jumps, self.usual))
        off = np.array(self.off or [[math.nan] * 4])
        return {
            "fell": self.fell,
            "optimal": self.statuses["OPTIMAL"] / ticks,
            "in_time": float(np.mean(times < CUT * DT)),
            "median_ms": 1e3 * float(np.median(times)),
            "p99_ms": 1e3 * float(np.quantile(times, 0.99)),
            "jump_switch": float(jumps.max()),
            "jump_switch_median": float(np.median(jumps)),
            "jump_else": float(usual.max()),
            "jump_else_999": float(np.quantile(usual, 0.999)),
            "edge": self.edge / ticks,
            "off_mm": 1e3 * float(np.linalg.norm(off[:, :3], axis=1).max()),
            "off_deg": math.degrees(float(np.abs(off[:, 3]).max())),
        }


def heading(q: Vec) -> float:
    """Of a free base [rad]."""
    x, y, z, w = q[3:7]
    return math.atan2(2.0 * (w * z + x * y), 1.0 - 2.0 * (y * y + z * z))
