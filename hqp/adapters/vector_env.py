"""Many Gymnasium environments at once: a Batch commands, MuJoCo's threaded rollout moves the worlds."""

from __future__ import annotations

from collections.abc import Callable, Mapping
from typing import TYPE_CHECKING, Any

import numpy as np

from hqp.adapters.commanded import Commanded
from hqp.adapters.gymnasium_extra import gymnasium
from hqp.arrays import Mat, Vec
from hqp.errors import DeclarationError, HqpError
from hqp.export.batch import Batch
from hqp.loop.controller import Controller
from hqp.robots import Robot

if TYPE_CHECKING:
    from hqp.robots.actuators import Actuation, Servo


def _metadata() -> dict[str, Any]:
    """Worlds that end are reset in the next step; gymnasium 1.0 does nothing else and has no name for it."""
    modes = getattr(gymnasium.vector, "AutoresetMode", None)
    return {"autoreset_mode": modes.NEXT_STEP} if modes else {}


class VectorEnv(gymnasium.vector.VectorEnv):  # type: ignore[misc,unused-ignore]
    """Actions are offsets of targets from where the elements are at home, observations joint angles, rates and base.

    action = (offset of each target, in the order given) ``(num_envs, n)``, within ``reach`` [m, rad]; observation
    ``(num_envs, nq + nv)``: q and v.  robot: floating or fixed, joints of one axis.
    targets: names of elements whose references are numbers (Position, Com).  dt: period of a tick and a step of MuJoCo
    [s]; an action is held for ``frame_skip`` ticks.  spread: spread of the joints at the start of a world [rad].
    reward: function of (q, v, action), ``(num_envs,)``; 0 by default.  fallen: function of (q, v) with the mask of
    worlds that end; by default with a base 0.2 m lower than at home, or a state that is not finite.  The info's status
    is the worst of those ticks.  At velocity and acceleration level position servos carry out the commands: the base
    is measured, joints are as commanded; servo: their gains, by default those of the robot's description.  Raises
    DeclarationError for another target, a bad frame_skip, or servos without gains; HqpError before gymnasium 1.0.
    """

    metadata: dict[str, Any] = _metadata()

    def __init__(
        self, controller: Controller, robot: Robot, targets: tuple[str, ...], num_envs: int, *, reach: float = 0.1,
        dt: float = 0.002, frame_skip: int = 10, steps: int = 200, threads: int = 0,
        spread: float = 0.0, servo: Servo | None = None,
        reward: Callable[[Mat, Mat, Mat], Vec] | None = None, fallen: Callable[[Mat, Mat], Any] | None = None,
    ) -> None:  # fmt: skip
        from mujoco import rollout

        from hqp.robots import Plant

        session = controller.session(robot, dt)
        if int(gymnasium.__version__.split(".")[0]) < 1:
            here = gymnasium.__version__
            raise HqpError(f"VectorEnv needs gymnasium 1.0 or later, here is {here}: pip install 'hqp[gym]'")
        if isinstance(frame_skip, bool) or not isinstance(frame_skip, int) or frame_skip < 1:
            raise DeclarationError("VectorEnv", "frame_skip", value=frame_skip, allowed="a whole number, 1 or above")
        home = robot.state(robot.home)
        self._start: dict[str, Vec] = {}
        for name in targets:
            value = np.asarray(session.stack.find(name).hold(home).value, dtype=np.float64)
            if value.ndim != 1:
                raise DeclarationError(f"VectorEnv, {name}", "its reference is not a vector", value=value.shape)
            self._start[name] = value
        self.num_envs, self._skip, self._steps = num_envs, frame_skip, steps
        self._spread = spread
        self._batch = Batch(controller, robot, num_envs, dt, threads=threads)
        kind = session.program.kind
        actuation: Actuation = "torque" if kind == "torque" else "position"
        self._plant, self._robot = Plant(robot, timestep=dt, actuation=actuation, servo=servo), robot
        self._commanded = None
        if kind != "torque":
            places, order = robot.positions(robot.actuated), controller.formulation.order
            if places is None:
                raise DeclarationError(
                    "VectorEnv", "driven joints of several axes", value=robot.name, allowed="one axis"
                )
            self._commanded = Commanded(num_envs, places, robot.actuated, order, dt)
        self._reward = reward or (lambda q, v, action: np.zeros(num_envs))
        self._fallen = fallen or self._lower
        size = sum(value.size for value in self._start.values())
        self.single_action_space = gymnasium.spaces.Box(-reach, reach, (size,), np.float32)
        self.single_observation_space = gymnasium.spaces.Box(-np.inf, np.inf, (robot.nq + robot.nv,), np.float32)
        self.action_space = gymnasium.vector.utils.batch_space(self.single_action_space, num_envs)
        self.observation_space = gymnasium.vector.utils.batch_space(self.single_observation_space, num_envs)
        self._rollout = rollout.Rollout(nthread=self._batch.threads)
        self._data = [type(self._plant.data)(self._plant.model) for _ in range(self._batch.threads)]
        self._order = self._motors()

    def reset(
        self, *, seed: int | list[int] | None = None, options: Mapping[str, Any] | None = None
    ) -> tuple[Any, dict[str, Any]]:
        """All worlds at home, joints up to ``spread`` off it; ``options={"reset_mask": (num_envs,)}`` for some."""
        super().reset(seed=seed if isinstance(seed, int) else None)
        mask = (options or {}).get("reset_mask")
        if mask is None:
            self._Q = np.tile(self._robot.home, (self.num_envs, 1))
            self._V = np.zeros((self.num_envs, self._robot.nv))
            self._count = np.zeros(self.num_envs, dtype=int)
            self._over = np.zeros(self.num_envs, dtype=bool)
        self._begin(np.ones(self.num_envs, dtype=bool) if mask is None else np.asarray(mask, dtype=bool))
        return self._observe(), {}

    def step(self, actions: Any) -> tuple[Any, Any, Any, Any, dict[str, Any]]:
        """Hold the targets for ``frame_skip`` ticks; a world that ended begins anew instead."""
        offsets, over = np.asarray(actions, dtype=np.float64), self._over.copy()
        self._begin(over)
        targets, at = {}, 0
        for name, start in self._start.items():
            targets[name] = start + np.where(over[:, None], 0.0, offsets[:, at : at + start.size])
            at += start.size
        status = np.zeros(self.num_envs, dtype=np.int32)
        for _ in range(self._skip):
            seen = (self._Q, self._V) if self._commanded is None else self._commanded.seen(self._Q, self._V)
            tick = self._batch.step(*seen, targets)
            status = np.maximum(status, tick.status)  # the worst of the ticks
            self._advance(tick.commands, ~over)
        self._count[~over] += 1
        fallen = np.asarray(self._fallen(self._Q, self._V), dtype=bool) & ~over
        late = (self._count >= self._steps) & ~over
        self._over = fallen | late
        reward = np.where(over, 0.0, self._reward(self._Q, self._V, offsets))
        return self._observe(), reward, fallen, late, {"status": status}

    def _begin(self, worlds: Any) -> None:
        if not worlds.any():
            return
        self._batch.reset(np.flatnonzero(worlds))
        columns = self._robot.actuated
        for world in np.flatnonzero(worlds):
            off = np.zeros(self._robot.nv)
            off[columns] = self.np_random.uniform(-self._spread, self._spread, len(columns))
            self._Q[world] = self._robot.integrate(self._robot.home, off, 1.0)
        self._V[worlds] = 0.0
        self._count[worlds] = 0
        if self._commanded is not None:
            self._commanded.begin(worlds, self._Q)

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
        control[:, 0, self._order] = commands[chosen] if self._commanded is None else self._servos(commands, chosen)
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

    def _servos(self, commands: Mat, worlds: Any) -> Mat:
        """Carry out commands in these worlds; return the targets sent to their servos."""
        assert self._commanded is not None
        assert self._plant.servo is not None
        self._commanded.take(commands, worlds)
        return np.asarray(
            self._commanded.angles[worlds] + self._plant.servo.damping_time * self._commanded.rates[worlds]
        )

    def _lower(self, q: Mat, v: Mat) -> Any:
        bad = ~np.isfinite(q).all(axis=1) | ~np.isfinite(v).all(axis=1)
        return bad | (q[:, 2] < self._robot.home[2] - 0.2) if self._robot.floating else bad

    def _observe(self) -> Any:
        return np.concatenate((self._Q, self._V), axis=1).astype(np.float32)

    def close_extras(self, **_: Any) -> None:
        """End MuJoCo's threads."""
        self._rollout.close()
