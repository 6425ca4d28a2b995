"""Conditions on (q, v): finite numbers, quaternions and (cos, sin) pairs of length one."""

from __future__ import annotations

from collections.abc import Callable
from typing import Any

import numpy as np

from hqp.arrays import Vec

try:
    from hqp import _assembly as native
except ImportError:  # no compiler was there
    native = None  # type: ignore[assignment]

ROUNDING = 1e-12
"""A squared length this near to one is left as it is."""

UNIT_TOLERANCE = 1e-3
"""A quaternion this far from length one is normalised; beyond it the state is refused."""

_UNIT_PARTS = {"JointModelFreeFlyer": (3, 7), "JointModelSpherical": (0, 4), "JointModelPlanar": (2, 4)}


def unit_parts(model: Any) -> tuple[tuple[int, int], ...]:
    """Slices of q with quaternions or (cos, sin) pairs, as (start, stop)."""
    found: list[tuple[int, int]] = []

    def visit(joint: Any) -> None:
        kind = joint.shortname()
        if kind == "JointModelComposite":
            for part in joint.extract().joints:
                visit(part)
            return
        start, stop = _UNIT_PARTS.get(kind, (0, 2) if (joint.nq, joint.nv) == (2, 1) else (0, 0))
        if stop:
            found.append((joint.idx_q + start, joint.idx_q + stop))

    for joint in list(model.joints)[1:]:
        visit(joint)
    return tuple(found)


class Measure:
    """(q'q + v'v, whether unit parts have length one up to rounding) of a state; None where a shape is wrong."""

    def __init__(self, units: tuple[tuple[int, int], ...], nq: int, nv: int) -> None:
        self._units, self._shapes = units, ((nq,), (nv,))

    def __call__(self, q: Vec, v: Vec) -> tuple[float, bool] | None:
        if (q.shape, v.shape) != self._shapes:
            return None
        square = float(q.dot(q) + v.dot(v))
        return square, all(abs(float(q[a:z].dot(q[a:z])) - 1.0) < ROUNDING for a, z in self._units)


def measure(units: tuple[tuple[int, int], ...], nq: int, nv: int) -> Callable[[Vec, Vec], tuple[float, bool] | None]:
    """A native Measure where there is one."""
    return Measure(units, nq, nv) if native is None else native.Measure(units, ROUNDING, nq, nv)


def owner(robot: Any, place: int, *, velocity: bool) -> str:
    """The joint that a place of q, or of v, belongs to; 'base' for the free base."""
    model = robot.model
    for i in range(1, model.njoints):
        joint = model.joints[i]
        first, count = (joint.idx_v, joint.nv) if velocity else (joint.idx_q, joint.nq)
        if first <= place < first + count:
            return "base" if i == 1 and robot.floating else str(model.names[i])
    return "base"


def not_finite(robot: Any, q: Vec, v: Vec) -> str:
    """Name the number of q or v that is not finite or whose square overflows."""
    for what, numbers, velocity in (("position", q, False), ("velocity", v, True)):
        with np.errstate(over="ignore", invalid="ignore"):
            wrong = ~np.isfinite(numbers * numbers)
        if wrong.any():
            place = int(np.argmax(wrong))
            return f"{owner(robot, place, velocity=velocity)}: {what} {numbers[place]:g} is not a finite number"
    return "q and v are too large: their squares overflow"


def normalise(robot: Any, q: Vec) -> str:
    """Give unit parts of q length one in place; the fault's text where one is too far from it."""
    for a, z in robot._units:
        part = q[a:z]
        length = float(np.sqrt(part @ part))
        if abs(length - 1.0) > UNIT_TOLERANCE:
            what = "quaternion" if z - a == 4 else "(cos, sin) pair"
            name = owner(robot, a, velocity=False)
            return f"{name}: {what} of length {length:.4g}, allowed 1 +- {UNIT_TOLERANCE:g}"
        part /= length
    return ""


def losses(model: Any) -> tuple[str, ...]:
    """Notes on damping and dry friction of the file, which the model's forces lack."""
    found = []
    for what, values in (("damping", model.damping), ("dry friction", getattr(model, "friction", ()))):
        columns = set(np.flatnonzero(np.asarray(values)).tolist())
        joints = zip(model.names[1:], list(model.joints)[1:], strict=True)
        names = [n for n, j in joints if columns.intersection(range(j.idx_v, j.idx_v + j.nv))]
        if names:
            more = f" and {len(names) - 4} more" if len(names) > 4 else ""
            found.append(f"{what} of the file is ignored in the model's forces: {', '.join(names[:4])}{more}")
    return tuple(found)
