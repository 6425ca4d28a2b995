"""Many filters of one declaration at once, over native threads."""

from __future__ import annotations

import os

import numpy as np
from numpy.typing import ArrayLike

from hqp import _session, dlpack
from hqp.errors import DeclarationError, HqpError
from hqp.explanation.counters import Counters
from hqp.export.batch import BatchTick, chosen_worlds
from hqp.kinds import file_bytes
from hqp.loop.file import key_bytes, text
from hqp.numbers import whole
from hqp.policies.policy_filter import PolicyFilterSession


class PolicyFilters:
    """``count`` filters like one, each of a robot of its own, stepped together.

    Each has the numbers of a single filter, to the last bit.  Neither other worlds nor the number of threads change
    them, and a deadline does not apply.  threads: 0 for one per core.  Raises the errors of ``Session.export``, and
    DeclarationError for a bad count.
    """

    def __init__(self, session: PolicyFilterSession, count: int, *, threads: int = 0) -> None:
        self._make(text(session.session, more=session.parts()), count, threads, None)

    @classmethod
    def load(
        cls, path: str | os.PathLike[str], count: int, *, threads: int = 0, key: bytes | None = None
    ) -> PolicyFilters:
        """Load filters from the file of ``PolicyFilterSession.export``, without the robot's model.

        key: see ``hqp.load``.
        """
        found = object.__new__(cls)
        found._make(file_bytes("PolicyFilters", path), count, threads, key)
        return found

    def _make(self, file: bytes, count: int, threads: int, key: bytes | None) -> None:
        count, threads = whole("PolicyFilters", "count", count, 1), whole("PolicyFilters", "threads", threads, 0)
        try:
            self._native = _session.Filters(file, count, threads, key_bytes(key))
        except (_session.PlanError, ValueError) as error:
            raise HqpError(str(error)) from None
        self.count, self.threads = count, self._native.threads

    def step(self, Q: ArrayLike, V: ArrayLike, commands: ArrayLike) -> BatchTick:
        """One tick of all worlds: states Q ``(count, nq)``, V ``(count, nv)``, commands of the policy ``(count, n)``.

        ``commands`` of the result are to be sent; see ``PolicyFilterSession.tick``.  For torch tensors on the CPU the
        result has tensors, without gradients.  Data never raises: a world's fault is its own status.  Raises
        DeclarationError for a shape.
        """
        given = (Q, V, commands)
        at, speed, policy = (np.ascontiguousarray(dlpack.numbers(part), dtype=np.float64) for part in given)
        sent, x, residuals = (np.empty((self.count, size)) for size in self._native.sizes)
        status = np.empty(self.count, dtype=np.int32)
        try:
            self._native.step(at, speed, policy, sent, status, residuals, x)
        except (TypeError, ValueError):
            n, (nq, nv), motors = self.count, self._native.state, self._native.sizes[0]
            allowed = f"Q ({n}, {nq}), V ({n}, {nv}), commands ({n}, {motors})"
            shapes = at.shape, speed.shape, policy.shape
            raise DeclarationError("PolicyFilters", "wrong shape", value=shapes, allowed=allowed) from None
        like = dlpack.first_foreign(*given)
        return BatchTick(*(dlpack.returned(part, like) for part in (sent, x, residuals, status)))

    def stop(self, worlds: ArrayLike | None = None, reason: str = "stop") -> None:
        """Bring robots to rest until ``resume``; worlds: by index or mask ``(count,)``, all for None.

        Raises DeclarationError for an unknown world.
        """
        for world in chosen_worlds("PolicyFilters", worlds, self.count):
            self._native.stop(world, str(reason))

    def resume(self, worlds: ArrayLike | None = None) -> None:
        """End stops; worlds and errors as of ``stop``."""
        for world in chosen_worlds("PolicyFilters", worlds, self.count):
            self._native.resume(world)

    def reset(self, worlds: ArrayLike | None = None) -> None:
        """Begin anew; worlds and errors as of ``stop``."""
        for world in chosen_worlds("PolicyFilters", worlds, self.count):
            self._native.reset(world)

    @property
    def counters(self) -> Counters:
        """Counters of the ticks of all worlds."""
        return Counters(*self._native.counters)
