"""Many Gymnasium environments at once: a Batch commands, MuJoCo's threaded rollout moves the worlds."""

from __future__ import annotations

from typing import TYPE_CHECKING, Any

import numpy as np

from hqp.adapters.commanded import Commanded
from hqp.adapters.worlds_env import Fallen, Reward, WorldsEnv
from hqp.arrays import Mat, Vec
from hqp.errors import DeclarationError
from hqp.export.batch import Batch, BatchTick
from hqp.loop.controller import Controller
from hqp.robots import Robot

if TYPE_CHECKING:
    from hqp.robots.actuators import Actuation, Servo


class VectorEnv(WorldsEnv):
    """Actions are offsets of targets from where the elements are at home, observations joint angles, rates and base.

    action = (offset of each target, in the order given) ``(num_envs, n)``, within ``reach`` [m, rad].  robot:
    floating or fixed, joints of one axis.  targets: names of elements whose references are numbers (Position, Com).
    Other arguments: ``WorldsEnv``, which begins at home.  At velocity and acceleration level position servos carry out
    the commands: the base is measured, joints are as commanded; servo: their gains, by default those of the
    ``Plant``.  Raises DeclarationError for another target, and the errors of ``WorldsEnv``.
    """

    def __init__(
        self, controller: Controller, robot: Robot, targets: tuple[str, ...], num_envs: int, *, reach: float = 0.1,
        dt: float = 0.002, frame_skip: int = 10, steps: int = 200, threads: int = 0,
        spread: float = 0.0, servo: Servo | None = None, reward: Reward | None = None, fallen: Fallen | None = None,
    ) -> None:  # fmt: skip
        session = controller.session(robot, dt)
        home = robot.state(robot.home)
        self._homes: dict[str, Vec] = {}
        for name in targets:
            value = np.asarray(session.stack.find(name).hold(home).value, dtype=np.float64)
            if value.ndim != 1:
                raise DeclarationError(f"VectorEnv, {name}", "its reference is not a vector", value=value.shape)
            self._homes[name] = value
        self._batch = Batch(controller, robot, num_envs, dt, threads=threads)
        kind = session.program.kind
        actuation: Actuation = "torque" if kind == "torque" else "position"
        most = np.full(sum(value.size for value in self._homes.values()), reach)
        super().__init__(
            robot, num_envs, -most, most, start=robot.home, dt=dt, frame_skip=frame_skip, steps=steps,
            threads=self._batch.threads, spread=spread, reward=reward, fallen=fallen, actuation=actuation, servo=servo,
        )  # fmt: skip
        self._commanded = None
        if kind != "torque":
            places, order = robot.positions(robot.actuated), controller.formulation.order
            if places is None:
                raise DeclarationError(
                    "VectorEnv", "driven joints of several axes", value=robot.name, allowed="one axis"
                )
            self._commanded = Commanded(num_envs, places, robot.actuated, order, dt)

    def take(self, actions: Mat, over: Any) -> None:
        """Set the targets."""
        at = 0
        self._targets: dict[str, Mat] = {}
        for name, home in self._homes.items():
            self._targets[name] = home + actions[:, at : at + home.size]
            at += home.size

    def tick(self, Q: Mat, V: Mat) -> BatchTick:
        """Step the batch."""
        seen = (Q, V) if self._commanded is None else self._commanded.seen(Q, V)
        return self._batch.step(*seen, self._targets)

    def begin(self, worlds: Any, Q: Mat) -> None:
        """Reset these worlds of the batch."""
        self._batch.reset(np.flatnonzero(worlds))
        if self._commanded is not None:
            self._commanded.begin(worlds, Q)

    def control(self, commands: Mat, worlds: Any) -> Mat:
        """Torques, or targets of the servos that carry out the commands."""
        if self._commanded is None:
            return super().control(commands, worlds)
        assert self._plant.servo is not None
        self._commanded.take(commands, worlds)
        return np.asarray(
            self._commanded.angles[worlds] + self._plant.servo.damping_time * self._commanded.rates[worlds]
        )
