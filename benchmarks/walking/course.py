"""One walk of one biped in MuJoCo: on estimated states, with noise, delay, other masses, encoder offsets."""

from __future__ import annotations

import math
import time
from collections import Counter
from typing import Any

import numpy as np

import hqp.robots
from hqp.angles import wrapped
from hqp.arrays import Vec
from hqp.robots.on_mujoco import Plane, Servo, Terrain
from hqp.walking import Gait, Walker
from hqp.walking import course as walking
from tests.scenes.masses import scaled

DT = 0.002
MASSES, OFFSET, DELAY, FRICTION = 0.1, 0.005, 0.004, 0.5
"""Disturbances of a run: share of mass above or below the model's, encoder offset [rad], delay [s], mu."""

SETTLE, STOP = 1.0, 3.0
"""Durations of standing before the walk and after it [s]."""

FELT = 0.02
"""Least swing of a torque that counts as a reversal, as a share of the joint's limit."""

CUT = 0.8
"""Default deadline as a share of the period."""


class Course:
    """Course of the walker with its figures; each ``run`` continues it and records.

    seed: seed of noise, offsets and masses (even: heavier, odd: lighter); None for a plant equal to the model and the
    true state.  masses: share of mass above or below the model's.  height: height of the ground at the start [m].
    servo, feels: options of walking.Course.
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
        servo: Servo | None = None,
        feels: bool = True,
        masses: float = MASSES,
        gait: Gait | None = None,
        **walker: Any,
    ) -> None:
        self.robot = hqp.robots.load(name, rotors=True) if robot is None else robot
        self.walker = Walker(self.robot, gait, **{"dt": DT, "deadline": math.inf, **walker})
        rng = np.random.default_rng(0 if seed is None else 1000 + seed)
        factor = 1.0 if seed is None else 1.0 + masses * (1 - 2 * (seed % 2))

        def changed(spec: Any) -> None:
            scaled(factor)(spec)
            if edit is not None:
                edit(spec)

        offsets = np.zeros(self.robot.nq)
        if seed is not None:
            offsets[7:] = rng.uniform(-OFFSET, OFFSET, self.robot.nq - 7)
        self.course = walking.Course(
            self.walker,
            sensors=None if seed is None else walking.NOISY,
            delay=0.0 if seed is None else DELAY,
            terrain=terrain or Plane(friction=FRICTION),
            height=height,
            servo=servo,
            feels=feels,
            offsets=offsets,
            edit=changed,
            seed=seed or 0,
        )
        self.plant = self.course.plant
        self.mass = float(self.plant.model.body_subtreemass[self.plant._root])
        self.statuses: Counter[str] = Counter()
        self.jumps: list[float] = []
        self.usual: list[float] = []
        self.times: list[float] = []
        self.off: list[Any] = []
        self.edge = 0
        self.fell: float = math.nan
        self.tick: Any = None
        self._last: Vec | None = None
        self._turns = Turns(FELT * self.robot.effort_limit[self.robot.actuated])
        step = self.walker.step

        def timed(*given: Any, **named: Any) -> Any:
            start = time.thread_time()
            tick = step(*given, **named)
            self.times.append(time.thread_time() - start)
            return tick

        self.walker.step = timed  # type: ignore[method-assign]

    def run(self, seconds: float, push: Any = None) -> bool:
        """Continue under a force at the base ``(3,)`` [N]; return false after a fall."""
        end = self.plant.time + seconds
        while self.plant.time < end - 1e-9 and math.isnan(self.fell):
            true = self.plant.state()[0]
            self.tick = self.course.step(push)
            q = self.course.state.q
            self.off.append([*(q[:3] - true[:3]), wrapped(heading(q) - heading(true))])
            self.statuses[self.tick.status.name] += 1
            self.edge += self.walker.edge
            tau = self.tick.command.copy()
            if self._last is not None:
                (self.jumps if self.walker.event else self.usual).append(float(np.abs(tau - self._last).max()))
            self._last = tau
            self._turns.take(tau)
            if self.course.fallen:
                self.fell = self.plant.time
        return math.isnan(self.fell)

    def figures(self) -> dict[str, Any]:
        """Figures of the record."""
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
            "reversals": float(self._turns.count.max()) / (ticks * DT),
            "edge": self.edge / ticks,
            "off_mm": 1e3 * float(np.linalg.norm(off[:, :3], axis=1).max()),
            "off_deg": math.degrees(float(np.abs(off[:, 3]).max())),
        }


class Turns:
    """Reversals of signals, ``count`` ``(n,)``: changes of direction by more than ``least`` ``(n,)``."""

    def __init__(self, least: Vec) -> None:
        self._least, self._way = least, np.zeros(least.size)
        self._low, self._high = np.full(least.size, math.inf), np.full(least.size, -math.inf)
        self.count = np.zeros(least.size, dtype=int)

    def take(self, x: Vec) -> None:
        """The next sample ``(n,)``."""
        self._low, self._high = np.minimum(self._low, x), np.maximum(self._high, x)  # since the latest turn
        down = (self._way >= 0.0) & (self._high - x > self._least)
        up = (self._way <= 0.0) & (x - self._low > self._least) & ~down
        self.count += (down | up) & (self._way != 0.0)
        self._way = np.where(down, -1.0, np.where(up, 1.0, self._way))
        self._low[down], self._high[up] = x[down], x[up]


def heading(q: Vec) -> float:
    """Heading of a free base [rad]."""
    x, y, z, w = q[3:7]
    return math.atan2(2.0 * (w * z + x * y), 1.0 - 2.0 * (y * y + z * z))
