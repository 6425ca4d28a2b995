"""CBi on its feet in simulation: the paper's stack, and the loop from measured state to position servos.

Mistry et al. 2008, eqs. (12) to (17), (19): the stack gives joint velocities, their integral goes to stiff position
servos, and the tasks' errors are those of the measured state.
"""

from __future__ import annotations

import math
import time
from collections.abc import Callable, Sequence
from typing import Any, Literal

import numpy as np

import hqp
from benchmarks.lab.curves import smooth
from benchmarks.lab.outcome import Figure
from benchmarks.lab.recorder import Recorder, level_residuals
from hqp import Stack
from hqp.arrays import Vec
from hqp.declare.reference import Reference
from hqp.estimation import FeetEstimator
from hqp.loop.session import Tick
from hqp.robots.on_mujoco import Noise, Plane, Plant, Sensors
from hqp.solvers.base import Solver
from hqp.tasks import Com, Position
from tests.scenes.mistry2008 import Gains

PERIOD = 0.002
"""Period of position commands: 500 Hz, as on the robot [s]."""

AHEAD = 0.016
"""Distance of the CoG ahead of the midpoint of the ankles [m]."""

SOLES = ("l_sole", "r_sole")

SETTLE = 2.0
"""Time in which the CoG moves there before a run's clock starts [s]."""

Feedback = Literal["task", "none", "reset"]
"""State at which the rows are evaluated: ``task``, the measured one, with commands integrated separately;
``none``, the commanded one; ``reset``, the measured one, from which every command starts again."""


GAINS = Gains(foot=0.3, hand=2.0, extraneous=1.0)
"""Gains for the plant's stiff position servos [1/s].  Feet tilt by 0.4 mrad on soft ground, which no joint can undo:
feedback of the tilt moves the CoG off its goal, by 0.4 mm at 1/s."""

Knows = Literal["senses", "truth"]
"""Source of the controller's base state: ``senses``, an estimate from IMU, encoders and the feet's loads; ``truth``,
the simulator, which is privileged."""

SENSES = Sensors(
    orientation=Noise(1e-3), gyro=Noise(0.01), accelerometer=Noise(0.05), angle=Noise(1e-4), rate=Noise(0.01),
    force=Noise(3.0),
)  # fmt: skip
"""Noise of CBi's sensors, white at every reading."""


class Balance:
    """One run: plant, session and clock; ``step`` is one period.

    knows, sensors: source of the base state, noise.  phase: the stack's phase from the next period on.
    ``q``, ``v``: the simulator's state; ``known``: the controller's estimate.

    After ``settle``, ``goal`` is the CoG's goal ``(2,)`` [m] and ``t`` starts from zero.
    """

    def __init__(
        self,
        stack: Stack,
        solver: str | Solver,
        *,
        feedback: Feedback = "task",
        friction: float = 0.8,
        knows: Knows = "senses",
        sensors: Sensors = SENSES,
        seed: int = 0,
        seen: Callable[[Balance], None] | None = None,
        phase: str | None = None,
    ) -> None:
        self.robot = hqp.robots.load("cbi")
        ground = Plane(friction=friction)
        self.plant = Plant(self.robot, actuation="position", terrain=ground, sensors=sensors, seed=seed)
        self.session = hqp.Controller(stack, hqp.Velocity(), solver=solver, price=0, deadline=math.inf).session(
            self.robot, PERIOD
        )
        self.feedback, self._seen, self.phase = feedback, seen, phase
        self.q, self.v = self.plant.reset()
        self._estimator = FeetEstimator(self.robot, SOLES, PERIOD, self.q) if knows == "senses" else None
        self.known = self.q, self.v
        self.base_error: Vec = np.zeros(6)
        """Error of the estimated base: place [m] and rotation vector [rad], base axes."""
        places = self.robot.positions(self.robot.actuated)
        assert places is not None  # CBi has no continuous joint
        self._places = places
        self.command: Vec = self.q[places].copy()
        self._own = self.q.copy(), self.v.copy()
        self.t = 0.0
        self.wall, self.processor, self.tick_times = 0.0, 0.0, [0.0]
        self.start = self.plant.com()[:2].copy()
        soles = [self.plant.place(frame)[0] for frame in SOLES]
        self.soles = np.array(soles)
        self.goal: Vec = self.soles.mean(axis=0)[:2] + [AHEAD, 0.0]
        self.log = Recorder()
        self.instants: list[tuple[str, float]] = []
        """Captions and times of pictures [s]."""

    @property
    def fallen(self) -> bool:
        """Return true if the pelvis has sunk or the state is not finite."""
        return not self.q[2] > 0.7 * self.robot.home[2]

    @property
    def real_time(self) -> tuple[float, float]:
        """Simulated over processor time, and over wall time, of controller and plant together."""
        simulated = self.log.length * PERIOD
        return simulated / max(self.processor, 1e-9), simulated / max(self.wall, 1e-9)

    def settle(self) -> None:
        """Move the CoG from its place at home to its goal."""
        com = self.session.stack.find("com_xy", Com)

        def path(t: float) -> Vec:
            return self.start + smooth(t / SETTLE) * (self.goal - self.start)

        for i in range(round(SETTLE / PERIOD)):
            self._advance((com.at(path(i * PERIOD), velocity=_rate(path, i * PERIOD)),))
        self.t = 0.0

    def step(self, *references: Reference, **values: Any) -> Tick:
        """Run one period: measure, control, simulate, log the run's own values and ``values``."""
        began, burnt = time.perf_counter(), time.thread_time()
        tick = self._advance(references)
        self.wall += time.perf_counter() - began
        self.processor += time.thread_time() - burnt
        self.log.add(
            t=self.t,
            com=self.plant.com(),
            soles=np.linalg.norm(self._feet() - self.soles, axis=1),
            command=tick.command,
            q=self.q,
            base_error=self.base_error,
            torque=self.plant.torque,
            residuals=level_residuals(tick),
            tick=self.tick_times[-1],
            **values,
        )
        if self._seen is not None:
            self._seen(self)
        return tick

    def _advance(self, references: Sequence[Reference]) -> Tick:
        began = time.perf_counter()
        self.known = self._know()
        state = self.robot.state(*(self._own if self.feedback == "none" else self.known))
        tick = self.session.step(state, *references, phase=self.phase)
        self.tick_times.append(time.perf_counter() - began)
        self.base_error = self.robot.difference(self.q, self.known[0])[:6]
        if self.feedback == "none":
            self._own = tick.advance()
        start = self.known[0][self._places] if self.feedback == "reset" else self.command
        self.command = start + PERIOD * tick.command
        self.plant.step(self.command, rate=tick.command, steps=round(PERIOD / self.plant.timestep))
        self.q, self.v = self.plant.state()
        self.t += PERIOD
        return tick

    def _know(self) -> tuple[Vec, Vec]:
        """(q, v) as the controller estimates them."""
        if self._estimator is None:
            return self.q, self.v
        reading = self.plant.measure()
        return self._estimator.update(reading.q, reading.v, reading.accelerometer, reading.contacts.load)

    def _feet(self) -> np.ndarray[Any, np.dtype[np.float64]]:
        return np.array([self.plant.place(frame)[0] for frame in SOLES])


def _rate(path: Callable[[float], Vec], t: float) -> Vec:
    return (path(t + PERIOD) - path(t)) / PERIOD


def follow(
    run: Balance,
    seconds: float,
    com: Callable[[float], Vec],
    hand: Callable[[float], Vec] | None = None,
    *,
    feedforward: bool = True,
) -> Recorder:
    """Follow offsets of the CoG ``(2,)`` and of the hand ``(3,)`` [m] over time, until the end or a fall.

    The log gets ``com_goal`` and ``hand_goal``, the goals of CoG and hand at the end of each period.
    """
    stack = run.session.stack
    com_task = stack.find("com_xy", Com)
    hand_task = None if hand is None else stack.find("hand", Position)
    at_rest = run.plant.place("r_palm")[0]
    while run.t < seconds - 0.5 * PERIOD and not run.fallen:
        t = run.t
        references = [com_task.at(run.goal + com(t), velocity=_rate(com, t) if feedforward else None)]
        values: dict[str, Vec] = {"com_goal": run.goal + com(t + PERIOD)}
        if hand_task is not None and hand is not None:
            references.append(hand_task.at(at_rest + hand(t), velocity=_rate(hand, t) if feedforward else None))
            values["hand_goal"] = at_rest + hand(t + PERIOD)
        run.step(*references, **values)
        if hand is not None:
            run.log.add_to_last(hand=run.plant.place("r_palm")[0])
    return run.log


def still(t: float) -> Vec:
    """No motion of the CoG ``(2,)``."""
    return np.zeros(2)


def base_errors(log: Recorder) -> tuple[float, float]:
    """Largest errors of the estimated base: place [mm] and rotation [deg]."""
    place, turned = np.linalg.norm(log["base_error"][:, :3], axis=1), np.linalg.norm(log["base_error"][:, 3:], axis=1)
    return 1e3 * float(place.max()), math.degrees(float(turned.max()))


def base_figures(log: Recorder) -> list[Figure]:
    """Figures of the base estimate."""
    place, turned = base_errors(log)
    return [
        Figure("base as estimated from IMU, encoders and feet: place off by, max", place, "mm", high=2.0),
        Figure("base as estimated: orientation off by, max", turned, "deg", high=0.2),
    ]


def joint_margin(log: Recorder, robot: Any) -> float:
    """Least distance of a main joint from its limits [rad]."""
    columns = robot.joints("main")
    places = robot.positions(columns)
    q = log["q"][:, places]
    return float(min((q - robot.lower[columns]).min(), (robot.upper[columns] - q).min()))


def torque_share(log: Recorder, robot: Any) -> tuple[float, str]:
    """Largest torque of a main joint as a share of its limit, and the joint."""
    limit = robot.effort_limit[robot.actuated]
    main = set(robot.joints("main").tolist())
    share = np.abs(log["torque"]).max(axis=0) / limit
    share[[column not in main for column in robot.actuated.tolist()]] = 0.0
    worst = int(np.argmax(share))
    return float(share[worst]), robot.joint_names[worst]
