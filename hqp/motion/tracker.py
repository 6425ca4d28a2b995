"""One pass over the frames: references, standing feet held where they came to rest, one tick a frame."""

from __future__ import annotations

import math
from collections.abc import Mapping
from dataclasses import dataclass

import numpy as np

from hqp.arrays import Mat, Vec
from hqp.controller import Controller
from hqp.formulation import Velocity
from hqp.reference import Reference
from hqp.robot import Robot, State
from hqp.session import Session
from hqp.tasks import Position

from .holds import Hold, Plane, turn
from .joints import SIDES
from .stacks import Stacks, Standing
from .targets import Targets

RELEASE = 0.2
"""A foot that leaves the ground comes from where it stood to where the person's is in so long [s]."""

SLIDE = 5e-3
"""A standing foot that would move faster is put back [m/s]."""

CORRECTIONS = 2
"""At most, in a frame: each leaves the square of the error."""


TINY = 1e-6
"""Rounding of a speed against its limit."""

SETTLING, STILL = 3.0, 1e-3
"""Levels that are far down take so long to settle at first [s]; slower than this is at rest [rad/s]."""


@dataclass
class Pass:
    """What a pass over some frames gave: q ``(n, nq)``, v ``(n, nv)``, and the statuses of its ticks."""

    q: Mat
    v: Mat
    statuses: list[str]


class Sessions:
    """A session for each set of standing feet, made when it is first needed."""

    def __init__(self, stacks: Stacks, dt: float) -> None:
        self._stacks, self._dt = stacks, dt
        self._made: dict[Standing, Session] = {}

    def of(self, standing: Standing) -> Session:
        """The session for the feet that stand."""
        if standing not in self._made:
            controller = Controller(self._stacks.stack(standing), Velocity(), deadline=math.inf)
            self._made[standing] = controller.session(self._stacks.robot, self._dt)
        return self._made[standing]


class Tracker:
    """Follows targets forwards or backwards in time."""

    def __init__(self, robot: Robot, stacks: Stacks, targets: Targets) -> None:
        self.robot, self.stacks, self.targets = robot, stacks, targets
        self.dt = 1.0 / targets.fps
        self.sessions = Sessions(stacks, self.dt)
        self._points = {name: targets.places[name] for name in ("pelvis", *stacks.points)}
        self._edges = {task.name: _edge(targets, stacks, side, task) for side, task in stacks.edges}
        self._turns = {name: targets.axes[name] for name in ("torso", "hips", *(f"{side}_sole" for side in SIDES))}
        self._resting = {side: targets.contacts.resting[f"{side}_foot"] for side in SIDES}

    def standing(self, i: int, j: int) -> Standing:
        """The feet that stand from frame i to frame j."""
        found = []
        for side in SIDES:
            if self._resting[side][i] and self._resting[side][j]:
                edge, after = (int(self.targets.edge[side][k]) for k in (i, j))
                found.append((side, edge or after))
        return tuple(found)

    def references(self, i: int, j: int, standing: Standing, held: Mapping[str, Plane]) -> list[Reference]:
        """References of frame i, with the rates that lead to frame j in one period; held: motions of standing feet."""
        dt, found, down = self.dt, [], dict(standing)
        edges = [(side, self.stacks.down(side, down.get(side, 1))) for side in SIDES]
        for side, task in edges:
            here, there = self._edge(side, task, i, held), self._edge(side, task, j, held)
            found.append(Reference(task.name, here, (there - here) / dt))
        for name, axes in self._turns.items():
            side = name.removesuffix("_sole")
            here, there = axes[i], axes[j]
            if side in held:
                around = held[side].rotation
                here, there = around @ here, around @ there
            found.append(Reference(name, here, turn(here, there) / dt))
        for name, places in self._points.items():
            found.append(Reference(name, places[i], (places[j] - places[i]) / dt))
        return found

    def _edge(self, side: str, task: Position, i: int, held: Mapping[str, Plane]) -> Vec:
        """Where the toe or the heel of a foot is to be in frame i ``(3,)``."""
        place = self._edges[task.name][i]
        return held[side].point(place) if side in held else place

    def run(self, q: Vec, v: Vec, first: int, last: int) -> Pass:
        """From q at frame ``first`` to frame ``last``, which may be before it; both ends are part of the result."""
        step = 1 if last >= first else -1
        qs, vs, told = [q], [v], []
        holds = {side: Hold(RELEASE / self.dt) for side in SIDES}
        for i in range(first, last, step):
            j = i + step
            state = self.robot.state(q, v)
            standing = self.standing(i, j)
            held = self._held(state, i, standing, holds)
            session = self.sessions.of(standing)
            state.commanded = v
            tick = session.step(state, *self.references(i, j, standing, held))
            moved, v = tick.advance()
            q, v = self._settled(session, q, moved, v, j, standing, held)
            qs.append(q)
            vs.append(v)
            told.append(tick.status.name)
        return Pass(np.array(qs), np.array(vs), told)

    def settle(self, q: Vec, frame: int) -> Vec:
        """Where ticks at the targets of one frame, at rest, come to rest; after ``SETTLING`` at most."""
        standing, v = self.standing(frame, frame), np.zeros(self.robot.nv)
        references, session = self.references(frame, frame, standing, {}), self.sessions.of(standing)
        for _ in range(math.ceil(SETTLING / self.dt)):
            state = self.robot.state(q, v)
            state.commanded = v
            q, v = session.step(state, *references).advance()
            if float(np.abs(v).max()) < STILL:
                break
        return q

    def _held(self, state: State, i: int, standing: Standing, holds: Mapping[str, Hold]) -> dict[str, Plane]:
        """By side the motion that takes the target to where the foot came to rest."""
        found, edges = {}, dict(standing)
        for side, hold in holds.items():
            if side in edges:
                edge = edges[side]
                found[side] = hold.keep(edge) or hold.take(edge, self._rest(state, side, edge, i))
            elif (plane := hold.release()) is not None:
                found[side] = plane
        return found

    def _rest(self, state: State, side: str, edge: int, i: int) -> Plane:
        task = self.stacks.down(side, edge)
        place, here = self._edges[task.name][i], task.value(state)
        R = state.rotation(task.frame)
        return Plane(place[:2], here[:2] - place[:2], float(turn(self._turns[f"{side}_sole"][i], R)[2]))

    def _settled(
        self, session: Session, q: Vec, moved: Vec, v: Vec, j: int, standing: Standing, held: Mapping[str, Plane]
    ) -> tuple[Vec, Vec]:
        """Standing feet back to where they stand: joints that turn fast move them by more than the first order says."""
        down = {self.stacks.down(side, edge): side for side, edge in standing}
        for _ in range(CORRECTIONS):
            state = self.robot.state(moved, v)
            here = {task: task.value(state) for task in down}
            off = {task: here[task] - self._edge(side, task, j, held) for task, side in down.items()}
            if max((float(np.abs(error).max()) for error in off.values()), default=0.0) < SLIDE * self.dt:
                break
            stays = (task for task in self.stacks.tasks if task not in down and task.name in session)
            references = [Reference(task.name, task.value(state)) for task in stays]
            references += [Reference(task.name, here[task], -error / self.dt) for task, error in off.items()]
            state.commanded = v
            there, _ = session.step(state, *references).advance()
            rate = self.robot.difference(q, there) / self.dt
            if np.any(np.abs(rate) > self.robot.velocity_limit * (1.0 + TINY)):
                break  # speed limits come before standing feet
            moved, v = there, rate
        return moved, v


def _edge(targets: Targets, stacks: Stacks, side: str, task: Position) -> Mat:
    """Places of the toe or the heel of a foot ``(T, 3)``."""
    offset = np.array(task.offset) - stacks.in_frame(side, np.zeros(3))
    return np.asarray(targets.places[f"{side}_sole"] + targets.axes[f"{side}_sole"] @ offset)
