"""A batch of walkers as a Gymnasium vector environment: an agent commands velocities."""

from __future__ import annotations

from typing import Any

import numpy as np

from hqp.adapters.worlds_env import Fallen, Reward, WorldsEnv
from hqp.arrays import Mat
from hqp.export.batch import BatchTick
from hqp.walking import Walker, Walkers


class WalkersEnv(WorldsEnv):
    """Actions are velocities ahead, to the left and of turning ``(num_envs, 3)`` [m/s, m/s, rad/s]; zeros stand.

    fastest: largest absolute values of an action.  Other arguments: ``WorldsEnv``, which begins at ``walker.start``
    with the walker's period.  Feet land by time.  Raises the errors of ``Walkers`` and ``WorldsEnv``.
    """

    def __init__(
        self, walker: Walker, num_envs: int, *, fastest: tuple[float, float, float] = (0.3, 0.1, 0.3),
        frame_skip: int = 10, steps: int = 500, threads: int = 0, spread: float = 0.0, reward: Reward | None = None,
        fallen: Fallen | None = None,
    ) -> None:  # fmt: skip
        self._walkers = Walkers(walker, num_envs, threads=threads)
        most = np.array(fastest, dtype=np.float64)
        super().__init__(
            walker.robot, num_envs, -most, most, start=walker.start, dt=walker.dt, frame_skip=frame_skip, steps=steps,
            threads=self._walkers.threads, spread=spread, reward=reward, fallen=fallen,
        )  # fmt: skip

    def take(self, actions: Mat, over: Any) -> None:
        """Command the velocities."""
        moves = actions.any(axis=1)
        if moves.any():
            forward, left, turn = actions[moves].T
            self._walkers.go(forward, left, turn, moves)
        if not moves.all():
            self._walkers.stop(~moves)

    def tick(self, Q: Mat, V: Mat) -> BatchTick:
        """Step the walkers."""
        return self._walkers.step(Q, V)

    def begin(self, worlds: Any, Q: Mat) -> None:
        """Reset these walkers."""
        self._walkers.reset(worlds)
