"""The stack: levels in strict order, each of tasks and constraints of one priority."""

from __future__ import annotations

import dataclasses
from collections.abc import Iterable, Iterator, Mapping, Sequence
from typing import Any, TypeVar, overload

from hqp.declare.element import Element, phase_names
from hqp.declare.law import Law
from hqp.declare.price import Price, Priced, as_price
from hqp.declare.robot import Robot
from hqp.errors import DeclarationError, closest
from hqp.kinds import require

E = TypeVar("E", bound=Element)


class Level:
    """Members of one priority.

    price: price on motion of the level if it is out of reach, a Price, 0 for the exact problem, None for the default
    (docs/calm.md).  when: phases in which its members are in, all for none.  Raises DeclarationError for a member that
    is no task or constraint, or a bad price.
    """

    __slots__ = ("elements", "name", "price", "when")

    def __init__(
        self, *elements: Element, name: str = "", price: Priced = None, when: str | Sequence[str] = ()
    ) -> None:
        for element in elements:
            if not isinstance(element, Element):
                raise DeclarationError(f"level {name or '?'}", "not a task or constraint", value=element)
        self.elements = elements
        self.name = name
        self.price: Price | None = as_price(f"level {name or '?'}", price)
        self.when = phase_names(f"level {name or '?'}", when)

    def replace(self, *elements: Element, name: str | None = None) -> Level:
        """Return the level with other members."""
        return Level(*elements, name=self.name if name is None else name, price=self.price, when=self.when)

    def __iter__(self) -> Iterator[Element]:
        return iter(self.elements)

    def __eq__(self, other: object) -> bool:
        return isinstance(other, Level) and self._key == other._key

    def __hash__(self) -> int:
        return hash(self._key)

    @property
    def _key(self) -> tuple[object, ...]:
        return self.elements, self.name, self.price, self.when

    @property
    def title(self) -> str:
        """Its name, or those of its elements where it has none."""
        return self.name or str(self)

    def __str__(self) -> str:
        return " + ".join(e.name for e in self.elements)

    def __repr__(self) -> str:
        members = ", ".join(map(repr, self.elements))
        price = "" if self.price is None else f", price={self.price!r}"
        when = f", when={self.when!r}" if self.when else ""
        return f"Level({members}, name={self.name!r}{price}{when})"


class Stack:
    """Levels, most important first, under ``subject_to`` constraints that come before all of them.

    Raises DeclarationError for an empty stack, an empty level, names that occur twice, or a wrong member.
    """

    __slots__ = ("_by_name", "levels", "subject_to")

    def __init__(self, *levels: Level, subject_to: Sequence[Element] = ()) -> None:
        self.levels = tuple(levels)
        if isinstance(subject_to, Element) or not isinstance(subject_to, Iterable):
            raise DeclarationError("subject_to", "not a list", value=subject_to, allowed="[JointLimits(), ...]")
        self.subject_to = tuple(subject_to)
        for level in self.levels:
            if not isinstance(level, Level):
                raise DeclarationError("stack", "not a Level", value=level, allowed="Level(task, ...)")
            if not level.elements:
                raise DeclarationError(f"level {level.name or '?'}", "is empty", allowed="at least one task")
        for element in self.subject_to:
            if not isinstance(element, Element):
                raise DeclarationError("subject_to", "not a task or constraint", value=element)
        if not self.levels and not self.subject_to:
            raise DeclarationError("stack", "is empty", allowed="at least one Level or one constraint")
        self._by_name: dict[str, Element] = {}
        for element in self:
            if element.name in self._by_name:
                raise DeclarationError("stack", "duplicate name", value=element.name, allowed="name=... on one")
            self._by_name[element.name] = element

    def __iter__(self) -> Iterator[Element]:
        yield from self.subject_to
        for level in self.levels:
            yield from level

    @overload
    def find(self, name: str) -> Element: ...
    @overload
    def find(self, name: str, kind: type[E]) -> E: ...
    def find(self, name: str, kind: type[Any] = Element) -> Any:
        """The element of that name and type; raises DeclarationError with the closest names."""
        element = self._by_name.get(name) if isinstance(name, str) else None
        if element is None:
            near = ", ".join(closest(name, self._by_name) or self._by_name)
            raise DeclarationError("stack", "unknown element", value=name, allowed=near)
        if not isinstance(element, kind):
            raise DeclarationError(name, f"is a {type(element).__name__}", value=kind.__name__)
        return element

    def __contains__(self, name: object) -> bool:
        return name in self._by_name

    def phases(self) -> tuple[str, ...]:
        """The phases that its levels and elements name, in order."""
        found = dict.fromkeys(name for level in self.levels for name in level.when)
        return tuple(found | dict.fromkeys(name for element in self for name in element.when))

    def out_of(self, phase: str | None) -> frozenset[str]:
        """Names of the elements that are not in that phase, None for no phase at all."""

        def within(when: Sequence[str]) -> bool:
            return not when or phase in when

        levels = {e.name for level in self.levels if not within(level.when) for e in level}
        return frozenset(levels | {e.name for e in self if not within(e.when)})

    def without(self, *names: str) -> Stack:
        """The stack without those elements; levels left empty vanish.  Raises DeclarationError for a stranger."""
        for name in names:
            self.find(name)
        levels = (level.replace(*(e for e in level if e.name not in names)) for level in self.levels)
        return Stack(
            *(level for level in levels if level.elements),
            subject_to=[e for e in self.subject_to if e.name not in names],
        )

    def with_laws(self, laws: Mapping[str, Law]) -> Stack:
        """The stack with other laws for the named elements; raises DeclarationError for a stranger."""
        return self.replace(*(dataclasses.replace(self.find(name), law=law) for name, law in laws.items()))

    def replace(self, *elements: Element) -> Stack:
        """The stack with these elements in place of those of the same name."""
        new = {e.name: e for e in elements}
        for name in new:
            self.find(name)
        return Stack(
            *(level.replace(*(new.get(e.name, e) for e in level)) for level in self.levels),
            subject_to=[new.get(e.name, e) for e in self.subject_to],
        )

    def __eq__(self, other: object) -> bool:
        return isinstance(other, Stack) and (self.levels, self.subject_to) == (other.levels, other.subject_to)

    def __hash__(self) -> int:
        return hash((self.levels, self.subject_to))

    def __str__(self) -> str:
        levels = " > ".join(map(str, self.levels))
        constraints = ", ".join(e.name for e in self.subject_to)
        return levels + (f"   s.t. {constraints}" if constraints else "")

    def __repr__(self) -> str:
        levels = ", ".join(map(repr, self.levels))
        return f"Stack({levels}, subject_to={list(self.subject_to)!r})"


def require_stack(owner: str, stack: object) -> None:
    """Raise DeclarationError for anything but a Stack."""
    require(owner, "stack", stack, Stack, "Stack(Level(...), ...)")


def coupled(stack: Stack, robot: Robot) -> Stack:
    """The stack under the robot's own couplings too (mimic joints, closures), but for those it binds already.

    Elements get the data that they take from others of the stack; raises DeclarationError where it is not there.
    """
    members = tuple(stack)
    filled = [new for old in members if (new := old.among(members)) is not old]
    stack = stack.replace(*filled) if filled else stack
    stack = _accompanied(stack, robot)
    held = {_bound(e) for e in stack}
    own = [c for c in robot.couplings if _bound(c) not in held and c.name not in stack]
    return Stack(*stack.levels, subject_to=(*own, *stack.subject_to)) if own else stack


def _accompanied(stack: Stack, robot: Robot) -> Stack:
    """Return the stack with the companions of its elements on that robot, each behind its element, without the classes
    in its ``left_out``."""
    kinds = {type(element) for element in stack}

    def behind(elements: Iterable[Element]) -> list[Element]:
        brought = [c for e in elements for c in e.companions(robot) if type(c) not in kinds]
        return [*elements, *brought]

    hard, levels = behind(stack.subject_to), [behind(level) for level in stack.levels]
    if sum(map(len, levels)) + len(hard) == len(tuple(stack)):
        return stack
    return Stack(*(old.replace(*new) for old, new in zip(stack.levels, levels, strict=True)), subject_to=hard)


def _bound(element: Any) -> object:
    """Coefficients by joint, scaled so that the first joint by name has 1; the two frames of a closure."""
    if hasattr(element, "coefficients"):
        pairs = sorted(dict(element.coefficients).items())
        return frozenset((joint, round(value / pairs[0][1], 9)) for joint, value in pairs)
    if hasattr(element, "closed"):
        return frozenset((element.frame, element.relative_to))
    return None
