"""Stacks on the path of a transition: if x is a torque, contacts change only while they bear nothing.

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
from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from hqp.declare.element import Constraint, Element, selection_of
from hqp.declare.law import PD, Law
from hqp.declare.robot import Robot
from hqp.declare.stack import Level, Stack, coupled
from hqp.errors import DeclarationError
from hqp.loop.transition.surviving import same_quantity


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
    asked = [e for e in stack if getattr(e, "contact", None) in sizes]
    gone = [e.name for e in asked if not allows_zero(e, sizes[e.contact])]  # type: ignore[attr-defined]
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
