"""Worlds of one robot that MuJoCo's threaded rollout moves, as a Gymnasium vector environment without commands."""

from __future__ import annotations

from collections.abc import Callable, Mapping
from typing import TYPE_CHECKING, Any

import numpy as np

from hqp.adapters.gymnasium_extra import gymnasium
from hqp.arrays import Mat, Vec
from hqp.errors import HqpError
from hqp.export.batch import BatchTick
from hqp.numbers import whole
from hqp.robots import Robot

if TYPE_CHECKING:
    from hqp.robots.actuators import Actuation, Servo

Reward = Callable[[Mat, Mat, Mat], Vec]
Fallen = Callable[[Mat, Mat], Any]


def _metadata() -> dict[str, Any]:
    """Worlds that end are reset in the next step; gymnasium 1.0 does nothing else and has no name for it."""
    modes = getattr(gymnasium.vector, "AutoresetMode", None)
    return {"autoreset_mode": modes.NEXT_STEP} if modes else {}


class WorldsEnv(gymnasium.vector.VectorEnv):  # type: ignore[misc,unused-ignore]
    """Observations are q and v ``(num_envs, nq + nv)``; a subclass has ``take``, ``tick`` and ``begin``.

    low, high: bounds of an action ``(n,)``.  dt: period of a tick and a step of MuJoCo [s]; an action is held for
    ``frame_skip`` ticks, an episode ends after ``steps`` actions.  start ``(nq,)``: configuration of a new world,
    joints up to ``spread`` [rad] off it.  reward: function of (q, v, action), ``(num_envs,)``; 0 by default.  fallen:
    function of (q, v) with the mask of worlds that end; by default with a base 0.2 m lower than at the start, or a
    state that is not finite.  The info's status is the worst of the action's ticks.  Raises DeclarationError for a bad
    frame_skip, HqpError before gymnasium 1.0.
    """

    metadata: dict[str, Any] = _metadata()

    def __init__(
        self, robot: Robot, num_envs: int, low: Vec, high: Vec, *, start: Vec, dt: float, frame_skip: int, steps: int,
        threads: int, spread: float, reward: Reward | None, fallen: Fallen | None, actuation: Actuation = "torque",
        servo: Servo | None = None,
    ) -> None:  # fmt: skip
        from mujoco import rollout

        from hqp.robots import Plant

        if int(gymnasium.__version__.split(".")[0]) < 1:
            here = gymnasium.__version__
            raise HqpError(
                f"{type(self).__name__} needs gymnasium 1.0 or later, here is {here}: pip install 'hqp[gym]'"
            )
        owner = type(self).__name__
        self.num_envs, self._steps = num_envs, steps
        self._skip = whole(owner, "frame_skip", frame_skip, 1)
        self._robot, self._start, self._spread = robot, start, spread
        self._plant = Plant(robot, timestep=dt, actuation=actuation, servo=servo)
        self._reward = reward or (lambda q, v, action: np.zeros(num_envs))
        self._fallen = fallen or self._lower
        self.single_action_space = gymnasium.spaces.Box(low.astype(np.float32), high.astype(np.float32))
        self.single_observation_space = gymnasium.spaces.Box(-np.inf, np.inf, (robot.nq + robot.nv,), np.float32)
        self.action_space = gymnasium.vector.utils.batch_space(self.single_action_space, num_envs)
        self.observation_space = gymnasium.vector.utils.batch_space(self.single_observation_space, num_envs)
        self._rollout = rollout.Rollout(nthread=threads)
        self._data = [type(self._plant.data)(self._plant.model) for _ in range(threads)]
        self._order = self._motors()

    def take(self, actions: Mat, over: Any) -> None:
        """Hold the actions from now on; over: mask of the worlds that begin anew, with the action zero."""
        raise NotImplementedError

    def tick(self, Q: Mat, V: Mat) -> BatchTick:
        """One tick of all worlds."""
        raise NotImplementedError

    def begin(self, worlds: Any, Q: Mat) -> None:
        """Begin anew in the worlds of a mask, at these configurations of all worlds."""
        raise NotImplementedError

    def control(self, commands: Mat, worlds: Any) -> Mat:
        """Numbers for the motors of these worlds."""
        return np.asarray(commands[worlds])

    def reset(
        self, *, seed: int | list[int] | None = None, options: Mapping[str, Any] | None = None
    ) -> tuple[Any, dict[str, Any]]:
        """All worlds at the start; ``options={"reset_mask": (num_envs,)}`` for some."""
        super().reset(seed=seed if isinstance(seed, int) else None)
        mask = (options or {}).get("reset_mask")
        if mask is None:
            self._Q = np.tile(self._start, (self.num_envs, 1))
            self._V = np.zeros((self.num_envs, self._robot.nv))
            self._count = np.zeros(self.num_envs, dtype=int)
            self._over = np.zeros(self.num_envs, dtype=bool)
        self._begin(np.ones(self.num_envs, dtype=bool) if mask is None else np.asarray(mask, dtype=bool))
        return self._observe(), {}

    def step(self, actions: Any) -> tuple[Any, Any, Any, Any, dict[str, Any]]:
        """Hold the actions for ``frame_skip`` ticks; a world that ended begins anew instead."""
        numbers, over = np.asarray(actions, dtype=np.float64), self._over.copy()
        self._begin(over)
        self.take(np.where(over[:, None], 0.0, numbers), over)
        status = np.zeros(self.num_envs, dtype=np.int32)
        for _ in range(self._skip):
            tick = self.tick(self._Q, self._V)
            status = np.maximum(status, tick.status)  # the worst of the ticks
            self._advance(tick.commands, ~over)
        self._count[~over] += 1
        fallen = np.asarray(self._fallen(self._Q, self._V), dtype=bool) & ~over
        late = (self._count >= self._steps) & ~over
        self._over = fallen | late
        reward = np.where(over, 0.0, self._reward(self._Q, self._V, numbers))
        return self._observe(), reward, fallen, late, {"status": status}

    def _begin(self, worlds: Any) -> None:
        if not worlds.any():
            return
        columns = self._robot.actuated
        for world in np.flatnonzero(worlds):
            off = np.zeros(self._robot.nv)
            off[columns] = self.np_random.uniform(-self._spread, self._spread, len(columns))
            self._Q[world] = self._robot.integrate(self._start, off, 1.0)
        self._V[worlds] = 0.0
        self._count[worlds] = 0
        self.begin(worlds, self._Q)

    def _motors(self) -> Any:
        """The motor of each joint of a command."""
        model = self._plant.model
        driven = [model.joint(int(joint)).name for joint in model.actuator_trnid[:, 0]]
        return np.array([driven.index(name) for name in self._plant.joint_names])

    def _advance(self, commands: Mat, worlds: Any) -> None:
        """One step of MuJoCo in these worlds."""
        model, chosen = self._plant.model, np.flatnonzero(worlds)
        if not chosen.size:
            return
        states = np.zeros((chosen.size, 1 + model.nq + model.nv + model.na))
        control = np.zeros((chosen.size, 1, model.nu))
        control[:, 0, self._order] = self.control(commands, chosen)
        for k, world in enumerate(chosen):
            qpos, qvel = self._plant.map.to_mujoco(self._Q[world], self._V[world])
            states[k, 1 : 1 + model.nq] = qpos
            states[k, 1 + model.nq : 1 + model.nq + model.nv] = qvel
        found: Any = self._rollout.rollout([model] * chosen.size, self._data, states, control, skip_checks=False)[0]
        for k, world in enumerate(chosen):
            now = found[k, -1]
            self._Q[world], self._V[world] = self._plant.map.to_pinocchio(
                now[1 : 1 + model.nq], now[1 + model.nq : 1 + model.nq + model.nv]
            )

    def _lower(self, q: Mat, v: Mat) -> Any:
        bad = ~np.isfinite(q).all(axis=1) | ~np.isfinite(v).all(axis=1)
        return bad | (q[:, 2] < self._start[2] - 0.2) if self._robot.floating else bad

    def _observe(self) -> Any:
        return np.concatenate((self._Q, self._V), axis=1).astype(np.float32)

    def close_extras(self, **_: Any) -> None:
        """End MuJoCo's threads."""
        self._rollout.close()
