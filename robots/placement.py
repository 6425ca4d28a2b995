"""Placements as users write them."""

from __future__ import annotations

from typing import Any

import numpy as np
import pinocchio as pin

from hqp.errors import DeclarationError

_ALLOWED = "a pinocchio.SE3, a matrix (4, 4), (position (3,), rotation (3, 3)), or a position (3,) [m]"


def se3(name: str, placement: Any) -> Any:
    """A pinocchio.SE3 of an SE3, a matrix ``(4, 4)``, a pair, a position, or None; raises DeclarationError."""
    if placement is None:
        return pin.SE3.Identity()
    if isinstance(placement, pin.SE3):
        return placement
    position, rotation = np.zeros(3), np.eye(3)
    try:
        if isinstance(placement, tuple) and len(placement) == 2:
            position, rotation = (np.asarray(part, dtype=np.float64) for part in placement)
        else:
            array = np.asarray(placement, dtype=np.float64)
            position, rotation = (array[:3, 3], array[:3, :3]) if array.shape == (4, 4) else (array, rotation)
    except (TypeError, ValueError):
        raise DeclarationError(name, "no placement", value=placement, allowed=_ALLOWED) from None
    fits = (
        position.shape == (3,) and rotation.shape == (3, 3) and bool(np.isfinite([*position, *rotation.ravel()]).all())
    )
    if not fits or np.abs(rotation @ rotation.T - np.eye(3)).max() > 1e-6 or np.linalg.det(rotation) < 0.0:
        raise DeclarationError(name, "no placement", value=placement, allowed=_ALLOWED)
    return pin.SE3(rotation, position)
