"""Many walkers of one declaration at once, over native threads."""

from __future__ import annotations

import os
from collections.abc import Sequence
from typing import Any

import numpy as np
from numpy.typing import ArrayLike

from hqp import _session
from hqp.errors import DeclarationError, HqpError
from hqp.explanation.counters import Counters
from hqp.export.batch import BatchTick, chosen_worlds
from hqp.kinds import file_bytes, require
from hqp.loop.file import key_bytes, text
from hqp.numbers import whole
from hqp.walking.footsteps import Command, Foothold, routed
from hqp.walking.walker import PHASES, Walker


class Walkers:
    """``count`` walkers like one, each on a robot of its own, stepped together.

    Each has the numbers of a single ``Walker``, to the last bit.  Neither other walkers nor the number of threads
    change them, and a deadline does not apply.  threads: 0 for one per core.  Raises the errors of
    ``Session.export``, and DeclarationError for a bad count.
    """

    def __init__(self, walker: Walker, count: int, *, threads: int = 0) -> None:
        require("Walkers", "walker", walker, Walker, "a Walker")
        self._make(text(walker.session, more={"walker": walker.tree(walker.robot.copy())}), count, threads, None)

    @classmethod
    def load(cls, path: str | os.PathLike[str], count: int, *, threads: int = 0, key: bytes | None = None) -> Walkers:
        """Load walkers from the file of ``Walker.export``, without the robot's model; key: see ``hqp.load``."""
        found = object.__new__(cls)
        found._make(file_bytes("Walkers", path), count, threads, key)
        return found

    def _make(self, file: bytes, count: int, threads: int, key: bytes | None) -> None:
        count, threads = whole("Walkers", "count", count, 1), whole("Walkers", "threads", threads, 0)
        secret = key_bytes(key)
        try:
            self._native = _session.Walkers(file, count, threads, secret)
        except (_session.PlanError, ValueError) as error:
            raise HqpError(str(error)) from None
        self.count, self.threads = count, self._native.threads

    def go(
        self, forward: ArrayLike = 0.0, left: ArrayLike = 0.0, turn: ArrayLike = 0.0, worlds: ArrayLike | None = None
    ) -> None:
        """Walk, see ``Walker.go``: velocities of all chosen worlds, or one each [m/s, m/s, rad/s].

        worlds: by index or mask ``(count,)``, all for None.  Raises DeclarationError for an unknown world, another
        number of velocities, and one that is not finite.
        """
        chosen = self._chosen(worlds)
        try:
            each = np.broadcast_arrays(np.zeros(len(chosen)), *np.atleast_1d(forward, left, turn))[1:]
        except ValueError:
            shapes = tuple(map(np.shape, (forward, left, turn)))
            raise DeclarationError("go", "velocities", value=shapes, allowed=f"numbers or ({len(chosen)},)") from None
        commands = [Command(*velocity) for velocity in zip(*each, strict=True)]
        for world, command in zip(chosen, commands, strict=True):
            self._native.go(world, command.forward, command.left, command.turn)

    def follow(self, footholds: Sequence[Foothold], worlds: ArrayLike | None = None) -> None:
        """Step on footholds, see ``Walker.follow``, those of all chosen worlds; worlds as of ``go``.

        Raises DeclarationError for an unknown world and as ``Walker.follow``.
        """
        wanted = routed(footholds)
        for world in self._chosen(worlds):
            self._native.follow(world, wanted)

    def stop(self, worlds: ArrayLike | None = None) -> None:
        """Come to stand, see ``Walker.stop``; worlds and errors as of ``go``."""
        for world in self._chosen(worlds):
            self._native.stop(world)

    def halt(self, worlds: ArrayLike | None = None, reason: str = "stop") -> None:
        """End the walks, then hold until ``resume``, as ``walker.session.stop`` does; worlds as of ``go``."""
        for world in self._chosen(worlds):
            self._native.halt(world, str(reason))

    def resume(self, worlds: ArrayLike | None = None) -> None:
        """End halts; worlds and errors as of ``go``."""
        for world in self._chosen(worlds):
            self._native.resume(world)

    def reset(self, worlds: ArrayLike | None = None) -> None:
        """Begin anew; worlds and errors as of ``go``."""
        for world in self._chosen(worlds):
            self._native.reset(world)

    def step(self, Q: ArrayLike, V: ArrayLike, loads: ArrayLike | None = None) -> BatchTick:
        """One tick of all worlds for states Q ``(count, nq)``, V ``(count, nv)``; loads ``(count, 2)`` [N].

        See ``Walker.step``.  Data never raises: a world's fault is its own status.  Raises DeclarationError for a
        shape.
        """
        commands, x, residuals = (np.empty((self.count, size)) for size in self._native.sizes)
        status = np.empty(self.count, dtype=np.int32)
        try:
            at, speed = (np.ascontiguousarray(given, dtype=np.float64) for given in (Q, V))
            felt = None if loads is None else np.ascontiguousarray(loads, dtype=np.float64)
            self._native.step(at, speed, felt, commands, status, residuals, x)
        except (TypeError, ValueError, OverflowError):
            n, (nq, nv) = self.count, self._native.state
            shapes = tuple(getattr(given, "shape", type(given).__name__) for given in (Q, V, loads))
            allowed = f"Q ({n}, {nq}), V ({n}, {nv}), loads ({n}, 2) or None"
            raise DeclarationError("Walkers", "wrong shape", value=shapes, allowed=allowed) from None
        return BatchTick(commands, x, residuals, status)

    @property
    def phases(self) -> tuple[str, ...]:
        """stand, shift or swing, of each world."""
        return tuple(PHASES[phase] for phase in self._native.phases)

    @property
    def supports(self) -> tuple[str, ...]:
        """The feet that stand in each world: both, left or right."""
        return tuple(self._native.supports)

    @property
    def commands(self) -> tuple[Command, ...]:
        """Velocities that are followed."""
        return tuple(Command(*velocity) for velocity in self._native.velocities)

    @property
    def counters(self) -> Counters:
        """Counters of the ticks of all worlds."""
        return Counters(*self._native.counters)

    def why(self, world: int) -> tuple[str, ...]:
        """Reasons for each difference of a world's command from its latest ``go`` or ``follow``."""
        return tuple(self._native.why(whole("Walkers", "world", world, 0, self.count - 1)))

    def _chosen(self, worlds: Any) -> list[int]:
        return chosen_worlds("Walkers", worlds, self.count)
