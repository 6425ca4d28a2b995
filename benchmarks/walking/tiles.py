"""Ground of square tiles at random heights, which no walker knows of."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from hqp.robots.on_mujoco import Plane
from hqp.robots.terrain import Slab


@dataclass(frozen=True, kw_only=True)
class Tiles(Plane):
    """Tiles whose tops are ``rise`` above or below those at the start, at most [m]; the start is at ``rise``.

    start: x where they begin [m].  size: of a tile [m].  length, width: of the field [m].
    """

    rise: float = 0.02
    start: float = 0.25
    size: float = 0.4
    length: float = 2.8
    width: float = 2.4
    seed: int = 0

    def slabs(self) -> tuple[Slab, ...]:
        rng = np.random.default_rng(self.seed)
        half, found = 0.5 * self.size, []
        found.append(Slab((self.start - 1.5, 0.0, self.rise - 0.5), (1.5, self.width, 0.5), 0.0))
        for x in np.arange(self.start + half, self.start + self.length, self.size).tolist():
            for y in np.arange(half - 0.5 * self.width, 0.5 * self.width, self.size).tolist():
                top = self.rise * float(rng.uniform(0.0, 2.0))
                found.append(Slab((x, y, top - 0.5), (half, half, 0.5), 0.0))
        return tuple(found)

    def height(self, x: float) -> float:
        return self.rise
