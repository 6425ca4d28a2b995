"""CBi on its feet in simulation: the paper's stack, and the loop from measured state to position servos.

Mistry et al. 2008, eqs. (12) to (17), (19): the stack gives joint velocities, their integral goes to stiff position
servos, and the tasks' errors are those of the measured state.
"""

from __future__ import annotations

import time
from collections.abc import Callable, Sequence
from typing import Any, Literal

import numpy as np

import hqp
from benchmarks.lab.curves import smooth
from benchmarks.lab.recorder import Recorder, level_residuals
from benchmarks.mistry2008.stack import Gains
from hqp import Stack
from hqp.arrays import Vec
from hqp.reference import Reference
from hqp.robots.on_mujoco import Plane, Plant
from hqp.session import Tick
from hqp.solvers.base import Solver
from hqp.tasks import Com, Position

PERIOD = 0.002
"""Of position commands: 500 Hz, as on the robot [s]."""

AHEAD = 0.016
"""The CoG is kept this far ahead of the ankles, midway between them [m]."""

SETTLE = 2.0
"""The CoG is brought there in this time, before a run's clock starts [s]."""

Feedback = Literal["task", "none", "reset"]
"""Whose state the rows are evaluated at: ``task``, the measured one, with commands integrated on their own;
``none``, the commanded one; ``reset``, the measured one, from which every command starts again."""


GAINS = Gains(foot=1.0, hand=2.0, extraneous=1.0)
"""What the stiff position servos of the plant take well [1/s]."""


class Balance:
    """One run: plant, session and clock; ``step`` is one period.

    after ``settle``, ``goal`` is where the CoG is kept ``(2,)`` [m] and ``t`` starts from zero.
    """

    def __init__(
        self,
        stack: Stack,
        solver: str | Solver,
        *,
        feedback: Feedback = "task",
        friction: float = 0.8,
        seen: Callable[[Balance], None] | None = None,
    ) -> None:
        self.robot = hqp.robots.load("cbi")
        self.plant = Plant(self.robot, actuation="position", terrain=Plane(friction=friction))
        self.session = hqp.Controller(stack, hqp.Velocity(), solver=solver, price=0).session(self.robot, PERIOD)
        self.feedback, self._seen = feedback, seen
        self.q, self.v = self.plant.reset()
        places = self.robot.positions(self.robot.actuated)
        assert places is not None  # CBi has no continuous joint
        self._places = places
        self.command: Vec = self.q[places].copy()
        self._own = self.q.copy(), self.v.copy()
        self.t = 0.0
        self.wall, self.processor, self.tick_times = 0.0, 0.0, [0.0]
        self.start = self.plant.com()[:2].copy()
        soles = [self.plant.place(frame)[0] for frame in ("l_sole", "r_sole")]
        self.soles = np.array(soles)
        self.goal: Vec = self.soles.mean(axis=0)[:2] + [AHEAD, 0.0]
        self.log = Recorder()
        self.instants: list[tuple[str, float]] = []
        """What is worth a picture, and when [s]."""

    @property
    def fallen(self) -> bool:
        """Whether the pelvis has sunk, or the state is no longer finite."""
        return not self.q[2] > 0.7 * self.robot.home[2]

    @property
    def real_time(self) -> tuple[float, float]:
        """Simulated over processor time, and over wall time, of controller and plant together."""
        simulated = self.log.length * PERIOD
        return simulated / max(self.processor, 1e-9), simulated / max(self.wall, 1e-9)

    def settle(self) -> None:
        """Bring the CoG from where it is at home to its place."""
        com = self.session.stack.find("com_xy", Com)

        def path(t: float) -> Vec:
            return self.start + smooth(t / SETTLE) * (self.goal - self.start)

        for i in range(round(SETTLE / PERIOD)):
            self._advance((com.at(path(i * PERIOD), velocity=_rate(path, i * PERIOD)),))
        self.t = 0.0

    def step(self, *references: Reference, **values: Any) -> Tick:
        """One period: measure, control, simulate, log ``values`` beside what every run logs."""
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
        state = self.robot.state(*(self._own if self.feedback == "none" else (self.q, self.v)))
        tick = self.session.step(state, *references)
        self.tick_times.append(time.perf_counter() - began)
        if self.feedback == "none":
            self._own = tick.advance()
        start = self.q[self._places] if self.feedback == "reset" else self.command
        self.command = start + PERIOD * tick.command
        self.plant.step(self.command, rate=tick.command, steps=round(PERIOD / self.plant.timestep))
        self.q, self.v = self.plant.state()
        self.t += PERIOD
        return tick

    def _feet(self) -> np.ndarray[Any, np.dtype[np.float64]]:
        return np.array([self.plant.place(frame)[0] for frame in ("l_sole", "r_sole")])


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

    The log gets ``com_goal`` and ``hand_goal``, where CoG and hand should be at the end of each period.
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


def joint_margin(log: Recorder, robot: Any) -> float:
    """The closest that any main joint came to a limit [rad]."""
    columns = robot.joints("main")
    places = robot.positions(columns)
    q = log["q"][:, places]
    return float(min((q - robot.lower[columns]).min(), (robot.upper[columns] - q).min()))


def torque_share(log: Recorder, robot: Any) -> tuple[float, str]:
    """The largest share of its limit that a main joint's motor used, and which joint."""
    limit = robot.effort_limit[robot.actuated]
    main = set(robot.joints("main").tolist())
    share = np.abs(log["torque"]).max(axis=0) / limit
    share[[column not in main for column in robot.actuated.tolist()]] = 0.0
    worst = int(np.argmax(share))
    return float(share[worst]), robot.joint_names[worst]
