"""Geoms of a MuJoCo model that can touch others: by their bits, or by a contact pair of the file."""

from __future__ import annotations

from typing import Any

import numpy as np
from numpy.typing import NDArray


def touching(simulated: Any) -> NDArray[np.bool_]:
    """True for each geom of a MjModel that can touch another ``(ngeom,)``."""
    found: NDArray[np.bool_] = (np.asarray(simulated.geom_contype) != 0) | (np.asarray(simulated.geom_conaffinity) != 0)
    found[np.asarray(simulated.pair_geom1, dtype=np.intp)] = True
    found[np.asarray(simulated.pair_geom2, dtype=np.intp)] = True
    return found
