"""Several stacks of a session in one file, and the ways from each to each."""

from __future__ import annotations

from collections.abc import Mapping
from typing import TYPE_CHECKING, Any

from hqp.arrays import Vec
from hqp.declare.stack import Stack
from hqp.errors import DeclarationError
from hqp.loop.transition.way import way_parts

if TYPE_CHECKING:
    from hqp.loop.compiled import Compiled
    from hqp.loop.document import Writer


def several(writer: Writer, first: Compiled, stacks: Mapping[str, Stack]) -> tuple[dict[str, Any], list[Vec]]:
    """The trees of these stacks and of those on the way between them, beside the first one, and their scratch arrays.

    Raises DeclarationError for a name that is not a text, and what ``Session.change`` raises.
    """
    if wrong := [name for name in stacks if not isinstance(name, str) or not name]:
        raise DeclarationError("export", "bad name of a stack", value=wrong[0], allowed='texts but ""')
    named: dict[str, Stack] = {"": writer.declared(first), **stacks}
    known: list[tuple[Stack, Compiled]] = [(named[""], first)]
    trees: list[dict[str, Any]] = []
    scratch: list[Vec] = []

    def place(stack: Stack, name: str = "") -> int:
        for k, (each, _) in enumerate(known):
            if each == stack and not name:
                return k
        compiled, tree, more = writer.another(stack)
        known.append((stack, compiled))
        trees.append({**tree, "name": name})
        scratch.extend(more)
        return len(known) - 1

    places = [0, *(place(stack, name) for name, stack in stacks.items())]
    ways = []
    for i, start in enumerate(places):
        for j, end in enumerate(places):
            before, after = known[start][1], known[end]
            points = writer.way(before, after[0])
            through = [start, *(place(point.stack) for point in points[1:-1]), end]
            compiled = [known[k][1] for k in through]
            ways.append({"from": i, "to": j, "through": through, **way_parts(points, compiled, before.robot)})
    return {"stacks": trees, "ways": ways}, scratch
