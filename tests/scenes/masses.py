"""Edits of a plant's masses."""

from __future__ import annotations

from typing import Any

import numpy as np


def scaled(factor: float) -> Any:
    """An edit that multiplies all masses, given for bodies or for their geoms."""

    def edit(spec: Any) -> None:
        for body in spec.bodies:
            body.mass, body.inertia = factor * body.mass, factor * np.asarray(body.inertia)
            body.fullinertia = factor * np.asarray(body.fullinertia)
        for geom in spec.geoms:
            geom.mass, geom.density = factor * geom.mass, factor * geom.density

    return edit
