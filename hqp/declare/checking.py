"""Check an element: shapes, Jacobian and drift against differences on the manifold, with faults in words."""

from __future__ import annotations

from collections.abc import Callable, Iterator
from dataclasses import dataclass
from typing import Any

import numpy as np

from hqp.arrays import Mat, Vec
from hqp.declare.element import Element, Inequality, Task, has, selection_of
from hqp.declare.robot import Robot, State
from hqp.errors import DeclarationError

STEP = 1e-6
"""Tangent step of the differences [m, rad]."""

SAME = 1e-5
"""Numbers agree within this, relative to 1 + the largest of them: above the error of the differences, below any
fault."""


@dataclass(frozen=True)
class Check:
    """Result of ``check``: a sentence per fault, and notes on quantities that differences cannot check."""

    element: str
    faults: tuple[str, ...]
    notes: tuple[str, ...] = ()

    @property
    def ok(self) -> bool:
        """True if there is no fault."""
        return not self.faults

    def __str__(self) -> str:
        lines = [f"{self.element}: {'right' if self.ok else 'wrong'}"]
        return "\n".join((*lines, *(f"  {text}" for text in (*self.faults, *self.notes))))


def check(element: Element, robot: Robot, *, states: int = 3, seed: int = 0) -> Check:
    """Compare a task's or an inequality's J and drift with differences at random states; look at singular places.

    At zero error de/dq = J and d(J v)/dt = drift at zero acceleration; for an inequality the ways left shrink with
    J.  The robot is moved: earlier states become stale.  Raises DeclarationError for an element that has no rows on
    the robot's motion, ModelError for names that the robot does not have.
    """
    if element.quantity != "motion" or not isinstance(element, (Task, Inequality)):
        raise DeclarationError(element.name, "has no rows on the robot's motion", allowed="a Task or an Inequality")
    work = _Work(element, robot, np.random.default_rng(seed))
    faults = list(dict.fromkeys(work.shapes()))
    if not faults:
        faults = [text for _ in range(states) for text in work.derivatives()] + list(work.singular())
    return Check(element.name, tuple(dict.fromkeys(faults)), tuple(dict.fromkeys(work.notes)))


class _Work:
    def __init__(self, element: Any, robot: Robot, rng: np.random.Generator) -> None:
        self.element, self.robot, self.rng = element, robot, rng
        self.m = element.rows(robot)
        self.notes: list[str] = []
        self.drifts = has(element, "drift")
        if not self.drifts and not has(element, "step_bounds"):
            self.notes.append("no drift(state): accelerations and torques need it")

    def state(self) -> State:
        """A random state about home, of the whole body."""
        robot, rng = self.robot, self.rng
        q = robot.integrate(robot.home, rng.uniform(-0.7, 0.7, robot.nv), 1.0)
        return robot.state(q, rng.normal(size=robot.nv))

    def steer(self, state: State) -> tuple[Any, ...]:
        """Return the extra argument of a steered element's functions: the hold value at that state."""
        value = self.element.hold(state).value if self.element.steered else None
        return () if value is None else (value,)

    def J(self, state: State, steer: tuple[Any, ...] = ()) -> Mat:
        """The Jacobian ``(m, nv)``."""
        return np.atleast_2d(np.asarray(self.element.jacobian(state, *steer), dtype=np.float64)).copy()

    def bounds(self, state: State, steer: tuple[Any, ...] = ()) -> tuple[Vec, Vec]:
        """Both ways left, ``(m,)`` each."""
        found = self.element.bounds(state, *steer)
        lower, upper = (np.broadcast_to(np.asarray(b, dtype=np.float64), (self.m,)) for b in found)
        return lower, upper

    def shapes(self) -> Iterator[str]:
        element, m, nv = self.element, self.m, self.robot.nv
        state = self.state()
        found = np.shape(element.jacobian(state))
        if found != (m, nv) and not (m == 1 and found == (nv,)):
            yield f"jacobian has shape {found}, rows(robot) = {m} and nv = {nv} ask for ({m}, {nv})"
        if self.drifts and np.shape(element.drift(state)) != (m,):
            yield f"drift has shape {np.shape(element.drift(state))}, not ({m},)"
        names = element.row_names(self.robot)
        if names and len(names) != m:
            yield f"row_names gives {len(names)} names for {m} rows"
        if isinstance(element, Inequality):
            for side, bound in zip(("lower", "upper"), element.bounds(state), strict=True):
                if np.shape(bound) not in ((), (m,)):
                    yield f"the {side} of bounds has shape {np.shape(bound)}, not () or ({m},)"
            return
        found = np.shape(element.error(state, element.hold(state).value))
        if found != (m,):
            yield f"error has shape {found}, not ({m},)"

    def derivatives(self) -> Iterator[str]:
        """Faults at one random state."""
        robot, element = self.robot, self.element
        state = self.state()
        q, v = state.q.copy(), state.v.copy()
        steer = self.steer(state)
        J = self.J(state, steer)
        selection = selection_of(element, robot)
        if selection is not None and not _same(J, np.eye(robot.nv)[selection]):
            yield "jacobian is not what selection(robot) says: a row of the identity for each coordinate picked"
        error = self._error_about(q)
        if error is not None:
            slope = self._slope(error, q)
            yield from self._judge_jacobian(J, slope, q)
        if self.drifts:
            drift = np.asarray(element.drift(robot.state(q, v), *steer), dtype=np.float64).copy()
            ahead, behind = (self.J(robot.state(robot.integrate(q, v, s), v), steer) @ v for s in (STEP, -STEP))
            yield from self._judge_drift(drift, (ahead - behind) / (2.0 * STEP), q, v)

    def _error_about(self, q: Vec) -> Callable[[State], Vec] | None:
        """Return a function that changes by J v near q and is zero at q."""
        element, state = self.element, self.robot.state(q)
        if isinstance(element, Inequality):
            steer = self.steer(state)
            lower, upper = self.bounds(state, steer)
            side, start = (0, lower.copy()) if np.isfinite(lower).any() else (1, upper.copy())
            if not np.isfinite(start).any():
                self.notes.append("all bounds are infinite at random states: its Jacobian was not compared")
                return None
            there = np.isfinite(start)
            return lambda s: np.where(there, np.where(there, start, 0.0) - self.bounds(s, steer)[side], np.nan)
        if element.demands:
            still = np.asarray(element.value(state), dtype=np.float64).copy()
            return lambda s: np.asarray(element.value(s), dtype=np.float64) - still
        hold = element.hold(state).value
        start = np.asarray(element.error(state, hold), dtype=np.float64).copy()
        return lambda s: np.asarray(element.error(s, hold), dtype=np.float64) - start

    def _slope(self, error: Callable[[State], Vec], q: Vec) -> Mat:
        robot = self.robot
        columns = []
        for unit in np.eye(robot.nv):
            ahead, behind = (error(robot.state(robot.integrate(q, unit, s))).copy() for s in (STEP, -STEP))
            columns.append((ahead - behind) / (2.0 * STEP))
        return np.column_stack(columns)

    def _judge_jacobian(self, J: Mat, slope: Mat, q: Vec) -> Iterator[str]:
        element = self.element
        still = ~slope.any(axis=1) & J.any(axis=1)
        if still.any() and not isinstance(element, Inequality):
            self.notes.append(f"error of row {_listed(still)} is constant: its Jacobian was not compared")
        rows = ~still & np.isfinite(slope).all(axis=1)
        J, slope = J[rows], slope[rows]
        if _same(J, slope):
            return
        what = "bounds shrink with J v" if isinstance(element, Inequality) else "the error"
        if _same(J, -slope):
            yield f"jacobian has the wrong sign: {what} moves with -J v"
            return
        size = float(np.sum(J * slope) / max(np.sum(slope * slope), 1e-300))
        if size > 0.0 and _same(J, size * slope):
            yield f"jacobian is {size:.6g} times the rate of the value"
            return
        wrong = [i for i in range(len(J)) if not _same(J[i], slope[i])]
        flipped = [i for i in wrong if _same(J[i], -slope[i])]
        if flipped == wrong:
            yield f"jacobian has the wrong sign in row {_listed(wrong)}"
            return
        yield self._frame_or_term(J, slope, q)

    def _frame_or_term(self, J: Mat, slope: Mat, q: Vec) -> str:
        """Name wrong axes, a missing motion of a frame, or the remaining difference."""
        robot = self.robot
        state = robot.state(q)
        for name in self._frames():
            R = state.rotation(name)
            for axes, text in ((R.T, f"of frame {name!r}"), (R, f"of the world, needed: those of {name!r}")):
                if len(J) % 3 == 0 and _same(J, np.kron(np.eye(len(J) // 3), axes) @ slope):
                    return f"jacobian is in the axes {text}"
        missing = slope - J
        for name in self._frames():
            own = state.jacobian(name)
            for part, what in ((own[:3], "linear"), (own[3:], "angular")):
                if len(J) == 3 and (_same(missing, part) or _same(missing, -part)):
                    return f"jacobian lacks the {what} motion of frame {name!r}"
        columns = np.flatnonzero(np.abs(missing).max(axis=0) > SAME * (1.0 + np.abs(slope).max()))
        joints = list(dict.fromkeys(robot.joint_name(int(c)) for c in columns))
        text = f"jacobian is not the rate of the value, by up to {np.abs(missing).max():.3g}"
        if joints == ["base"]:
            return f"{text}, in the columns of the base alone (its velocity is in the base's own axes)"
        if not J[:, columns].any():
            return f"{text}: columns of {', '.join(joints[:4])} are zero, a term is missing"
        return f"{text}; columns of {', '.join(joints[:4])}" + (", ..." if len(joints) > 4 else "")

    def _judge_drift(self, drift: Vec, rate: Vec, q: Vec, v: Vec) -> Iterator[str]:
        if _same(drift, rate, 10.0):
            return
        if _same(drift, -rate, 10.0):
            yield "drift has the wrong sign: dJ/dt v is its negative"
        elif not drift.any():
            yield f"drift is zero, dJ/dt v is up to {np.abs(rate).max():.3g}: J changes as the robot moves"
        else:
            robot, state = self.robot, self.robot.state(q, v)
            for name in self._frames():
                velocity = state.velocity(name)
                turning = np.cross(velocity[3:], velocity[:3])
                for sign in (1.0, -1.0):
                    if len(rate) >= 3 and _same(drift[:3] + sign * turning, rate[:3], 10.0):
                        yield (
                            f"drift lacks omega x v of frame {name!r}: the acceleration of a point, not the spatial one"
                        )
                        return
            twice = np.asarray(self.element.drift(robot.state(q, 2.0 * v)))
            if not _same(twice, 4.0 * drift):
                yield "drift is not quadratic in v"
            yield f"drift is not dJ/dt v, by up to {np.abs(drift - rate).max():.3g}: a term is missing or wrong"

    def _frames(self) -> list[str]:
        """Frames that the element names, then those with a role."""
        fields = (getattr(self.element, f, None) for f in getattr(self.element, "__dataclass_fields__", ()))
        known = set(self.robot.frame_names)
        named = [f for f in fields if isinstance(f, str) and f in known]
        return list(dict.fromkeys((*named, *(f for role in self.robot.landmarks.values() for f in role))))

    def singular(self) -> Iterator[str]:
        """Faults where angles, distances and directions stop to mean anything."""
        element, robot = self.element, self.robot
        hold = element.hold(robot.state(robot.home)).value
        for place, q in self._places():
            state = robot.state(q, self.rng.normal(size=robot.nv))
            with np.errstate(all="ignore"):
                found = {"jacobian": element.jacobian(state)}
                if self.drifts:
                    found["drift"] = element.drift(state)
                if isinstance(element, Inequality):
                    lower, upper = self.bounds(state)
                    if np.isnan(lower).any() or np.isnan(upper).any() or (lower > upper).any():
                        yield f"bounds are not lower <= upper {place}"
                else:
                    found["error"] = element.error(state, hold)
            for what, values in found.items():
                if not np.isfinite(values).all():
                    yield f"{what} is not finite {place}: a tick would end with a status there"

    def _places(self) -> Iterator[tuple[str, Vec]]:
        robot = self.robot
        yield "at home", robot.home
        yield "with all joints at zero", robot.configuration(np.zeros(robot.nv))
        if robot.floating:
            for text, turn in (("upside down", (np.pi, 0.0, 0.0)), ("pitched by 90 degrees", (0.0, np.pi / 2, 0.0))):
                step = np.zeros(robot.nv)
                step[3:6] = turn
                yield text, robot.integrate(robot.home, step, 1.0)


def _same(a: Mat | Vec, b: Mat | Vec, factor: float = 1.0) -> bool:
    a, b = np.asarray(a), np.asarray(b)
    scale = 1.0 + max(float(np.abs(a).max(initial=0.0)), float(np.abs(b).max(initial=0.0)))
    return bool(np.abs(a - b).max(initial=0.0) <= factor * SAME * scale)


def _listed(rows: Any) -> str:
    indices = np.flatnonzero(rows) if np.asarray(rows).dtype == bool else rows
    return ", ".join(str(int(i)) for i in indices)
