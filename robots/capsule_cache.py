"""Capsules of a robot: shipped ones, or fitted ones in the user's cache, as fitting takes minutes for many meshes."""

from __future__ import annotations

import hashlib
import math
import re
import warnings
from collections.abc import Mapping
from pathlib import Path
from typing import Any

import numpy as np

from hqp import user_cache
from hqp.errors import ModelWarning
from hqp.shapes import LinkCapsule

from . import capsule_files, capsules
from .surface import Surface

FIT = 2
"""Version of the fit: another one makes other capsules of the same shapes."""


def around(robot: Any) -> tuple[LinkCapsule, ...]:
    """Capsules around the links: shipped for links of the same surface, from the cache, or fitted.

    Warns (ModelWarning) when they have to be fitted, and when they cannot be kept; notes the links that have a fit of
    their own beside shipped ones.  Raises ModelError without shapes.
    """
    surfaces = capsules.surfaces(robot)
    known = capsule_files.shipped(robot, surfaces)
    own = {joint: part for joint, part in surfaces.items() if joint not in known}
    if not own:
        return tuple(c for joint in surfaces for c in known[joint])
    if known:
        links = ", ".join(capsules.link_name(robot, joint) for joint in own)
        robot.notes += (f"capsules that ship with hqp fit {len(known)} links; fitted to other shapes: {links}",)
    found = _fitted(robot, own)
    return tuple(c for joint in surfaces for c in known.get(joint) or (f for f in found if f.body == joint))


def _fitted(robot: Any, surfaces: Mapping[int, Surface]) -> tuple[LinkCapsule, ...]:
    path = _path(robot, surfaces)
    found = None if path is None else _read(path, surfaces)
    if found is not None:
        return found
    where = "they are not cached: the user has no cache folder" if path is None else f"they are cached in {path}"
    message = f"{robot.name}: fitting capsules to the shapes of {len(surfaces)} links; {where}"
    warnings.warn(message, ModelWarning, stacklevel=4)
    found = capsules.fit_surfaces(robot, surfaces)
    if path is not None:
        try:
            user_cache.write(path, [[c.name, c.body, list(c.a), list(c.b), c.radius] for c in found])
        except OSError as error:
            message = f"{robot.name}: its capsules cannot be cached and are fitted at every start: {error}"
            warnings.warn(message, ModelWarning, stacklevel=4)
    return found


def _path(robot: Any, surfaces: Mapping[int, Surface]) -> Path | None:
    """A file by the hash of all that the capsules are fitted to; None if the user has no home."""
    digest = hashlib.sha256(f"{FIT} {capsules.NEAR} {capsules.SHARE} {capsules.TIGHT} {capsules.MOST}".encode())
    for joint, part in sorted(surfaces.items()):
        digest.update(f"\0{joint} {capsules.link_name(robot, joint)} {part.triangles.shape}".encode())
        for numbers in part:
            digest.update(np.ascontiguousarray(numbers, dtype="<f8").tobytes())
    name = re.sub(r"[^\w.-]", "_", robot.name)[:60]
    try:
        return user_cache.folder("capsules") / f"{name}-{digest.hexdigest()[:24]}.json"
    except RuntimeError:
        return None


def _read(path: Path, surfaces: Mapping[int, Surface]) -> tuple[LinkCapsule, ...] | None:
    """Content of a file; None if it is missing, or not as it was written."""
    try:
        rows = user_cache.read(path) or ()
        found = tuple(LinkCapsule(name, body, tuple(a), tuple(b), radius, True) for name, body, a, b, radius in rows)
        numbers = [x for c in found for x in (*c.a, *c.b, c.radius)]
        fits = {c.body for c in found} == set(surfaces) and all(len(c.a) == len(c.b) == 3 for c in found)
        return found if fits and all(map(math.isfinite, numbers)) else None
    except (ValueError, TypeError):
        return None
