"""Map a stack to the levels of a hierarchy: the order of ``subject_to``, contacts before the tasks of a level."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

from hqp.declare.element import Constraint, Element, selection_of
from hqp.declare.price import Price
from hqp.declare.robot import Robot
from hqp.declare.stack import Stack


@dataclass(frozen=True)
class Group:
    """Elements that become one level of the hierarchy.

    selection: every row picks one variable.  constraint: from ``subject_to``.  tasks: true if it holds elements that
    may have a price (a level of contacts or of constraints of ``subject_to`` does not).  price: as declared.
    """

    elements: tuple[Element, ...]
    name: str
    selection: bool
    constraint: bool
    tasks: bool = True
    price: Price | None = None


def lay_out(
    stack: Stack, robot: Robot, *, held: Sequence[Element] = (), torque: bool = False, contacts_first: bool = False
) -> list[Group]:
    """The levels, most important first; empty ones vanish.

    ``subject_to`` comes in physical order, a quantity (force, effort, motion) never in one level with another:

    0. prescribed motion: equalities that each fix one coordinate;
    1. bounds on x: the torque box, or limits of joints if x is a velocity or an acceleration;
    2. contacts and couplings (equalities on the motion);
    3. limits of contact forces [N];
    4. for torques, limits of joints [rad/s^2, m/s^2];
    5. other inequalities, the user's own;
    6. tasks, a level for each quantity: they may have a price, the levels above never.

    held: elements without rows, which the dynamics keep.  torque: true if x is a torque.  contacts_first: put contacts
    of a level with tasks into a separate level before it.
    """

    def selects(elements: Sequence[Element]) -> bool:
        if torque:
            return all(e.quantity == "effort" for e in elements)
        return all(selection_of(e, robot) is not None for e in elements)

    def place(element: Element) -> tuple[int, int]:
        quantity = ("force", "effort", "motion").index(element.quantity)
        if element.equality and not isinstance(element, Constraint):
            return 6, quantity
        if element.quantity == "motion":
            limits = not element.equality and selection_of(element, robot) is not None
            if limits:
                return (4, quantity) if torque else (1, quantity)
            if element.equality:
                return (2 if selection_of(element, robot) is None else 0), quantity
            return 5, quantity
        return (3, quantity) if element.quantity == "force" else (1, quantity)

    members: dict[tuple[int, int], list[Element]] = {}
    for element in stack.subject_to:
        if element not in held:
            members.setdefault(place(element), []).append(element)
    groups = [
        Group(tuple(members[rank]), "subject_to", selects(members[rank]), True, tasks=rank[0] == 6)
        for rank in sorted(members)
    ]
    for level in stack.levels:
        name = level.title
        contacts = tuple(e for e in level.elements if e.is_contact)
        rest = tuple(e for e in level.elements if not e.is_contact)
        if contacts_first and contacts and rest:
            groups.append(Group(contacts, f"{name}: contacts", selects(contacts), False, tasks=False))
            groups.append(Group(rest, name, selects(rest), False, price=level.price))
        else:
            groups.append(Group(level.elements, name, selects(level.elements), False, bool(rest), level.price))
    return groups
