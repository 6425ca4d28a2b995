"""An action term of Isaac Lab over a Batch: actions are targets of a plan's elements, joints follow its commands.

The term takes the place of ``DifferentialInverseKinematicsAction`` in an ActionsCfg.  Without Isaac Lab the module has
the same two classes over a base of the same members, for tests and for other simulators with its interface.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, field
from typing import TYPE_CHECKING, Any, Literal

import numpy as np

from hqp.adapters.commanded import Commanded
from hqp.arrays import Vec
from hqp.errors import DeclarationError
from hqp.export.batch import Batch
from hqp.export.loaded import load
from hqp.state_map import StateMap

if TYPE_CHECKING:
    _Term: Any = object
    _TermCfg: Any = object
    configured: Any = dataclass
else:
    try:
        from isaaclab.managers import ActionTerm as _Term
        from isaaclab.managers import ActionTermCfg as _TermCfg
        from isaaclab.utils import configclass as configured
    except ImportError:
        configured = dataclass

        @dataclass
        class _TermCfg:
            """The members of Isaac Lab's ActionTermCfg that the term reads."""

            asset_name: str = "robot"

        class _Term:
            """The members of Isaac Lab's ActionTerm that the term uses."""

            def __init__(self, cfg: Any, env: Any) -> None:
                self.cfg, self._env = cfg, env
                self._asset = env.scene[cfg.asset_name]
                self.num_envs, self.device = env.num_envs, env.device


class DifferentialIKAction(_Term):  # type: ignore[misc,unused-ignore]
    """Targets of a plan's elements in ``cfg.num_envs`` worlds, on the CPU.

    action = scale times the offset of each target from where its element is held after a reset, in the order of
    ``cfg.targets``, ``(num_envs, n)`` [m, rad].  A plan for velocities or accelerations sends positions and rates,
    integrated from its own commands; a plan for torques sends efforts.  One tick is solved for each step of the
    simulation; ``status`` ``(num_envs,)`` has the places of the last ones in ``tuple(hqp.Status)``.

    Raises HqpError for a bad plan, JointNotFound for a joint that the asset lacks, DeclarationError for a target whose
    reference is not a vector, or for a period of the simulation other than the plan's.
    """

    def __init__(self, cfg: DifferentialIKActionCfg, env: Any) -> None:
        import torch  # pyright: ignore[reportMissingImports]

        super().__init__(cfg, env)
        self._batch = batch = Batch.load(cfg.plan, self.num_envs, threads=cfg.threads)
        period = float(env.sim.get_physics_dt())
        if abs(period - batch.dt) > 1e-9:
            raise DeclarationError(
                "DifferentialIKAction",
                "period of the simulation",
                value=period,
                unit="s",
                allowed=f"{batch.dt:g}, the plan's",
            )
        names = list(self._asset.joint_names)
        known: Any = batch
        if cfg.robot:
            from hqp import robots

            known = robots.load(cfg.robot, floating=batch.nq - batch.nv == 1)
        self._map = StateMap(known, names, quaternion=cfg.quaternion, linear="world", angular="world")
        self._ids, _ = self._asset.find_joints(list(batch.joint_names), preserve_order=True)
        order = 1 if batch.kind == "velocity" else 2
        self._commanded = Commanded(self.num_envs, self._map.driven[0], self._map.driven[1], order, batch.dt)
        self._one = load(cfg.plan)  # hold values of one world at a time
        self._one.step(self._one.home)
        self._start = {name: np.tile(self._vector(name), (self.num_envs, 1)) for name in cfg.targets}
        self._ends = np.cumsum([0, *(start.shape[1] for start in self._start.values())])
        self._raw = torch.zeros(self.num_envs, int(self._ends[-1]), device=self.device)
        self._processed = torch.zeros_like(self._raw)
        self._fresh = np.ones(self.num_envs, dtype=bool)
        self.status = np.zeros(self.num_envs, dtype=np.int32)

    @property
    def action_dim(self) -> int:
        """Numbers of an action of one world."""
        return int(self._ends[-1])

    @property
    def raw_actions(self) -> Any:
        """The latest action ``(num_envs, action_dim)``."""
        return self._raw

    @property
    def processed_actions(self) -> Any:
        """Offsets of the targets [m, rad], ``(num_envs, action_dim)``."""
        return self._processed

    def process_actions(self, actions: Any) -> None:
        """Keep an action until the next one."""
        self._raw[:] = actions
        self._processed[:] = self._raw * self.cfg.scale

    def apply_actions(self) -> None:
        """Solve one tick of all worlds and set the joints' targets."""
        Q, V = self._state()
        torques = self._batch.kind == "torque"
        fresh = np.flatnonzero(self._fresh)
        self._batch.reset(fresh)
        self._commanded.begin(fresh, Q)
        seen = (Q, V) if torques else self._commanded.seen(Q, V)
        for world in fresh.tolist():
            self._one.reset()
            self._one.step(seen[0][world], seen[1][world])
            for name, start in self._start.items():
                start[world] = self._one.held(name)
        self._fresh[:] = False
        offsets = self._processed.detach().cpu().numpy().astype(np.float64)
        targets = {
            name: start + offsets[:, a:b]
            for (name, start), a, b in zip(self._start.items(), self._ends[:-1], self._ends[1:], strict=True)
        }
        tick = self._batch.step(seen[0], seen[1], targets)
        self.status = tick.status
        if torques:
            self._send("effort", tick.commands)
            return
        self._commanded.take(tick.commands, np.arange(self.num_envs))
        self._send("position", self._commanded.angles)
        self._send("velocity", self._commanded.rates)

    def reset(self, env_ids: Any = None) -> None:
        """Hold the elements anew in these worlds, where their next states are; in all for None."""
        chosen: Any = slice(None) if env_ids is None else env_ids
        self._raw[chosen], self._processed[chosen] = 0.0, 0.0
        self._fresh[chosen.cpu().numpy() if hasattr(chosen, "cpu") else chosen] = True

    def _state(self) -> tuple[Any, Any]:
        """Measured states of all worlds, places without the worlds' origins."""
        data = self._asset.data
        read = {
            name: _numbers(getattr(data, name))
            for name in ("joint_pos", "joint_vel", "root_pos_w", "root_quat_w", "root_lin_vel_w", "root_ang_vel_w")
        }
        return self._map.state(
            read["joint_pos"], read["joint_vel"], place=read["root_pos_w"] - _numbers(self._env.scene.env_origins),
            quaternion=read["root_quat_w"], linear=read["root_lin_vel_w"], angular=read["root_ang_vel_w"],
        )  # fmt: skip

    def _vector(self, name: str) -> Vec:
        """Hold value of an element, refused for a rotation or a pose: an offset added to its matrix is none."""
        value = self._one.held(name)
        side = {9: 3, 16: 4}.get(value.size)
        turn = None if side is None else value.reshape(side, side)[:3, :3]
        if turn is not None and np.allclose(turn @ turn.T, np.eye(3)):
            raise DeclarationError(
                f"DifferentialIKAction, {name}",
                "its reference is a matrix",
                value=(side, side),
                allowed="vectors, as of Position",
            )
        return value

    def _send(self, what: Literal["position", "velocity", "effort"], values: Any) -> None:
        import torch  # pyright: ignore[reportMissingImports]

        target = torch.as_tensor(np.array(values), dtype=self._raw.dtype, device=self.device)
        getattr(self._asset, f"set_joint_{what}_target")(target, joint_ids=self._ids)


def _numbers(given: Any) -> Any:
    """Numbers of a tensor on any device; newer releases wrap tensors, with ``.torch``."""
    tensor = getattr(given, "torch", given)
    return tensor.detach().cpu().numpy().astype(np.float64)


@configured
class DifferentialIKActionCfg(_TermCfg):  # type: ignore[misc,unused-ignore]
    """Configuration of DifferentialIKAction.

    plan: path of an exported session; its robot has the asset's joint names.  robot: its name or file, needed if it
    has joints that no motor drives.  targets: names of elements whose
    references are vectors (Position, Com).  scale: of an action.  quaternion: order of the asset's quaternions: Isaac
    Lab 2 has ``wxyz``, 3 ``xyzw``.  threads: 0 for all cores.
    """

    class_type: type = DifferentialIKAction
    plan: str = ""
    robot: str = ""
    targets: Sequence[str] = field(default_factory=tuple)
    scale: float = 1.0
    quaternion: Literal["xyzw", "wxyz"] = "wxyz"
    threads: int = 0
