"""One pass over the frames: references, standing feet held where they came to rest, one tick a frame."""

from __future__ import annotations

import math
from collections.abc import Callable, Mapping
from dataclasses import dataclass
from typing import TYPE_CHECKING

import numpy as np

from hqp.arrays import Mat, Vec
from hqp.declare.reference import Reference
from hqp.declare.robot import Robot, State
from hqp.declare.stack import Stack
from hqp.loop.controller import Controller
from hqp.loop.session import Session
from hqp.programs.formulation import Velocity
from hqp.progress import tracked
from hqp.tasks import Position

from .holds import Hold, Plane, turn, turns
from .joints import SIDES
from .stacks import Stacks, Standing
from .targets import Targets

if TYPE_CHECKING:
    from hqp.explanation.account import TickAccount

    from .smoothing import Course

RELEASE = 0.2
"""Duration of the blend from a foot's stance to the person's foot after lift-off [s]."""

OFF = 0.05
"""Error beyond which a hand or a foot is behind [m]."""

LEAN = 0.8
"""Rotation error beyond which a trunk or a sole is behind [rad]."""

SLIDE = 5e-3
"""Speed of a standing foot above which a tick is solved again [m/s]."""

CORRECTIONS = 3
"""Largest number of corrections in a frame; each squares the error."""

TRUNK = ("torso", "hips")
ZERO = np.zeros(2)

SETTLING, STILL = 3.0, 1e-3
"""Longest time for the first posture, which low levels need [s]; speed below which it is at rest [rad/s]."""


@dataclass
class Pass:
    """Result of a pass over some frames: q ``(n, nq)``, v ``(n, nv)``, and the statuses of its ticks."""

    q: Mat
    v: Mat
    statuses: list[str]

    def reversed(self) -> Pass:
        """Return the frames in reverse order."""
        return Pass(self.q[::-1], -self.v[::-1], self.statuses[::-1])

    def then(self, other: Pass) -> Pass:
        """Followed by a pass that begins in the last frame of this one."""
        q, v = np.vstack((self.q, other.q[1:])), np.vstack((self.v, other.v[1:]))
        return Pass(q, v, self.statuses + other.statuses)


class Sessions:
    """A session for each set of standing feet, made when it is first needed."""

    def __init__(self, robot: Robot, dt: float, stack: Callable[[Standing], Stack]) -> None:
        self._robot, self._dt, self._stack = robot, dt, stack
        self._made: dict[Standing, Session] = {}

    def of(self, standing: Standing) -> Session:
        """The session for the feet that stand."""
        if standing not in self._made:
            controller = Controller(self._stack(standing), Velocity(), deadline=math.inf)
            self._made[standing] = controller.session(self._robot, self._dt, stuck=False)
        return self._made[standing]


class Tracker:
    """Follows targets forwards or backwards in time."""

    def __init__(self, robot: Robot, stacks: Stacks, targets: Targets) -> None:
        self.robot, self.stacks, self.targets = robot, stacks, targets
        self.dt = 1.0 / targets.fps
        self.carries: Course | None = None
        """References of the pass with a planned CoM, once there is one."""
        self.sessions, self._closing, self._carrying = (
            Sessions(robot, self.dt, stack) for stack in (stacks.stack, stacks.closing, stacks.carrying)
        )
        rest = stacks.resting()
        self._starting, self._closing_rest, self._carrying_rest = (
            Sessions(robot, rest.dt, stack) for stack in (rest.starting, rest.closing, rest.carrying)
        )
        points = {name: targets.places[name] for name in ("pelvis", *stacks.points)}
        edges = {task.name: _edge(targets, stacks, side, task) for side, task in stacks.edges}
        axes = {name: targets.axes[name] for name in ("torso", "hips", *(f"{side}_sole" for side in SIDES))}
        self._places = {name: (place, np.diff(place, axis=0) / self.dt) for name, place in points.items()}
        self._edges = {name: (place, np.diff(place, axis=0) / self.dt) for name, place in edges.items()}
        self._axes = {name: (R, turns(R) / self.dt) for name, R in axes.items()}
        self._ground = {
            side: np.minimum(*(edges[stacks.down(side, end).name][:, 2] for end in (1, -1))) for side in SIDES
        }
        self._resting = {side: targets.contacts.resting[f"{side}_foot"] for side in SIDES}

    def without_collision(self) -> Tracker:
        """Return a tracker of the same targets whose links may pass through each other."""
        return Tracker(self.robot, self.stacks.without_collision(), self.targets)

    def feet(self, i: int, j: int) -> dict[str, int]:
        """Support of the feet that stand from frame i to frame j: 0 the sole, 1 the toe, -1 the heel."""
        stand = (side for side in SIDES if self._resting[side][i] and self._resting[side][j])
        edges = {side: [int(self.targets.edge[side][k]) for k in (i, j)] for side in stand}
        return {side: here or there for side, (here, there) in edges.items()}

    def standing(self, frame: int) -> Standing:
        """The feet that stand in a frame, on the end that the person stands on."""
        return tuple((side, edge or 1) for side, edge in self.feet(frame, frame).items())

    def starting(self, frame: int) -> list[Reference]:
        """References of one frame, at rest, for the stack of a start."""
        standing = self.standing(frame)
        stack = self.stacks.starting(standing)
        given = self.references(frame, frame, standing, {})
        return [r.aiming_at(r.value) for r in given if r.name in stack]

    def references(self, i: int, j: int, standing: Standing, holds: Mapping[str, Hold]) -> list[Reference]:
        """References of frame i, with the rates that lead to frame j in one period."""
        between, sign = min(i, j, len(self.targets) - 2), float(j - i)
        found = [Reference(name, x[i], sign * u[between]) for name, (x, u) in self._places.items()]
        found += [Reference(name, self._axes[name][0][i], sign * self._axes[name][1][between]) for name in TRUNK]
        ends = dict(standing)
        for side in SIDES:
            task, sole = self.stacks.down(side, ends.get(side, 1)), f"{side}_sole"
            place, rate = self._edges[task.name]
            axes, turning = self._axes[sole]
            x, u, R, w = place[i], sign * rate[between], axes[i], sign * turning[between]
            plane = holds[side].motion if side in holds else None
            if plane is not None:
                x, u, R, w = plane.point(x), plane.rotation @ u, plane.rotation @ R, plane.rotation @ w
            if side not in ends:
                found += [Reference(sole, R, w), Reference(task.name, x, u)]
                continue
            spot = holds[side].spot if side in holds else x[:2]
            found.append(Reference(self.stacks.spots[task.name].name, spot, ZERO))
            ground = self._ground[side][i : i + 1]
            found.append(Reference(self.stacks.heights[task.name].name, ground))
            raised, line = self.stacks.down(side, -ends[side]).name, self.stacks.lines[side]
            if not self.stacks.flat:
                found.append(Reference(self.stacks.above[raised].name, ground))
            found.append(Reference(line.name, R @ line.axis, ZERO))
            place, rate = self._edges[raised]
            found.append(Reference(self.stacks.heights[raised].name, place[i, 2:], sign * rate[between, 2:]))
        return found

    def errors(self, q: Mat) -> Mat:
        """Errors of the tasks that ``judged`` has, level by level ``(T, 7)``: 1 is ``OFF`` or ``LEAN``.

        A foot on its heel is judged there.
        """
        tasks = [task for level in self.stacks.judged for task in level]
        aims = {**self._edges, **self._places, **self._axes}
        found = np.empty((len(q), len(tasks)))
        for i, at in enumerate(q):
            state = self.robot.state(at)
            down = {self.stacks.toes[side].name: self.stacks.down(side, end) for side, end in self.standing(i)}
            here = [down.get(task.name, task) for task in tasks]
            off = [float(np.linalg.norm(task.error(state, aims[task.name][0][i]))) for task in here]
            found[i] = [x / (LEAN if task.name in self._axes else OFF) for x, task in zip(off, here, strict=True)]
        return found

    def run(self, q: Vec, v: Vec, first: int, last: int, course: Course | None = None) -> Pass:
        """From q at frame ``first`` to frame ``last``, which may be before it; both ends are part of the result.

        course: references of the last pass, which runs forwards; standing feet are corrected to ``SLIDE`` only there.
        """
        sessions = self._last(course) if course else self.sessions
        step = 1 if last >= first else -1
        qs, vs, statuses = [q], [v], []
        holds = {side: Hold(RELEASE / self.dt) for side in SIDES}
        bent: dict[str, Vec] = {}
        state = self.robot.state(q, v)
        frames = range(first, last, step)
        title = f"{'smoothing' if course else 'retargeting'}, a pass over {len(frames)} frames"
        for i in tracked(frames, title):
            j = i + step
            feet = self.feet(i, j)
            self._hold(state, i, feet, holds, course)
            standing = tuple((side, holds[side].end) for side in feet)
            session = sessions.of(standing)
            references = self._with(course, i, self.references(i, j, standing, holds), session)
            spots = [self.stacks.spots[self.stacks.down(side, end).name] for side, end in (standing if course else ())]
            state, bent, status = self._moved(session, state, references, spots, bent)
            qs.append(state.q)
            vs.append(state.v)
            statuses.append(status)
        return Pass(np.array(qs), np.array(vs), statuses)

    def account(self, q: Mat, v: Mat, frame: int) -> TickAccount:
        """Explanation of the tick that leads to a frame, in the stack of ``carries`` if there is one."""
        i, standing = frame - 1, self.standing(frame - 1)
        session = (self._last(self.carries) if self.carries else self.sessions).of(standing)
        state = self.robot.state(q[i], v[i])
        state.commanded = v[i]
        references = self._with(self.carries, i, self.references(i, frame, standing, {}), session)
        return session.step(state, *references).account()

    @staticmethod
    def _with(course: Course | None, i: int, given: list[Reference], session: Session) -> list[Reference]:
        """References of a session, those of a course in place of those of the same name."""
        found = {r.name: r for r in given} | (course.references(i) if course else {})
        return [r for r in found.values() if r.name in session]

    def _last(self, course: Course) -> Sessions:
        """Sessions of a last pass."""
        return self._carrying if course.carries else self._closing

    def settle(self, q: Vec, frame: int, course: Course | None = None) -> Vec:
        """Rest configuration of ticks at the targets of a frame, or of a course; after ``SETTLING`` at most."""
        references, v, standing = self.starting(frame), np.zeros(self.robot.nv), self.standing(frame)
        session = self._starting.of(standing)
        if course:
            session = (self._carrying_rest if course.carries else self._closing_rest).of(standing)
            found = self._with(course, frame, self.references(frame, frame, standing, {}), session)
            references = [Reference(r.name, r.value) for r in found]
        for _ in range(math.ceil(SETTLING / session.dt)):
            q, v = session.step(self.robot.state(q, v), *references).advance()
            if float(np.abs(v).max()) < STILL:
                break
        return q

    def _hold(
        self, state: State, i: int, feet: Mapping[str, int], holds: Mapping[str, Hold], course: Course | None
    ) -> None:
        """Feet that stand are held where the robot's came to rest, by the end that is down.

        In the last pass that is the lower one by this pass and the one before together: a foot that lands a little
        otherwise stays on its end, one that has rolled over does not slide on the other.
        """
        for side, hold in holds.items():
            if side not in feet:
                hold.release()
                continue
            ends = {end: self.stacks.down(side, end).value(state) for end in (1, -1)}
            before = course.heights(side, i) if course else (0.0, 0.0)
            end = hold.lower(float(ends[1][2]) + before[0], float(ends[-1][2]) + before[1])
            if end != hold.end:
                task, here = self.stacks.down(side, end), ends[end]
                place = self._edges[task.name][0][i]
                angle = float(turn(self._axes[f"{side}_sole"][0][i], state.rotation(task.frame))[2])
                hold.take(end, here[:2].copy(), Plane(place[:2], here[:2] - place[:2], angle))

    def _moved(
        self, session: Session, state: State, references: list[Reference], spots: list[Position], bent: dict[str, Vec]
    ) -> tuple[State, dict[str, Vec], str]:
        """The state one period later, with standing feet where they stand.

        Fast joint rotation moves a foot by more than the first order.  A correction of its reference velocity cancels
        the rest: first that of the previous tick, ``bent`` by task, then from the tick's own error.
        """
        q, v, names = state.q, state.v, [task.name for task in spots]
        feet = {r.name: r for r in references if r.name in names}
        others = [r for r in references if r.name not in feet]
        bends = {name: bent.get(name, ZERO) for name in names}
        left = CORRECTIONS
        while True:
            shifted = (Reference(r.name, r.value, bends[r.name]) for r in feet.values())
            tick = session.step(state, *others, *shifted)
            state = self.robot.state(*tick.advance())
            there = ((task, feet[task.name]) for task in spots)
            off = {task.name: task.error(state, r.value) / self.dt for task, r in there}
            still = all(float(error @ error) < SLIDE**2 for error in off.values())
            if still or not left:
                return state, bends if still else {}, tick.status.name
            bends = {name: bends[name] - error for name, error in off.items()}
            state, left = self.robot.state(q, v), left - 1


def _edge(targets: Targets, stacks: Stacks, side: str, task: Position) -> Mat:
    """Places of the toe or the heel of a foot ``(T, 3)``."""
    offset = np.array(task.offset) - stacks.in_frame(side, np.zeros(3))
    return np.asarray(targets.places[f"{side}_sole"] + targets.axes[f"{side}_sole"] @ offset)
