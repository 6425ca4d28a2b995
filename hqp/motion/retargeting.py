"""Human motion to a robot."""

from __future__ import annotations

import math
import time
from pathlib import Path

import numpy as np

from hqp.declare.robot import Robot
from hqp.errors import DeclarationError
from hqp.kinds import require_robot
from hqp.numbers import number

from .anchored import solved
from .body import Body
from .clip import RATES, Motion
from .contacts import NAMES, Mask
from .dynamics import Dynamics, carried
from .joints import parts_of
from .measures import measure
from .person import joints_of, remarks
from .rates import velocities
from .readers import read_motion
from .retargeted import Retargeted
from .schedule import grounded, schedule_of
from .shortfalls import gave_way, shortfalls
from .skeleton_map import SkeletonMap, find_map
from .smoothing import smoothed
from .stacks import Stacks
from .targets import Targets, targets_of
from .tracker import Pass, Tracker

LEAST_RATE = 100.0
"""Least tick rate [1/s]; a frame of a slower motion takes several ticks."""


def retarget(
    motion: Motion | str | Path,
    robot: Robot | str,
    *,
    map: SkeletonMap | str | Path | None = None,
    contacts: str | Path | Mask = "auto",
    fps: float | None = None,
    up: str = "auto",
    body_model: str | Path | None = None,
    collision: bool = True,
    dynamics: bool = False,
) -> Retargeted:
    """A person's motion on a robot: strict levels, standing feet held where they came to rest.

    Floor, self-collision, joint and speed limits are kept; then standing feet by their lower end and heading >
    moving feet > hands > tilt of soles > trunk > limbs > posture.  The person is scaled by the length of the legs, arms
    and trunk by their own.

    A box that the motion has keeps its size and stays between the hands that hold it; it is no obstacle.

    motion: a ``Motion``, or a file that ``read_motion`` reads, with ``up`` and ``body_model`` as it takes them.  robot:
    with a free base, or its name.  map: a SkeletonMap, its file or its name, the first shipped one that fits for None.
    contacts: "auto" detects them; else ``(T, k)`` bool in the order left and right foot, hand, knee, or an .npz with
    contacts (and contact_names).  fps: frame rate of the result, the motion's own for None.  collision: False leaves
    out self-collision and links other than feet above the floor.  dynamics: True plans a CoM that flat soles can carry,
    by a schedule of their contacts, and follows it below the feet and above the hands; the result's ``dynamics`` has
    the plan and its changes.  There is no clock in it: equal motions give equal
    bits.  Raises DeclarationError and ModelError for a misfit.
    """
    robot = _loaded(robot)
    with robot.keep_shapes():
        found = find_map(map, robot)
        if not isinstance(motion, Motion):
            if not isinstance(motion, (str, Path)):
                allowed = "a Motion(names, positions, fps), or the path of a .bvh or .npz file"
                raise DeclarationError("retarget", "motion", value=type(motion).__name__, allowed=allowed)
            motion = read_motion(motion, up=up, body_model=body_model, human=found.human)
        rate = motion.fps
        if fps is not None:
            rate = float(number("retarget", "fps", fps, RATES[0], most=RATES[1], unit="1/s"))
        given = _contacts(contacts, len(motion))
        clip = ticked(motion, rate)
        masks = None if given is None else _at_rate(given, motion.fps, clip.fps, len(clip))
        body, parts = Body.of(robot, found), parts_of(clip.names, found.human)
        targets = targets_of(clip, parts, body, masks)
        begin = time.process_time()
        tracker, passed, changes = solution(robot, found, body, targets, collision=collision, dynamics=dynamics)
        spent = time.process_time() - begin
        notes = (*clip.notes, *remarks(joints_of(motion, parts)))
        return _retargeted(tracker, passed, changes, rate, clip.parents, spent, notes)


def ticked(motion: Motion, rate: float) -> Motion:
    """A smoothed motion with a frame for each tick: the least multiple of a rate that ``LEAST_RATE`` allows [1/s]."""
    return motion.smoothed().at_rate(rate * math.ceil(LEAST_RATE / rate))


def solution(
    robot: Robot, found: SkeletonMap, body: Body, targets: Targets, *, collision: bool = True, dynamics: bool = False
) -> tuple[Tracker, Pass, Dynamics | None]:
    """Follow targets by strict levels; dynamics: place feet by a schedule, and follow a plan of the CoM.

    The tracker has the targets with the feet so placed.
    """
    schedule = schedule_of(targets, body) if dynamics else None
    if schedule is not None:
        targets = grounded(targets, body, schedule)
    stacks = Stacks(robot, found, body, 1.0 / targets.fps, collision=collision, flat=dynamics)
    tracker = Tracker(robot, stacks, targets)
    passed = smoothed(tracker, solved(tracker))
    return (tracker, passed, None) if schedule is None else (tracker, *carried(tracker, passed, schedule))


def _retargeted(
    tracker: Tracker, passed: Pass, changes: Dynamics | None, rate: float, parents: tuple[int, ...], spent: float,
    notes: tuple[str, ...],
) -> Retargeted:  # fmt: skip
    """The frames of a pass at a rate [1/s], measured in its ticks, and in its frames."""
    robot, targets = tracker.robot, tracker.targets
    each = round(targets.fps / rate)
    frames = slice(None, None, each)
    q = passed.q[frames]
    measures = measure(robot, tracker.stacks, targets, passed.q)
    thinned = measure(robot, tracker.stacks, targets.thinned(each), q) if each > 1 else measures
    whole = tracker, passed.q, passed.v, measures.errors
    behind = tuple(one.thinned(each) for one in shortfalls(*whole))
    return Retargeted(
        robot, q, velocities(robot, q, rate), targets.contacts.array()[frames], NAMES, rate,
        targets.person[frames], parents, thinned, behind, gave_way(*whole, range(0, len(targets), each)),
        _counted(passed.statuses), spent, targets.scale, notes,
        None if changes is None else changes.thinned(each),
        None if targets.box is None else targets.box.frames(frames),
    )  # fmt: skip


def _loaded(robot: Robot | str) -> Robot:
    if isinstance(robot, str):
        from hqp import robots

        return robots.load(robot)
    require_robot("retarget", robot)
    return robot


def _contacts(given: str | Path | Mask, frames: int) -> Mask | None:
    """Contacts ``(T, k)`` in the order of ``NAMES``, None to detect them."""
    if isinstance(given, str) and given == "auto":
        return None
    names: tuple[str, ...] = NAMES
    if isinstance(given, (str, Path)):
        try:
            with np.load(given, allow_pickle=False) as file:
                array = np.asarray(file["contacts"], dtype=bool)
                names = tuple(map(str, file["contact_names"])) if "contact_names" in file else NAMES
        except (OSError, EOFError, ValueError, KeyError) as error:
            allowed = '"auto", or an .npz with contacts (T, k) and contact_names'
            raise DeclarationError("retarget", f"no contacts: {error}", value=str(given), allowed=allowed) from error
    else:
        array = np.asarray(given, dtype=bool)
    if array.ndim != 2 or array.shape != (frames, len(names)):
        allowed = f"({frames}, {len(names)}): {', '.join(names)}"
        raise DeclarationError("retarget", f"contacts have shape {array.shape}", allowed=allowed)
    if len(set(names)) < len(names):
        raise DeclarationError("retarget", "contacts named twice", value=names, allowed=", ".join(NAMES))
    strange = [name for name in names if name not in NAMES]
    if strange:
        raise DeclarationError("retarget", "unknown contact", value=strange[0], allowed=", ".join(NAMES))
    found = np.zeros((frames, len(NAMES)), dtype=bool)
    for i, name in enumerate(names):
        found[:, NAMES.index(name)] = array[:, i]
    return found


def _at_rate(mask: Mask, before: float, after: float, frames: int) -> Mask:
    nearest = np.minimum(np.rint(np.arange(frames) * before / after).astype(int), len(mask) - 1)
    return np.asarray(mask[nearest])


def _counted(statuses: list[str]) -> dict[str, int]:
    return {status: statuses.count(status) for status in dict.fromkeys(statuses)}
