"""Path of a transition for native code: its stacks, the values that each takes over, and the eased rows."""

from __future__ import annotations

import math
from collections.abc import Sequence
from typing import TYPE_CHECKING, Any

import numpy as np

from hqp.declare.law import P
from hqp.declare.stack import Stack
from hqp.loop.transition.surviving import surviving, without_successor
from hqp.problem import Selection
from hqp.programs.formulation import Program

if TYPE_CHECKING:
    from hqp.declare.robot import Robot
    from hqp.loop.compiled import Compiled
    from hqp.loop.transition.waypoints import Waypoint

LIGHT = 0.25
"""A contact that was measured to bear no more than this share of the weight is let go as it is."""


def way_parts(points: Sequence[Waypoint], compiled: Sequence[Compiled], robot: Robot) -> dict[str, Any]:
    """Parts of a native transition (hqp/cpp/session/transition.hpp) for these stacks and their programs."""
    torque = compiled[0].program.kind == "torque"
    gone = () if torque else without_successor(points[0].stack, points[-1].stack)
    ends = list(zip(points, compiled, strict=True))
    first = ends[0]
    stops = [
        _stop(first, before, stop, released=bool(gone)) for before, stop in zip((first, *ends), ends, strict=False)
    ]
    return {
        "stops": stops,
        "direct": _stop(first, first, ends[-1], released=bool(gone)) if len(points) > 2 else None,
        "here": [element.name for element in gone],
        "light": LIGHT * sum(body[3] for body in robot.bodies) * float(np.linalg.norm(robot.gravity)),
    }


def _stop(
    first: tuple[Waypoint, Compiled],
    before: tuple[Waypoint, Compiled],
    stop: tuple[Waypoint, Compiled],
    *,
    released: bool,
) -> dict[str, Any]:
    """Data of a stack on the path, after the one before it.  released: allow easing of rows of a released contact."""
    point, own = stop[0], stop[1].stack
    return {
        "switch": point.switch,
        "released": list(point.released),
        "taken": list(point.taken),
        "kept": list(surviving(before[1].stack, own)),
        "first_kept": list(surviving(first[1].stack, own)),
        "eased": None if stop is before or before[0].switch else eased(before, stop, released=released),
    }


def eased(
    before: tuple[Waypoint, Compiled], after: tuple[Waypoint, Compiled], *, released: bool
) -> dict[str, Any] | None:
    """The rows that only one stack of a pair has, None where the stacks differ in more than these.

    A contact that comes is where it is to be.
    """
    names = added(before[0].stack, after[0].stack)
    if names and not any(e.name in names for e in after[0].stack.subject_to):
        return {"second": True, "names": list(names), "pull": [_pull(after[1].program, name) for name in names]}
    names = added(after[0].stack, before[0].stack) if released else ()
    if not names:
        return None
    return {"second": False, "names": list(names), "pull": [_pull(before[1].program, name) for name in names]}


def added(before: Stack, after: Stack) -> tuple[str, ...]:
    """Equalities on motion that one stack has and another one does not, () where they differ in anything else."""
    new = {e.name: e for e in after if e.name not in before}
    if not new or not all(e.equality and e.quantity == "motion" for e in new.values()):
        return ()
    if [e for e in after.subject_to if e.name not in new] != list(before.subject_to):
        return ()
    kept = [level for level in after.levels if any(e.name not in new for e in level)]
    if len(kept) != len(before.levels):
        return ()
    for level, old in zip(kept, before.levels, strict=True):
        if level != old and level.replace(*(e for e in level if e.name not in new)) != old:
            return ()
    return tuple(new)


def _pull(program: Program, name: str) -> list[float]:
    """Pull of each row of an element, with b = ... - pull e linear in the error e, else []."""
    place, member = program.places[name], program.assembly.members[name]
    rows = program.problem.levels[place.level]
    gain = member.law.gain if isinstance(member.law, P) else getattr(member.law, "kp", None)
    bound = None if member.law is None else min(member.law.max_velocity, member.law.max_acceleration)
    if gain is None or bound != math.inf or program.kind == "torque" or isinstance(rows.A, Selection):
        return []
    gains = np.broadcast_to(np.asarray(gain, dtype=np.float64), rows.lower[place.part].shape)
    return [float(x) for x in np.broadcast_to(place.element.weight * gains, gains.shape)]
