"""Gymnasium environments over sessions: an agent moves targets, the stack keeps balance and limits."""

from __future__ import annotations

from collections.abc import Callable
from typing import Any

import numpy as np

from hqp.adapters.gymnasium_extra import gymnasium
from hqp.adapters.vector_env import VectorEnv
from hqp.adapters.walkers_env import WalkersEnv
from hqp.arrays import Vec
from hqp.declare.stack import Stack
from hqp.loop.session import Controller

__all__ = ["StackEnv", "VectorEnv", "WalkersEnv"]


class StackEnv(gymnasium.Env[Any, Any]):  # type: ignore[misc,unused-ignore]
    """Actions are offsets of a position target from home, observations joint angles, rates and the hand's error.

    stack: with a Position ``target``.  robot: on which it runs.  reach: range of the action, each axis [m].  reward:
    function of (error of the hand [m], action); minus the error by default.  frame_skip: ticks an action is held.
    plant: ``integrator`` or ``mujoco``.  Raises DeclarationError for an unknown target.
    """

    metadata: dict[str, Any] = {"render_modes": []}  # noqa: RUF012  (Gymnasium's own way)

    def __init__(
        self,
        stack: Stack,
        robot: Any,
        target: str,
        *,
        reach: float = 0.3,
        dt: float = 0.002,
        frame_skip: int = 10,
        steps: int = 200,
        plant: str = "integrator",
        reward: Callable[[Vec, Vec], float] | None = None,
    ) -> None:
        from hqp.tasks import Position

        self._task = stack.find(target, Position)
        self._stack, self._robot, self._dt = stack, robot, dt
        self._skip, self._steps, self._plant_name = frame_skip, steps, plant
        self._reward = reward or (lambda error, action: -float(np.linalg.norm(error)))
        rows = len(self._task.axes)
        self.action_space = gymnasium.spaces.Box(-reach, reach, (rows,), np.float32)
        size = 2 * len(robot.joint_names) + rows
        self.observation_space = gymnasium.spaces.Box(-np.inf, np.inf, (size,), np.float32)

    def reset(self, *, seed: int | None = None, options: dict[str, Any] | None = None) -> tuple[Any, dict[str, Any]]:
        """Home at rest; the goal is drawn within half the reach."""
        from hqp.lab.plants import plant

        super().reset(seed=seed)
        session = Controller(self._stack).session(self._robot, self._dt)
        self._session, self._world, self._count = session, plant(self._plant_name, session), 0
        self._start = self._task.value(self._robot.state(*self._world.state()))
        box: Any = self.action_space
        self._goal = self._start + 0.5 * self.np_random.uniform(box.low, box.high)
        return self._observe(), {}

    def step(self, action: Any) -> tuple[Any, float, bool, bool, dict[str, Any]]:
        """Hold the target at home plus action for ``frame_skip`` ticks."""
        target = self._task.at(self._start + np.asarray(action, dtype=np.float64))
        status = ""
        for _ in range(self._skip):
            tick = self._session.step(self._robot.state(*self._world.state()), target)
            self._world.carry_out(tick)
            status = tick.status.name
        self._count += 1
        observation = self._observe()
        error = self._error()
        info = {"status": status, "error": float(np.linalg.norm(error))}
        return observation, self._reward(error, np.asarray(action)), False, self._count >= self._steps, info

    def _error(self) -> Vec:
        return np.asarray(self._goal - self._task.value(self._robot.state(*self._world.state())))

    def _observe(self) -> Any:
        state = self._robot.state(*self._world.state())
        columns = self._robot.actuated
        parts = (state.angles[columns], state.v[columns], self._error())
        return np.concatenate(parts).astype(np.float32)
