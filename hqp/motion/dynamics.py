"""The dynamics of a retargeted motion: a CoM that the soles' forces can move, and the posture that follows it."""

from __future__ import annotations

import math
from dataclasses import dataclass, replace
from typing import Any, NamedTuple

import numpy as np

from hqp.arrays import Mat, Vec
from hqp.declare.robot import Robot, State
from hqp.errors import DeclarationError
from hqp.tasks.support_polygon import hull

from .body import Body
from .centroidal import Soles, Support, centroidal_plan, outside
from .clip import accelerated, low_pass, moving
from .contacts import Mask, runs, smooth
from .joints import SIDES
from .rates import velocities
from .schedule import BOTH, LEAST, Schedule
from .smoothing import LIVELY, Course, filtered
from .tracker import Pass, Tracker

NODES = 60.0
"""Nodes of the plan per second, at least."""

SHARE = 0.75
"""Margin of the planned ZMP to the edge of a sole, as a share of the way to its middle: the rest is for feedback."""

BENT = 0.35
"""Least bend of the knee of a standing leg [rad]: a straight one neither lifts a foot nor moves the CoM."""

PLANS = 3
"""Number of plans, each with the height that the legs reach under the one before."""

ROUNDS = 3
"""Number of passes, each planned with height and momentum of the one before, and led by its joints below 6 Hz."""

OUTSIDE = 0.01
"""Distance of a ZMP from the soles beyond which a frame counts as outside [m]."""

EVEN = 5e-3
"""Depth of a sole's front edge: corners this far behind its first one are on it [m]."""

TAKES = 0.5 * LEAST[BOTH]
"""Time in which the weight moves onto a sole or off it [s]: two soles hold the robot up while it changes feet."""

LIFTS = 0.05
"""Time in which moving feet join the CoM's change of height at the ends of a flight [s]."""


class Beyond(NamedTuple):
    """A time from ``first`` to ``last`` [s] in which soles give a speed [m/s] less to the CoM than the motion has."""

    first: float
    last: float
    lacks: float


@dataclass(frozen=True)
class Dynamics:
    """Changes of a motion that make it carriable by the forces of soles and toes.

    stands, toes ``(T, 2)``: true while the left or right sole stands, and while it stands on its toe alone.  com,
    velocity, acceleration ``(T, 3)``: the plan [m, m/s, m/s^2].  zmp ``(T, 2)`` [m]: ZMP of the plan, NaN in flight.
    shift ``(T,)`` [m]: distance of the plan from the kinematic CoM.  zmp_outside: share of standing frames whose ZMP,
    angular momentum included, is more than 10 mm outside the soles, before and after.  hands_p99: 99th percentile of
    the hands' error [m], before and after.  missed [m]: largest distance of the CoM from the plan.  beyond: times in
    which no forces of the soles carry it.  flights [s]: first and last time of each flight of the person.
    """

    stands: Mask
    toes: Mask
    com: Mat
    velocity: Mat
    acceleration: Mat
    zmp: Mat
    shift: Vec
    zmp_outside: tuple[float, float]
    hands_p99: tuple[float, float]
    missed: float
    beyond: tuple[Beyond, ...] = ()
    flights: tuple[tuple[float, float], ...] = ()

    def thinned(self, each: int) -> Dynamics:
        """Every ``each``-th frame."""
        names = ("stands", "toes", "com", "velocity", "acceleration", "zmp", "shift")
        return replace(self, **{name: getattr(self, name)[::each] for name in names})

    def lines(self) -> list[str]:
        """The changes in words."""
        (out, now), (hands, after) = self.zmp_outside, self.hands_p99
        return [
            f"CoM moved by {1e3 * float(np.median(self.shift)):.0f} mm (median), "
            f"{1e3 * float(self.shift.max()):.0f} mm at most; it misses its plan by {1e3 * self.missed:.0f} mm at most",
            f"ZMP more than {1e3 * OUTSIDE:.0f} mm outside the soles: {100 * out:.1f} % of standing frames before, "
            f"{100 * now:.1f} % after; hands p99 {1e3 * hands:.0f} mm before, {1e3 * after:.0f} mm after",
            *(
                f"the soles do not carry it from {each.first:.2f} to {each.last:.2f} s: their forces give the CoM "
                f"{each.lacks:.2f} m/s too little"
                for each in self.beyond
            ),
            *(
                f"both feet are in the air from {first:.2f} to {last:.2f} s: a controller needs a phase without "
                "contacts for it, or stays on the ground"
                for first, last in self.flights
            ),
        ]


def carried(tracker: Tracker, found: Pass, schedule: Schedule) -> tuple[Pass, Dynamics]:
    """A pass again, with a CoM that the standing soles can accelerate; the tracker's targets stand by the schedule.

    Levels: limits, floor, self-collision > standing feet > moving feet > CoM from above > its height, hands, trunk and
    joints.  Raises DeclarationError for a robot without shapes at its soles.
    """
    robot, stacks, fps, q = tracker.robot, tracker.stacks, tracker.targets.fps, found.q
    if any(len(stacks.body.soles[side]) < 3 for side in SIDES):
        allowed = "a robot with collision shapes on both feet"
        raise DeclarationError("retarget", "dynamics need the outline of the soles", value=robot.name, allowed=allowed)
    stands, toes = schedule.stands, schedule.toes
    own, spin = centroidal(robot, q, fps)
    each = max(1, int(fps / NODES))
    nodes, dt = slice(None, None, each), each / fps
    places = supports_of(tracker, q[nodes], stands[nodes], toes[nodes], margin=True)
    at = [(len(places) - 1) * each]
    stops = np.repeat(stands[at].any(axis=1, keepdims=True), len(SIDES), axis=1)  # a foot in the air lands there
    (ends,) = supports_of(tracker, q[at], stops, toes[at], margin=True)
    times = np.minimum(np.arange(len(q)) / fps, (len(places) - 1) * dt)
    gravity = float(-robot.gravity[2])

    course = tracker.carries = CarriedCourse(tracker, q)

    def once(before: Mat, reached: Mat, spin: Mat) -> tuple[Pass, tuple[Mat, Mat, Mat], Mat]:
        plan, shares, highest = None, None, np.full(len(places), np.inf)
        legs = _legs(tracker, before[nodes])
        supports = strong(tracker, places, before[nodes], stands[nodes], toes[nodes])
        supports = shifting(supports, stands[nodes], gravity * dt / TAKES)
        aim = np.column_stack((own[:, :2], reached[:, 2]))
        for _ in range(PLANS):
            plan = centroidal_plan(
                aim[nodes], supports, dt, gravity=gravity, highest=highest, spin=spin[nodes], ends=ends, shares=shares
            )
            shares = plan.shares
            highest = _reached(stacks.body, reached[nodes], plan.com, legs, stands[nodes])
        assert plan is not None
        com, rate, push = plan.at(times, dt)
        course.lead(com, (com[:, 2] - own[:, 2]) * _in_flight(schedule))
        settled = tracker.settle(before[0], 0, course)
        again = tracker.run(settled, np.zeros(robot.nv), 0, len(q) - 1, course)
        return again, (com, rate, push), plan.zmp[np.minimum(np.rint(times / dt).astype(int), len(plan.zmp) - 1)]

    again, (com, rate, push), zmp = once(q, own, spin)
    for _ in range(1, ROUNDS):
        course.follow(again.q)
        again, (com, rate, push), zmp = once(again.q, *centroidal(robot, again.q, fps))
    reached, _ = centroidal(robot, again.q, fps)
    before, after = (zmp_outside(tracker, each.q, stands, toes) for each in (found, again))
    hands = _hands_p99(tracker, q), _hands_p99(tracker, again.q)
    missed = float(np.linalg.norm(reached - com, axis=1).max())
    shift = np.asarray(np.linalg.norm(com - own, axis=1))
    shares, lacks = (share_outside(before), share_outside(after)), beyond(tracker, reached, stands, after)
    return again, Dynamics(
        stands, toes, com, rate, push, zmp, shift, shares, hands, missed, lacks, schedule.flights
    )  # fmt: skip


def centroidal(robot: Robot, q: Mat, fps: float) -> tuple[Mat, Mat]:
    """CoM ``(T, 3)`` [m], and rate of the angular momentum about x and y over the mass ``(T, 2)`` [m^2/s^2].

    Both below ``LIVELY``.
    """
    v = velocities(robot, q, fps)
    com, momentum = np.empty((len(q), 3)), np.empty((len(q), 2))
    for i, at in enumerate(q):
        state = robot.state(at, v[i])
        com[i] = state.com()
        momentum[i] = state.momentum_map()[0][3:5] @ v[i] / _mass(state)
    if len(q) > 12:
        com, momentum = moving(com, LIVELY, fps), low_pass(momentum, LIVELY, fps)
    torque: Any = np.gradient(momentum, axis=0)
    return com, torque * fps


def supports_of(tracker: Tracker, q: Mat, stands: Mask, toes: Mask, *, margin: bool) -> list[Soles]:
    """The standing soles, frame by frame, their front edge on the toe; margin: true to leave that of a plan."""
    stacks = tracker.stacks
    corners = {side: _corners(stacks.body.soles[side], margin) for side in SIDES}
    fronts = {side: _corners(front(stacks.body.soles[side]), margin) for side in SIDES}
    found = []
    for at, down, raised in zip(q, stands, toes, strict=True):
        state, soles = tracker.robot.state(at), []
        for side, on, toe in zip(SIDES, down, raised, strict=True):
            if on:
                frame = stacks.frames[f"{side}_sole"]
                offsets = np.array([stacks.in_frame(side, corner) for corner in (fronts if toe else corners)[side]])
                points = state.position(frame) + offsets @ state.rotation(frame).T
                outline = points[:, :2] if toe else points[hull(points[:, :2]), :2]
                soles.append(Support(outline, float(points[:, 2].mean())))
        found.append(tuple(soles))
    return found


def front(outline: Mat) -> Mat:
    """Ends of the front edge of a sole, right and left ``(2, 3)`` [m]."""
    ahead = outline[outline[:, 0] > outline[:, 0].max() - EVEN]
    return np.array([ahead[ahead[:, 1].argmin()], ahead[ahead[:, 1].argmax()]])


def strong(tracker: Tracker, supports: list[Soles], q: Mat, stands: Mask, toes: Mask) -> list[Soles]:
    """Standing soles with the strength of their legs: the vertical force at a sole that the motors in q just hold."""
    robot, stacks, found = tracker.robot, tracker.stacks, []
    limits = robot.effort_limit[robot.actuated]
    for soles, at, down, raised in zip(supports, q, stands, toes, strict=True):
        state, strengths = robot.state(at), []
        for side, toe in ((side, toe) for side, on, toe in zip(SIDES, down, raised, strict=True) if on):
            ends = stacks.toes[side].jacobian(state), (stacks.toes if toe else stacks.heels)[side].jacobian(state)
            lever = float(np.max(0.5 * np.abs(ends[0] + ends[1])[2, robot.actuated] / limits))
            strengths.append(1.0 / lever / _mass(state) if lever > 0.0 else math.inf)
        found.append(tuple(sole._replace(strength=most) for sole, most in zip(soles, strengths, strict=True)))
    return found


def shifting(supports: list[Soles], stands: Mask, rate: float) -> list[Soles]:
    """Let the load of a sole grow from nothing once it has landed beside the other, and fade until it lifts.

    rate [m/s^2] a node: the weight in ``TAKES``.
    """
    found, both = [list(soles) for soles in supports], np.asarray(stands.all(axis=1))
    for k in range(len(SIDES)):
        for first, last in runs(stands[:, k]):
            lands, lifts = first > 0 and stands[first - 1, 1 - k], last < len(stands) and stands[last, 1 - k]
            for i in (i for i in range(first, last) if both[i]):
                since, left = float(i - first) if lands else math.inf, float(last - 1 - i) if lifts else math.inf
                sole = found[i][k]
                found[i][k] = sole._replace(strength=min(sole.strength, rate * min(since, left)))
    return [tuple(soles) for soles in found]


def _mass(state: State) -> float:
    """Mass of the robot [kg]: a push of the base moves all of it."""
    return float(np.linalg.norm(state.momentum_map()[0][:3, 0]))


def _corners(outline: Mat, margin: bool) -> Mat:
    middle = 0.5 * (outline.min(axis=0) + outline.max(axis=0))
    return np.asarray(middle + (1.0 - SHARE if margin else 1.0) * (outline - middle))


def zmp_outside(tracker: Tracker, q: Mat, stands: Mask, toes: Mask) -> Vec:
    """Distance of the ground's force outside the hull of the standing soles, angular momentum included ``(T,)`` [m].

    Below 0 inside, NaN in flight.
    """
    robot, fps = tracker.robot, tracker.targets.fps
    com, spin = centroidal(robot, q, fps)
    acceleration = accelerated(com, fps)
    found = np.full(len(q), np.nan)
    for i, soles in enumerate(supports_of(tracker, q, stands, toes, margin=False)):
        if soles:
            force = acceleration[i] - robot.gravity
            force[2] = max(force[2], 1e-3)
            found[i] = outside(soles, com[i], force, np.array([-spin[i, 1], spin[i, 0]]) / force[2])
    return found


def beyond(tracker: Tracker, com: Mat, stands: Mask, distances: Vec) -> tuple[Beyond, ...]:
    """Times in which forces that stay on the soles miss the CoM's speed by more than the ankle makes up for later.

    com ``(T, 3)`` [m]; distances ``(T,)`` [m]: the result of ``zmp_outside``.  A force d outside a sole accelerates the
    CoM by d f / (m h) more than it can, with the load f and the height h above the soles.  The ankle moves the force by
    ``SHARE`` of half a sole: enough for that times the pendulum's frequency.
    """
    body, fps = tracker.stacks.body, tracker.targets.fps
    gravity, found = float(-tracker.robot.gravity[2]), []
    push = np.maximum(accelerated(com, fps)[:, 2] + gravity, 0.0)
    ground = [tracker.targets.places[f"{side}_sole"][:, 2] for side in SIDES]
    level = np.where(stands.all(axis=1), np.mean(ground, axis=0), np.where(stands[:, 0], *ground))
    height = np.maximum(com[:, 2] - level, 1e-3)
    half = 0.5 * min(float(np.ptp(body.soles[side][:, :2], axis=0).min()) for side in SIDES)
    for first, last in runs(np.nan_to_num(distances) > 0.0):
        here = slice(first, last)
        lacks = float(np.sum(distances[here] * push[here] / height[here])) / fps
        if lacks > SHARE * half * math.sqrt(gravity / float(height[here].mean())):
            found.append(Beyond(first / fps, last / fps, lacks))
    return tuple(found)


def share_outside(distances: Vec) -> float:
    """Share of standing frames whose ZMP is more than ``OUTSIDE`` outside."""
    known = distances[np.isfinite(distances)]
    return float(np.mean(known > OUTSIDE)) if known.size else 0.0


def _legs(tracker: Tracker, q: Mat) -> Mat:
    """Hip and ankle of both legs ``(n, 2, 2, 3)`` [m]."""
    found = np.empty((len(q), 2, 2, 3))
    for i, at in enumerate(q):
        state = tracker.robot.state(at)
        for k, side in enumerate(SIDES):
            found[i, k] = [end.value(state) for end in tracker.stacks.legs[side]]
    return found


def _reached(body: Body, own: Mat, plan: Mat, legs: Mat, stands: Mask) -> Vec:
    """Height of the CoM with the knees of standing legs bent by ``BENT``, the hips moved with the plan ``(n,)`` [m]."""
    a, b = body.length("hip", "knee"), body.length("knee", "ankle")
    length = math.sqrt(a * a + b * b + 2.0 * a * b * math.cos(BENT))
    highest = np.full(len(own), np.inf)
    for k in range(len(SIDES)):
        hip, ankle = legs[:, k, 0], legs[:, k, 1]
        aside = np.linalg.norm(hip[:, :2] + (plan - own)[:, :2] - ankle[:, :2], axis=1)
        room = ankle[:, 2] + np.sqrt(np.maximum(length**2 - aside**2, 0.0)) - hip[:, 2]
        highest = np.where(stands[:, k], np.minimum(highest, own[:, 2] + room), highest)
    return highest


def _in_flight(schedule: Schedule) -> Vec:
    """1 in flight, without a corner at its ends ``(T,)``."""
    return np.asarray(1.0 - smooth(~schedule.flight, schedule.fps, LIFTS))


def _hands_p99(tracker: Tracker, q: Mat) -> float:
    """99th percentile of the distance of both hands from their targets [m]."""
    hands = [tracker.stacks.points[f"{side}_hand"] for side in SIDES]
    off = [
        float(np.linalg.norm(hand.value(state) - tracker.targets.places[hand.name][i]))
        for i, state in ((i, tracker.robot.state(at)) for i, at in enumerate(q))
        for hand in hands
    ]
    return float(np.quantile(off, 0.99))


class CarriedCourse(Course):
    """References of passes with a planned CoM: feet, hands and trunk of q, and those of the plan that leads.

    A pass that led its hands by those of the pass before would keep each of their lags.
    """

    carries = True

    def __init__(self, tracker: Tracker, q: Mat) -> None:
        stacks = tracker.stacks
        super().__init__(tracker, q, stacks.torso, stacks.hips, *stacks.soles.values())
        self._tracker, self._ends = tracker, {edge.name: self._motion[edge.name] for _, edge in stacks.edges}

    def lead(self, com: Mat, lift: Vec) -> None:
        """Follow a planned CoM ``(T, 3)``, with moving feet raised by a height ``(T,)`` [m]."""
        fps, stacks = self._tracker.targets.fps, self._tracker.stacks
        rate: Any = fps * np.diff(com, axis=0)
        self._motion[stacks.com.name] = com[:, :2], rate[:, :2]
        self._motion[stacks.com_height.name] = com[:, 2:], rate[:, 2:]
        up = np.column_stack((np.zeros((len(com), 2)), lift))
        for name, (place, velocity) in self._ends.items():
            self._motion[name] = place + up, velocity + fps * np.diff(up, axis=0)

    def follow(self, before: Mat) -> None:
        """Follow the joints of the pass before ``(T, nq)``."""
        self._follow_joints(self._tracker, filtered(self._tracker.robot, before, self._tracker.targets.fps))
