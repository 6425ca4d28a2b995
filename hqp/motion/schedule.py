"""Contact schedule of a robot that carries a motion out: the sole that stands flat, and when."""

from __future__ import annotations

from dataclasses import dataclass, replace
from typing import Any

import numpy as np

from hqp.arrays import Mat, Vec

from .beside import Pair, aside, part
from .body import Body
from .clip import EDGE, accelerated, moving, unit
from .contacts import BESIDE, LEVEL, Contacts, Mask, runs, smooth
from .joints import SIDES
from .smoothing import LIVELY
from .targets import Edges, Targets, turned

BOTH, LEFT, RIGHT, FLIGHT = range(4)
STANDS = ((True, True), (True, False), (False, True), (False, False))
"""Left and right sole, by state of the schedule."""

LEAST = (0.1, 0.2, 0.2, 0.08)
"""Shortest duration of each state [s]: the load changes feet within 0.1 s, a foot swings for 0.2 s."""

CHANGE = 0.04
"""Cost of a change of state, as time with one foot that contradicts the person [s]."""

QUICK, HIGH = 1.0, 0.06
"""Speed [m/s] and height [m], for a leg of 1 m, at which a foot costs 1 more as a standing foot."""

MOST = 9.0
"""Largest part of speed or height in that cost."""

FALLING = 0.5
"""Downward acceleration of the hips as a share of g above which both feet may be in the air."""

CLEAR = 0.03
"""Height of a swing foot half way between two places [m]."""

FLATTENS = 0.12
"""Time before and after a stance in which the sole turns flat [s]."""

GRAVITY, LEG = 9.81, 0.8
"""Gravity in which the person moves [m/s^2], and length of the person's leg, whose unit is unknown [m]."""


@dataclass(frozen=True)
class Schedule:
    """stands ``(T, 2)``: true while the left or the right sole stands.  toes ``(T, 2)``: true while it stands on its
    toe alone, flat otherwise.  fps [1/s].
    """

    stands: Mask
    toes: Mask
    fps: float

    @property
    def flight(self) -> Mask:
        """True while no sole stands ``(T,)``."""
        return np.asarray(~self.stands.any(axis=1))

    @property
    def flights(self) -> tuple[tuple[float, float], ...]:
        """First and last time of each flight [s]."""
        return tuple((first / self.fps, last / self.fps) for first, last in runs(self.flight))

    @property
    def changes(self) -> int:
        """Number of frames in which a sole comes down or lifts."""
        return int(np.count_nonzero((self.stands[1:] != self.stands[:-1]).any(axis=1)))


def schedule_of(targets: Targets, body: Body) -> Schedule:
    """The schedule that contradicts the person's feet least, each state for its shortest duration at least.

    At least one sole stands unless the hips fall; a step passes through a time on both feet.  A frame costs, by foot, 0
    for one that rests and stands, 20 for one that rests and is in the air, 1 for one that moves and is in the air, and

        1.2 + min((height / HIGH)^2, MOST) + min((speed / QUICK)^2, MOST)

    for one that moves and stands.  Solved exactly by dynamic programming over states and their age (Viterbi 1967).
    """
    own = _costs(targets, body.leg)
    least = [max(1, round(time * targets.fps)) for time in LEAST]
    stands = np.array(STANDS)[_cheapest(own, least, CHANGE * targets.fps)]
    edges = np.column_stack([targets.edge[side] for side in SIDES])
    return Schedule(stands, heel_off(stands, edges, least[BOTH]), targets.fps)


def heel_off(stands: Mask, edges: Edges, least: int) -> Mask:
    """True while a sole about to lift stands on its toe beside the other sole, as the person does ``(T, 2)``.

    edges ``(T, 2)``: support of the person's feet.  least: frames in which a load changes feet; it lasts longer.
    """
    found = np.zeros_like(stands)
    for k, (stand, other) in enumerate(zip(stands.T, stands.T[::-1], strict=True)):
        raised = stand & other & (edges[:, k] == 1)
        for first, last in runs(raised):
            lifts = last < len(stands) and other[last] and not stand[last]
            found[first:last, k] = lifts and last - first > least
    return found


def _costs(targets: Targets, leg: float) -> Mat:
    """Cost of each state, frame by frame ``(T, 4)``."""
    stands, lifts = [], []
    for side in SIDES:
        place, rest = targets.places[f"{side}_sole"], targets.contacts.resting[f"{side}_foot"]
        speed = np.linalg.norm(np.gradient(place, axis=0), axis=1) * targets.fps
        height = place[:, 2]
        if rest.any():
            height = height - np.interp(np.arange(len(place)), np.flatnonzero(rest), place[rest, 2])
        moving = 1.2 + np.minimum((height / (HIGH * leg)) ** 2, MOST) + np.minimum((speed / (QUICK * leg)) ** 2, MOST)
        stands.append(np.where(rest, 0.0, moving))
        lifts.append(np.where(rest, 20.0, 1.0))
    own = np.zeros((len(targets), len(STANDS)))
    for j, state in enumerate(STANDS):
        for k, on in enumerate(state):
            own[:, j] += stands[k] if on else lifts[k]
    own[~_falling(targets, leg), FLIGHT] = np.inf
    return own


def _falling(targets: Targets, leg: float) -> Mask:
    """True while the person's hips fall freely: lengths are in the robot's size, time is the person's."""
    if len(targets) <= EDGE:
        return np.zeros(len(targets), dtype=bool)
    height = moving(targets.places["pelvis"][:, 2], LIVELY, targets.fps) * LEG / leg
    return np.asarray(accelerated(height, targets.fps) < -FALLING * GRAVITY)


def _cheapest(own: Mat, least: list[int], change: float) -> list[int]:
    """State of each frame on the cheapest path; a state ends after ``least`` frames at the earliest."""
    ages = [(state, age) for state in range(len(least)) for age in range(least[state])]
    state = np.array([s for s, _ in ages])
    first: Any = np.array([ages.index((s, 0)) for s in range(len(least))])
    last: Any = np.array([ages.index((s, n - 1)) for s, n in enumerate(least)])
    allowed = ~np.eye(len(least), dtype=bool)
    allowed[LEFT, RIGHT] = allowed[RIGHT, LEFT] = False
    extra = np.where(allowed, change, np.inf)
    best: Any = np.full(len(ages), np.inf)
    best[last] = own[0]  # the clip begins within a state
    back = np.zeros((len(own), len(ages)), dtype=int)
    older = np.arange(len(ages)) - 1
    for i in range(1, len(own)):
        found = best[older]
        found[first] = np.inf
        back[i] = older
        stays = best[last] < found[last]
        found[last[stays]] = best[last[stays]]
        back[i, last[stays]] = last[stays]
        enters = best[last][:, None] + extra
        source = enters.argmin(axis=0)
        entered = enters[source, np.arange(len(least))]
        quick = entered < found[first]
        found[first[quick]], back[i, first[quick]] = entered[quick], last[source[quick]]
        best = found + own[i][state]
    at, path = int(best.argmin()), []
    for i in range(len(own) - 1, -1, -1):
        path.append(int(state[at]))
        at = int(back[i, at])
    return path[::-1]


def grounded(targets: Targets, body: Body, schedule: Schedule) -> Targets:
    """Place feet as the schedule has them: flat or on the toe at one place while they stand, clear of the ground else.

    A foot in the air keeps the person's motion, shifted to the places before and after.  Stances are moved apart, and
    swings aside, until soles and shanks do not overlap at the height of the higher foot: robots' legs are thicker.
    """
    places, axes, edge = dict(targets.places), dict(targets.axes), {}
    resting, ground = dict(targets.contacts.resting), dict(targets.contacts.ground)
    feet = [_Foot(targets, body, side, schedule, k) for k, side in enumerate(SIDES)]
    ways = _lateral(targets, body)
    left, right = feet
    part((left.spots, right.spots), _pairs(left, right, ways))
    heights = iter(levelled(np.vstack([foot.spots for foot in feet]), body.leg))
    for side, foot in zip(SIDES, feet, strict=True):
        foot.spots[:, 2] = [next(heights) for _ in foot.spots]
        sole, name = f"{side}_sole", f"{side}_foot"
        places[sole], axes[sole], ground[name] = foot.placed()
        edge[side], resting[name] = foot.toes.astype(np.int8), foot.mask
    upright = {side: axes[f"{side}_sole"] @ body.axes[f"{side}_sole"].T for side in SIDES}
    for side, other, foot, still, sign in ((*SIDES, left, right, 1.0), (*SIDES[::-1], right, left, -1.0)):
        for here in (slice(*swing) for swing in foot.swings):
            path, beside = (places[f"{one}_sole"][here] for one in (side, other))
            level = np.maximum(path[:, 2], beside[:, 2]) - CLEAR
            own = foot.sections(here, upright[side][here], level - path[:, 2])
            around = still.sections(here, upright[other][here], level - beside[:, 2])
            around = [outline + place[:2] for outline, place in zip(around, beside, strict=True)]
            path[:] = aside(path, own, around, sign * ways[here])
    return replace(targets, places=places, axes=axes, edge=edge, contacts=Contacts(resting, ground))


def _lateral(targets: Targets, body: Body) -> Mat:
    """Horizontal directions to the left of the hips ``(T, 2)``."""
    return unit((targets.axes["hips"] @ body.axes["pelvis"].T)[:, :2, 1])


def _pairs(left: _Foot, right: _Foot, ways: Mat) -> list[Pair]:
    """Stances of both feet that share time."""
    found = []
    for i, (a, b) in enumerate(left.stances):
        for j, (c, d) in enumerate(right.stances):
            here = slice(max(a, c), min(b, d))
            if here.start < here.stop:
                level = max(left.spots[i, 2], right.spots[j, 2]) - CLEAR
                outlines = left.outline(i, here, level), right.outline(j, here, level)
                found.append(Pair(i, j, *outlines, unit(ways[here].mean(axis=0))))
    return found


def levelled(spots: Mat, leg: float) -> Vec:
    """Heights of places on the ground ``(n, 3)``: less than ``LEVEL`` and ``BESIDE`` apart they have one, their median.

    The nearest are joined first, and only with all others of theirs as near: on a ramp they do not become one.
    """
    if len(spots) < 2:
        return np.array(spots[:, 2])
    from scipy.cluster import hierarchy
    from scipy.spatial.distance import pdist

    apart = np.maximum(pdist(spots[:, 2:]) / LEVEL, pdist(spots[:, :2]) / BESIDE) / leg
    group = hierarchy.fcluster(hierarchy.complete(apart), 1.0, "distance")
    return np.array([np.median(spots[group == own, 2]) for own in group])


class _Foot:
    """A foot of a schedule.  It lifts and lands at rest beside a standing one, and in flight as the person's.

    spots: its places ``(n, 3)``, one for each stance, 0 high on the floor.
    """

    def __init__(self, targets: Targets, body: Body, side: str, schedule: Schedule, k: int) -> None:
        self.mask, self._beside, self.toes = schedule.stands[:, k], schedule.stands[:, 1 - k], schedule.toes[:, k]
        self._home, self._fps, self._leg = body.axes[f"{side}_sole"], targets.fps, body.legs[side]
        rest, ground = targets.contacts.resting[f"{side}_foot"], targets.contacts.ground[f"{side}_foot"]
        R = targets.axes[f"{side}_sole"] @ self._home.T
        self._shins = targets.places[f"{side}_knee"] - targets.places[f"{side}_sole"] - R @ self._leg.ankle
        over = R[:, 2, 2] < 0.0  # turned beyond the vertical
        ahead = np.where(over, -1.0, 1.0)
        self._yaw = np.unwrap(np.arctan2(ahead * R[:, 1, 0], ahead * R[:, 0, 0]))
        tilt = -np.arcsin(np.clip(R[:, 2, 0], -1.0, 1.0))
        tilt = np.where(over, np.copysign(np.pi, tilt) - tilt, tilt)
        self._tilt = (1.0 - smooth(self.mask & ~self.toes, targets.fps, FLATTENS)) * tilt
        self._pivot = np.where(tilt[:, None] > 0.0, body.toes[side], body.heels[side])
        self._place = targets.places[f"{side}_sole"] - _rolled(R, self._yaw, self._pivot)
        self.stances, self.spots, self._headings = runs(self.mask), np.zeros((0, 3)), []
        for first, last in self.stances:
            known = first + np.flatnonzero(rest[first:last])
            used = known if known.size else np.arange(first, last)
            high = known.size and float(np.median(ground[known])) > 0.0
            above = float(np.median(self._place[known, 2])) if high else 0.0
            self.spots = np.vstack((self.spots, [*np.median(self._place[used, :2], axis=0), above]))
            self._headings.append(float(np.median(self._yaw[used])))

    @property
    def swings(self) -> list[tuple[int, int]]:
        """First and end of every swing between two stances."""
        return [(first, last) for first, last in runs(~self.mask) if first > 0 and last < len(self.mask)]

    def outline(self, stance: int, here: slice, level: float) -> Mat:
        """Outline about its spot of the leg in a stance, at a height and in some frames, from above ``(m, 2)`` [m]."""
        yaw, flat = np.array([self._headings[stance]]), np.zeros(1)
        shin = np.median(self._shins[here], axis=0)
        return self._leg.section(turned(yaw, flat)[0], shin, level - self.spots[stance, 2])

    def sections(self, here: slice, R: Mat, heights: Vec) -> list[Mat]:
        """Outlines about its place of the leg in some frames, at heights above its sole, from above ``(m, 2)`` [m]."""
        return [self._leg.section(*each) for each in zip(R, self._shins[here], heights, strict=True)]

    def placed(self) -> tuple[Mat, Mat, Vec]:
        """Places ``(T, 3)`` and axes ``(T, 3, 3)`` of the sole at its spots, and the height under it ``(T,)``."""
        frames = len(self.mask)
        shift, turn, level = np.zeros((frames, 3)), np.zeros(frames), np.zeros(frames)
        for (first, last), spot, heading in zip(self.stances, self.spots, self._headings, strict=True):
            here = slice(first, last)
            level[here], shift[here], turn[here] = spot[2], spot - self._place[here], heading - self._yaw[here]
        stands, every = np.flatnonzero(self.mask), np.arange(frames)
        if stands.size:
            shift = np.column_stack([np.interp(every, stands, shift[stands, j]) for j in range(3)])
            turn = np.interp(every, stands, turn[stands])
        place = self._place + shift
        yaw = self._yaw + turn
        for first, last in self.swings:
            s = (np.arange(first, last) - first + 1) / (last - first + 1)
            begin, end = (0.5 * LEAST[LEFT] * self._fps * self._beside[i] for i in (first, last - 1))
            place[first:last] = from_rest(place[first - 1 : last + 1], begin, end)[1:-1]
            least = np.maximum(
                (1.0 - s) * place[first - 1, 2] + s * place[last, 2], self._edges(place, yaw, first, last)
            )
            place[first:last, 2] = np.maximum(place[first:last, 2], least + CLEAR * 16.0 * (s * (1.0 - s)) ** 2)
        R = turned(yaw, self._tilt)
        return place + _rolled(R, yaw, self._pivot), R @ self._home, level

    def _edges(self, place: Mat, yaw: Vec, first: int, last: int) -> Vec:
        """Least height of a foot between two stances: the height of the ground while the foot is above it.

        Beside a stance it falls with the distance, by 45 degrees, or more steeply so that it ends at the other stance.
        Stances nearer than ``CLEAR`` overlap by the rest, as a robot's longer feet do.
        """
        here = slice(first - 1, last + 1)
        outlines, levels = _flat(self._leg.sole, yaw[here]), []
        for own, other in ((0, -1), (-1, 0)):
            off = place[here, :2] - place[here][own, :2]
            way = unit(off)
            gap = np.sum(way * off, axis=1) - (way @ outlines[own].T).max(axis=1)
            gap += np.einsum("tmi,ti->tm", outlines, way).min(axis=1)
            gap -= min(0.0, float(gap[other]) - CLEAR)
            rise = float(place[here][own, 2] - place[here][other, 2])
            levels.append(place[here][own, 2] - max(1.0, rise / float(gap[other])) * np.maximum(gap, 0.0))
        return np.asarray(np.maximum(*levels))[1:-1]


def _flat(outline: Mat, yaw: Vec) -> Mat:
    """An outline ``(m, 2)`` in headings ``(T,)``, from above ``(T, m, 2)``."""
    return np.asarray(outline @ np.swapaxes(turned(yaw, np.zeros_like(yaw))[:, :2, :2], 1, 2))


def _rolled(R: Mat, yaw: Vec, pivot: Mat) -> Mat:
    """Shift of a sole that rolls about a pivot from flat to R ``(T, 3)`` [m]."""
    return np.asarray(np.einsum("tij,tj->ti", turned(yaw, np.zeros_like(yaw)) - R, pivot))


def from_rest(path: Mat, begin: float, end: float) -> Mat:
    """A path ``(n, 3)`` between its ends, at rest there, with its own steps but for some frames at each end.

    An end with no such frames keeps its speed.
    """
    steps, k = np.diff(path, axis=0), np.arange(len(path) - 1) + 0.5
    near = np.ones(len(steps))
    for away, frames in ((k, begin), (len(k) - k, end)):
        near = np.minimum(near, away / frames) if frames else near
    share = (near * near * (3.0 - 2.0 * near))[:, None]
    slow = share * steps
    slow += share * (path[-1] - path[0] - slow.sum(axis=0)) / share.sum()
    return np.vstack((path[:1], path[0] + np.cumsum(slow, axis=0)))
