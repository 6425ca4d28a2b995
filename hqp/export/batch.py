"""Many worlds of one stack at once, over native threads, for reinforcement learning and sweeps."""

from __future__ import annotations

import os
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from typing import TYPE_CHECKING, Any, TypeAlias

import numpy as np
from numpy.typing import ArrayLike, NDArray

from hqp import dlpack
from hqp.arrays import Mat
from hqp.declare.reference import numbers
from hqp.errors import DeclarationError, HqpError
from hqp.explanation.counters import Counters
from hqp.explanation.notes import STATUSES, Note, of_native
from hqp.export.loaded import ACCELERATION, VALUE, VELOCITY
from hqp.kinds import file_bytes
from hqp.numbers import whole
from hqp.problem import Status

if TYPE_CHECKING:
    from hqp.declare.robot import Robot
    from hqp.declare.stack import Stack
    from hqp.loop.controller import Controller

Targets: TypeAlias = "Mapping[str, ArrayLike | tuple[ArrayLike, ...]]"
"""Values of all worlds ``(count, ...)`` by the element's name, alone or with their velocities and accelerations."""


@dataclass(frozen=True, slots=True)
class BatchTick:
    """Result of one step of all worlds.

    commands ``(count, n_actuated)``, parts of the answers x ``(count, n)``, ||w|| of every level ``(count, levels)``,
    status ``(count,)``: places in ``tuple(hqp.Status)``, later ones are worse.  notes: those of each world, if the step
    was to have them.
    """

    commands: Mat
    x: Mat
    residuals: Mat
    status: NDArray[np.int32]
    notes: tuple[tuple[Note, ...], ...] = ()

    @property
    def solved(self) -> NDArray[np.bool_]:
        """True for worlds with an optimal answer, ``(count,)``."""
        return np.isin(dlpack.numbers(self.status), [k for k, status in enumerate(STATUSES) if status.solved])

    def statuses(self) -> tuple[Status, ...]:
        """Statuses of the worlds, by name."""
        return tuple(STATUSES[k] for k in self.status.tolist())


def chosen_worlds(what: str, worlds: ArrayLike | None, count: int) -> list[int]:
    """Indices of worlds, given by index or mask ``(count,)``, all for None; DeclarationError for an unknown one."""
    chosen = np.arange(count)
    if worlds is not None:
        try:
            picked = np.asarray(dlpack.numbers(worlds))
            if picked.ndim > 1 or (picked.dtype == np.bool_ and picked.shape != (count,)):
                raise IndexError
            chosen = np.atleast_1d(chosen[picked])
        except (IndexError, TypeError, ValueError):
            allowed = f"0 to {count - 1}, or {count} flags"
            raise DeclarationError(what, "worlds", value=worlds, allowed=allowed) from None
    found: list[int] = chosen.tolist()
    return found


class Batch:
    """``count`` sessions of one controller on one robot, stepped together.

    A world keeps the state of a session: hold values, warm start, the last command.  Its numbers depend neither on
    other worlds, nor on the number of threads, nor on time: the controller's deadline does not apply.  threads: 0 for
    one per core.  dt [s].  stacks: by name, for ``change``.  nq, nv, kind (``velocity``, ``acceleration`` or
    ``torque``, the meaning of a command), joint_names of a command and home ``(nq,)`` are those of the plan.  Raises
    the errors of ``Controller.session`` and ``Session.export``, DeclarationError for a bad count.
    """

    def __init__(
        self,
        controller: Controller,
        robot: Robot,
        count: int,
        dt: float = 0.002,
        *,
        threads: int = 0,
        stacks: Mapping[str, Stack] | None = None,
    ) -> None:
        from hqp.loop.file import text

        self._make(text(controller.session(robot, dt), stacks=stacks), count, threads)

    @classmethod
    def load(cls, path: str | os.PathLike[str], count: int, *, threads: int = 0, key: bytes | None = None) -> Batch:
        """Load worlds from a plan's file, without the robot's model; key and errors: see ``hqp.load``."""
        found = object.__new__(cls)
        found._make(file_bytes("Batch", path), count, threads, key)
        return found

    def _make(self, file: bytes, count: int, threads: int, key: bytes | None = None) -> None:
        from hqp import _session as native
        from hqp.loop.file import key_bytes

        count, threads = whole("Batch", "count", count, 1), whole("Batch", "threads", threads, 0)
        secret = key_bytes(key)
        try:
            self._native = native.Batch(file, count, threads, secret)
            one = native.Session(file, b"")
        except (native.PlanError, ValueError) as error:
            raise HqpError(str(error)) from None
        self.count, self.threads = count, self._native.threads
        (self.nq, self.nv), self.kind = self._native.state, self._native.kind
        self.dt, self.joint_names, self.home = one.dt, tuple(one.joint_names), np.array(one.home)

    @property
    def bytes(self) -> int:
        """Memory of all worlds."""
        return self._native.bytes

    @property
    def counters(self) -> Counters:
        """Counters of the ticks of all worlds; longest_gap is 0, because a world has no clock."""
        return Counters(*self._native.counters)

    def step(self, Q: Any, V: Any = None, targets: Targets | None = None, *, notes: bool = False) -> BatchTick:
        """One tick of all worlds for states Q ``(count, nq)`` and V ``(count, nv)``, zero for None.

        targets: values of the elements' references, ``(count, ...)``, for this step; others take their hold values.
        notes: write the notes of each world, which takes time, such as the names of violated rows and passed limits.
        If Q is a torch tensor, so are the parts of the tick, which share memory with arrays of this step (DLPack).
        Data never raises: a world's fault is its own status.  Raises DeclarationError for a shape or an unknown name.
        """
        like = dlpack.first_foreign(Q, V)
        entries: list[tuple[str, int, Mat]] = []
        for name, target in (targets or {}).items():
            parts: Sequence[ArrayLike] = target if isinstance(target, tuple) else (target,)
            for what, part in zip((VALUE, VELOCITY, ACCELERATION), parts, strict=False):
                values = np.ascontiguousarray(dlpack.numbers(part), dtype=np.float64)
                entries.append((name, what, values.reshape(values.shape[0] if values.ndim else 1, -1)))
        at = np.ascontiguousarray(dlpack.numbers(Q), dtype=np.float64)
        speed = (
            np.zeros((self.count, self.nv)) if V is None else np.ascontiguousarray(dlpack.numbers(V), dtype=np.float64)
        )
        commands, x, residuals = (np.empty((self.count, size)) for size in self._native.sizes)
        status = np.empty(self.count, dtype=np.int32)
        try:
            noted = self._native.step(at, speed, entries, commands, status, residuals, x, notes)
        except TypeError:
            raise self._refused(at, speed) from None
        except ValueError as error:
            if at.shape != (self.count, self.nq) or speed.shape != (self.count, self.nv):
                raise self._refused(at, speed) from None
            raise DeclarationError("Batch", str(error)) from None
        commands, x, residuals, status = (dlpack.returned(part, like) for part in (commands, x, residuals, status))
        return BatchTick(commands, x, residuals, status, tuple(of_native(own) for own in noted))

    def begin(self, commands: Any, Q: Any = None, V: Any = None, worlds: ArrayLike | None = None) -> None:
        """Start from the commands ``(count, n_actuated)`` that the robots are sent now; see ``Session.begin``.

        Q ``(count, nq)`` and V ``(count, nv)``, zero for None: states, unknown if Q is None.  worlds: by index or mask
        ``(count,)``, all for None.  Raises DeclarationError for a wrong shape, an unknown world, and a command or a
        state that is not valid.
        """
        count, motors = self.count, len(self.joint_names)
        sent = numbers("begin", "commands", dlpack.numbers(commands), (count, motors))
        at = None if Q is None else numbers("begin", "Q", dlpack.numbers(Q), (count, self.nq))
        speed = numbers("begin", "V", np.zeros((count, self.nv)) if V is None else dlpack.numbers(V), (count, self.nv))
        for world in self._chosen(worlds):
            try:
                self._native.begin(world, sent[world], *((None, None) if at is None else (at[world], speed[world])))
            except ValueError as error:
                raise DeclarationError(f"begin of world {world}", str(error), allowed="finite numbers") from None

    def change(self, stack: str, over: float = 0.0, worlds: ArrayLike | None = None) -> None:
        """Switch to the stack of that name, at once or within ``over`` seconds at least; see ``Session.change``.

        worlds and errors as of ``reset``; raises DeclarationError for an unknown stack or a bad duration, too.  Targets
        of elements that the stack of a world does not have are ignored there.
        """
        for world in self._chosen(worlds):
            try:
                self._native.change(world, stack, over)
            except ValueError as error:
                raise DeclarationError("change", str(error), value=(stack, over)) from None

    def stop(self, worlds: ArrayLike | None = None, reason: str = "stop") -> None:
        """Bring robots to rest and hold them until ``resume`` or ``reset``; worlds and errors as of ``reset``."""
        for world in self._chosen(worlds):
            self._native.stop(world, str(reason))

    def resume(self, worlds: ArrayLike | None = None) -> None:
        """End stops; worlds and errors as of ``reset``."""
        for world in self._chosen(worlds):
            self._native.resume(world)

    def advance(self, Q: Any, V: Any, dt: float | None = None) -> Any:
        """Move Q ``(count, nq)`` with V ``(count, nv)`` for dt [s], the period of the plan for None.

        At velocity level V is ``tick.x[:, :nv]``; at acceleration level it is ``V + dt * tick.x[:, :nv]``.  Raises
        DeclarationError for a wrong shape.
        """
        at, speed = (np.ascontiguousarray(dlpack.numbers(given), dtype=np.float64) for given in (Q, V))
        if at.shape != (self.count, self.nq) or speed.shape != (self.count, self.nv):
            raise self._refused(at, speed)
        moved = np.empty_like(at)
        self._native.integrate(at, speed, self.dt if dt is None else float(dt), moved)
        return dlpack.returned(moved, dlpack.first_foreign(Q, V))

    def _refused(self, at: Mat, speed: Mat) -> DeclarationError:
        allowed = f"Q ({self.count}, {self.nq}), V ({self.count}, {self.nv})"
        return DeclarationError("Batch", "wrong shape of Q or V", value=(at.shape, speed.shape), allowed=allowed)

    def reset(self, worlds: ArrayLike | None = None) -> None:
        """Reset these worlds, by index or mask ``(count,)``, all for None.

        Raises DeclarationError for an unknown world.
        """
        for world in self._chosen(worlds):
            self._native.reset(world)

    def _chosen(self, worlds: ArrayLike | None) -> list[int]:
        return chosen_worlds("Batch", worlds, self.count)
