"""Path of a transition for native code: its stacks, the values that each takes over, and the eased rows.

A torque that counts on the ground under a foot throws the foot once it is free, so answers for two sets of contacts may
only be blended while the difference bears nothing.  A release goes through three pairs:

1. with the contact, it is unloaded below all tasks (its force becomes (1 - h) times its former value);
2. once it bears nothing the contact leaves the dynamics and becomes a task, J qdd + dJ/dt qd = 0, before all others:
   both have the same answer, so this takes one tick.  A contact that cannot be unloaded without cost to a task keeps
   the transition waiting, and a note reports it;
3. without the contact, that task goes.

A contact is taken up by these three steps in reverse order.
"""

from __future__ import annotations

import dataclasses
import math
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, fields, is_dataclass
from typing import Any, Protocol

import numpy as np

from hqp.declare.element import Constraint, Element, selection_of
from hqp.declare.law import PD, Law, P
from hqp.declare.reference import Reference
from hqp.declare.robot import Robot
from hqp.declare.stack import Level, Stack, coupled
from hqp.errors import DeclarationError
from hqp.problem import Selection
from hqp.programs.formulation import Program


def surviving(before: Stack, after: Stack) -> tuple[str, ...]:
    """Names of the elements of a stack that another one has with the same hold value."""
    return tuple(e.name for e in after if e.name in before and same_quantity(e, before.find(e.name)))


def surviving_holds(before: Stack, holds: Mapping[str, Reference], after: Stack) -> dict[str, Reference]:
    """The hold values of one stack that are good for another."""
    return {name: holds[name] for name in surviving(before, after) if name in holds}


def same_quantity(one: Element, other: Element) -> bool:
    """Return true if hold values are interchangeable: class and all fields except name, law, weight and when agree."""
    if one is other:
        return True
    if type(one) is not type(other) or not is_dataclass(one):
        return False
    names = [item.name for item in fields(one) if item.name not in ("name", "law", "weight", "when")]
    return all(getattr(one, name) == getattr(other, name) for name in names)


def without_successor(before: Stack, after: Stack) -> tuple[Element, ...]:
    """Contacts in ``subject_to`` of one stack that another one does not have there."""
    kept = {e.name: e for e in after.subject_to}
    contacts = (e for e in before.subject_to if e.is_contact)
    return tuple(e for e in contacts if e.name not in kept or not same_quantity(e, kept[e.name]))


@dataclass(frozen=True)
class Waypoint:
    """A stack on the path of a transition.

    switch: true if the set of reaction constraints changes on the way to the next one.  released, taken: constraints
    that go and come then.
    """

    stack: Stack
    switch: bool = False
    released: tuple[str, ...] = ()
    taken: tuple[str, ...] = ()


def path(before: Stack, after: Stack, robot: Robot, contact_law: Law | None) -> list[Waypoint]:
    """Stacks of a transition, first and last included; more than two only at torque level with other reactions.

    contact_law: law of reaction constraints, None if contacts are rows.  Raises DeclarationError if no contact would be
    left on the way.
    """
    if contact_law is None:
        return [Waypoint(before), Waypoint(after)]
    before, after = coupled(before, robot), coupled(after, robot)
    old, new = ({e.name: e for e in stack.subject_to if reacts(e)} for stack in (before, after))
    kept = {name for name, e in old.items() if name in new and same_quantity(e, new[name])}
    released, taken = ([e for name, e in some.items() if name not in kept] for some in (old, new))
    if released and taken and robot.floating and not any(old[name].is_contact for name in kept):
        raise DeclarationError(
            "change",
            f"the transition from {', '.join(old)} to {', '.join(new)} would pass a stack without contacts",
            allowed="add the new contacts in one change and remove the old ones in the next, or over=0",
        )
    found = [Waypoint(before)]
    if released:
        rest = without_force(after, taken)
        found.append(Waypoint(unloaded(before, released, robot), True, tuple(e.name for e in released)))
        found.append(Waypoint(carried(rest, released, PD(0.0, 0.0))))
    if taken:
        rest = without_force(after, taken) if released else before
        found.append(Waypoint(carried(rest, taken, contact_law), True, taken=tuple(e.name for e in taken)))
        found.append(Waypoint(unloaded(after, taken, robot)))
    return [*found, Waypoint(after)]


def reacts(element: Element) -> bool:
    """Return true if a member of ``subject_to`` acts by a force when x is a torque."""
    return isinstance(element, Constraint) and element.equality and element.quantity == "motion"


def without_force(stack: Stack, contacts: Sequence[Element]) -> Stack:
    """The stack without those contacts and without demands on their force."""
    names = {e.name for e in contacts}
    return stack.without(*(e.name for e in stack if e.name in names or getattr(e, "contact", None) in names))


def carried(stack: Stack, contacts: Sequence[Element], law: Law) -> Stack:
    """The stack with those contacts as tasks before all others: they keep their place without a force."""
    tasks = [dataclasses.replace(e, name=f"{e.name} carried", law=law) for e in contacts]
    return Stack(Level(*tasks, name="carried", price=0), *stack.levels, subject_to=stack.subject_to)


def unloaded(stack: Stack, contacts: Sequence[Element], robot: Robot) -> Stack:
    """The stack with those contacts unloaded, as far as that costs no task on motion.

    Other demands on their force go, except limits that hold at zero force (a friction cone).
    """
    from hqp.tasks import ContactForce
    from hqp.tasks.targets import COMPONENTS

    sizes = {}
    for contact in contacts:
        basis = getattr(contact, "force_basis", None)
        sizes[contact.name] = contact.rows(robot) if basis is None else np.shape(basis())[0]
    permitted = [e for e in stack if getattr(e, "contact", None) in sizes]
    gone = [e.name for e in permitted if not allows_zero(e, sizes[e.contact])]  # type: ignore[attr-defined]
    rest = stack.without(*gone) if gone else stack
    zero = [
        ContactForce(contact=name, components=COMPONENTS[:size], name=f"{name} bears nothing")
        for name, size in sizes.items()
    ]
    levels, at = list(rest.levels), 0
    while at < len(levels) and any(e.quantity == "motion" for level in levels[at:] for e in level):
        at += 1
    for k in range(at - 1, -1, -1):  # last postures have no price, and keep none with a level below them
        if levels[k].price is not None or any(selection_of(e, robot) is None for e in levels[k]):
            break
        levels[k] = Level(*levels[k], name=levels[k].name, price=0, when=levels[k].when)
    levels.insert(at, Level(*zero, name="unloaded", price=0))
    return Stack(*levels, subject_to=rest.subject_to)


def allows_zero(element: Element, size: int) -> bool:
    """Return true if limits on a contact force with ``size`` components hold at zero force; a target is no limit."""
    maker = getattr(element, "force_rows", None)
    if maker is None or element.equality:
        return False
    _, lower, upper = maker(size)
    return bool(np.all(lower <= 0.0) and np.all(upper >= 0.0))


LIGHT = 0.25
"""A contact that was measured to bear no more than this share of the weight is let go as it is."""


class Ready(Protocol):
    """Interface of a compiled stack."""

    @property
    def stack(self) -> Stack: ...
    @property
    def program(self) -> Program: ...


def way_parts(points: Sequence[Waypoint], compiled: Sequence[Ready], robot: Robot) -> dict[str, Any]:
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
    first: tuple[Waypoint, Ready],
    before: tuple[Waypoint, Ready],
    stop: tuple[Waypoint, Ready],
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


def eased(before: tuple[Waypoint, Ready], after: tuple[Waypoint, Ready], *, released: bool) -> dict[str, Any] | None:
    """The rows that only one stack of a pair has, None if the stacks differ in more than these.

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
    """Equalities on motion that ``after`` adds to ``before``, () if the stacks differ in anything else."""
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
