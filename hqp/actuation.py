"""Whether constraints and actuators determine the motion: ranks of [J_constr; U] (Sentis 2012, after eq. 12)."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from hqp.arrays import Index, Mat
from hqp.dynamics import RANK_TOLERANCE


@dataclass(frozen=True, slots=True)
class Actuation:
    """Whether constraints and actuators together determine every motion: rank [J_constr; U] = nv (after eq. 12).

    rank: of J.  smallest: its least non-zero singular value over the largest.  full_rank: of [J; U].
    full_smallest: least singular value of [J; U], zero where the rank is short.
    """

    rows: int
    rank: int
    smallest: float
    full_rank: int
    full_smallest: float
    nv: int

    @property
    def complete(self) -> bool:
        """Whether the rank of [J; U] is full, so that qd follows from the actuated velocities alone (eq. 13)."""
        return self.full_rank == self.nv

    def __str__(self) -> str:
        return (
            f"rank J_constr = {self.rank} of {self.rows} rows (least singular value {self.smallest:.2g} of the "
            f"largest), rank [J_constr; U] = {self.full_rank} of {self.nv} (least {self.full_smallest:.2g})"
        )


def actuation(J: Mat, actuated: Index, tolerance: float = RANK_TOLERANCE) -> Actuation:
    """Ranks and conditioning of J ``(m, nv)`` and [J; U]; as many rows as unactuated coordinates do not suffice."""
    m, nv = J.shape
    U = np.zeros((actuated.size, nv))
    U[np.arange(actuated.size), actuated] = 1.0
    own = np.linalg.svd(J, compute_uv=False) if m else np.zeros(0)
    both = np.linalg.svd(np.vstack((J, U)), compute_uv=False)
    rank = int(np.count_nonzero(own > tolerance * own.max(initial=0.0)))
    full = int(np.count_nonzero(both > tolerance * both.max(initial=0.0)))
    least = float(own[rank - 1] / own[0]) if rank else 0.0
    return Actuation(m, rank, least, full, float(both[-1]) if full == nv and both.size >= nv else 0.0, nv)
