"""The joints of a Pinocchio model: their columns in v, their places in q, and their limits."""

from __future__ import annotations

from collections.abc import Mapping
from typing import Any

import numpy as np
import pinocchio as pin

from hqp.arrays import Index, Mat, Vec
from hqp.errors import JointNotFound, ModelError

_UNLIMITED = 1e6  # a limit at or beyond this [rad, m] is no limit


class Joints:
    """Tables of a model's joints.

    floating: true if the first joint is a free flyer.  columns: first tangent coordinate and number of them by name,
    the base left out.  single: joints of one axis by name.  several: joints with several axes, by name: first place in
    q, number there, first in v, number there.  Raises ModelError for joints without coordinates of their own
    (Pinocchio's mimic joints), for ellipsoids, and for joints that are not in depth-first order, for which Pinocchio
    computes a wrong joint-space inertia.
    """

    def __init__(self, model: Any, name: str) -> None:
        self._name = name
        _require_depth_first(model, name)
        self.floating = model.njoints > 1 and model.joints[1].shortname() == "JointModelFreeFlyer"
        self.columns: dict[str, tuple[int, int]] = {}
        self.several: dict[str, tuple[int, int, int, int]] = {}
        self.free: tuple[str, ...] = ()
        single: list[tuple[int, int]] = []
        double: list[tuple[int, int]] = []
        for i in range(2 if self.floating else 1, model.njoints):
            joint, title = model.joints[i], model.names[i]
            if joint.shortname() == "JointModelMimic":
                raise ModelError(
                    f"{name}: joint {title!r} shares the coordinate of another one (JointModelMimic); "
                    "build the model without mimic=True, its couplings then bind the joints"
                )
            if joint.shortname() == "JointModelEllipsoid":
                raise ModelError(f"{name}: joint {title!r} is an ellipsoid, which is not supported: use a ball joint")
            if joint.nv == 1 and joint.nq <= 2:
                (single if joint.nq == 1 else double).append((joint.idx_v, joint.idx_q))
            else:
                self.several[title] = (joint.idx_q, joint.nq, joint.idx_v, joint.nv)
            if joint.shortname() == "JointModelFreeFlyer":
                self.free += (title,)
            self.columns[title] = (joint.idx_v, joint.nv)
        pairs: Index = np.array(single, dtype=np.intp).reshape(-1, 2)
        self.single_v, self.single_q = pairs[:, 0].copy(), pairs[:, 1].copy()
        self.double = tuple(double)
        self.continuous: Index = np.array([v for v, _ in double], dtype=np.intp)
        self.neutral: Vec = pin.neutral(model)
        self._places = dict(zip(self.single_v.tolist(), self.single_q.tolist(), strict=True))

    def find(self, joint: str, groups: Any = ()) -> range:
        """Tangent coordinates of a joint; raises JointNotFound."""
        try:
            first, count = self.columns[joint]
        except (KeyError, TypeError):
            raise JointNotFound(joint, [*self.columns, *groups], self._name) from None
        return range(first, first + count)

    def name(self, column: int) -> str:
        """Joint of a tangent coordinate, with its place where the joint has several; 'base' for the free base."""
        for name, (first, count) in self.columns.items():
            if first <= column < first + count:
                return name if count == 1 else f"{name}[{column - first}]"
        return "base"

    def bodies_columns(self) -> list[int]:
        """Tangent coordinates of all joints but free ones."""
        return [
            c for name, (first, n) in self.columns.items() if name not in self.free for c in range(first, first + n)
        ]

    def places(self, columns: Index) -> list[int] | None:
        """Places in q of coordinates that are numbers of q, or whose cosine is; None if one of them is neither."""
        known = {**self._places, **dict(self.double)}
        found = [known.get(c) for c in columns.tolist()]
        return None if None in found else [i for i in found if i is not None]

    def angles(self, model: Any, q: Vec) -> Vec:
        """Joint positions by tangent coordinate ``(nv,)``: zero for free bodies, for a joint of several axes the
        velocity that leads there from its neutral position in one second (a ball: the rotation vector)."""
        angles = np.zeros(model.nv)
        angles[self.single_v] = q[self.single_q]
        for v, i in self.double:
            angles[v] = np.arctan2(q[i + 1], q[i])
        if self.several:
            whole = pin.difference(model, self.neutral, q)
            for name, (_, _, first, count) in self.several.items():
                if name not in self.free:
                    angles[first : first + count] = whole[first : first + count]
        return angles

    def placed(self, model: Any, q: Vec, angles: Vec) -> Vec:
        """q with its joints at these positions ``(nv,)``, as ``angles`` gives them; free bodies as in q."""
        whole = pin.integrate(model, self.neutral, angles)
        free = [model.joints[model.getJointId(name)] for name in self.free]
        if self.floating:
            free.append(model.joints[1])
        for joint in free:
            whole[joint.idx_q : joint.idx_q + joint.nq] = q[joint.idx_q : joint.idx_q + joint.nq]
        return np.asarray(whole, dtype=np.float64)

    def limits(self, model: Any) -> tuple[Vec, Vec, Vec, Vec]:
        """Lower, upper, velocity and effort limits by tangent coordinate, infinite if unlimited."""
        lower, upper = np.full(model.nv, -np.inf), np.full(model.nv, np.inf)
        lower[self.single_v] = model.lowerPositionLimit[self.single_q]
        upper[self.single_v] = model.upperPositionLimit[self.single_q]
        for name, (i, nq, v, nv) in self.several.items():
            if nq == nv and name not in self.free:
                lower[v : v + nv] = model.lowerPositionLimit[i : i + nq]
                upper[v : v + nv] = model.upperPositionLimit[i : i + nq]
        velocity, effort = np.array(model.velocityLimit), np.array(model.effortLimit)
        free = [range(6)] if self.floating else []
        for columns in [*free, *(self.find(name) for name in self.free)]:
            velocity[columns] = effort[columns] = np.inf
        for limit in (lower, upper, velocity, effort):
            limit[np.abs(limit) >= _UNLIMITED] = np.copysign(np.inf, limit[np.abs(limit) >= _UNLIMITED])
        velocity[velocity <= 0.0] = np.inf  # zero in a description means that nobody gave one
        effort[effort <= 0.0] = np.inf
        unset = (lower > upper) | ((lower == upper) & (lower == 0.0))
        lower[unset], upper[unset] = -np.inf, np.inf
        return lower, upper, velocity, effort

    def inside(self, model: Any, q: Vec, lower: Vec, upper: Vec, cones: Mapping[str, float]) -> tuple[Vec, list[str]]:
        """q with its joints clipped into their limits, balls into cones [rad], and the names of those outside."""
        q = np.array(q, dtype=np.float64)
        here = q[self.single_q]
        there = np.clip(here, lower[self.single_v], upper[self.single_v])
        moved = np.flatnonzero(here != there)
        q[self.single_q] = there
        balls = []
        for name, most in cones.items():
            i = self.several[name][0]
            turned = pin.log3(pin.Quaternion(q[i : i + 4]).matrix())
            if (angle := float(np.linalg.norm(turned))) > most:
                q[i : i + 4] = pin.Quaternion(pin.exp3(turned * (most / angle))).coeffs()
                balls.append(name)
        return q, [*(self.name(int(self.single_v[i])) for i in moved), *balls]

    def turned(self, q: Vec, column: int, angle: float) -> Vec:
        """q with the joint of one tangent coordinate at an angle [rad or m]."""
        q = q.copy()
        if column in self._places:
            q[self._places[column]] = angle
        for v, i in self.double:
            if v == column:
                q[i : i + 2] = np.cos(angle), np.sin(angle)
        return q


def matrix(view: Mat) -> Mat:
    """A live view of Pinocchio with two dimensions: it gives one of a single column as a vector."""
    return view if view.ndim == 2 else view.reshape(-1, 1, order="F")


def actuation(columns: Index, nv: int, tendons: Mapping[int, Mapping[int, float]]) -> Mat:
    """U ``(n_actuated, nv)``: a 1 at each motor's joint; tendons: coefficients of further joints, by motor's joint."""
    U = np.zeros((columns.size, nv))
    U[np.arange(columns.size), columns] = 1.0
    for k, column in enumerate(columns.tolist()):
        for other, factor in tendons.get(column, {}).items():
            U[k, other] = factor
    return U


def _require_depth_first(model: Any, name: str) -> None:
    """Raise ModelError if a joint does not follow its parent or a joint that its parent carries."""
    carriers = [0]
    for i in range(1, model.njoints):
        while carriers and carriers[-1] != model.parents[i]:
            carriers.pop()
        if not carriers:
            raise ModelError(
                f"{name}: joint {model.names[i]!r} comes after a joint that its parent "
                f"{model.names[model.parents[i]]!r} does not carry; Pinocchio needs depth-first order: "
                "add all joints of a branch before the next branch"
            )
        carriers.append(i)
