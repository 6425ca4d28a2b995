"""References of a collision scene's world: poses and velocities of its shapes, by name."""

from __future__ import annotations

from collections.abc import Mapping
from typing import Any

import numpy as np

from hqp.arrays import Mat, Vec
from hqp.declare.element import Element
from hqp.shapes import Shape


def poses(world: tuple[Shape, ...], value: Mat | None = None) -> Mat:
    """Shapes ``(n, 6, 4)``, declared at rest, or as given: pose ``(4, 4)``, then velocity of the origin and angular
    velocity, world axes, three numbers and a zero each."""
    if value is not None and value.shape[1:] == (6, 4):
        return value
    found = np.zeros((len(world), 6, 4))
    found[:, :4] = np.array([s.pose for s in world]).reshape(-1, 4, 4) if value is None else value
    return found


def moved(element: Element, world: tuple[Shape, ...], places: Mapping[str, Any], rates: Mapping[str, Any]) -> Mat:
    """The shapes of an element's world ``(n, 6, 4)`` with these poses and velocities; raises DeclarationError."""
    for what, named in (("poses", places), ("velocity", rates)):
        if not isinstance(named, Mapping):
            raise element.invalid(what, named, 'a table by the name of the shape, such as {"ball": (0.4, 0.0, 0.5)}')
    value = poses(world)
    for name, pose in places.items():
        i, given = _index(element, world, name), _numbers(element, f"pose of {name}", pose)
        if given.shape == (3,):
            value[i, :3, 3] = given
        elif given.shape == (4, 4):
            value[i, :4] = given
        else:
            raise element.invalid(f"pose of {name}", pose, "a matrix (4, 4) or a position (3,) [m]")
    for name, rate in rates.items():
        i, given = _index(element, world, name), _numbers(element, f"velocity of {name}", rate)
        if given.shape not in ((3,), (6,)):
            raise element.invalid(f"velocity of {name}", rate, "(3,) [m/s], or (6,) with an angular velocity [rad/s]")
        value[i, 4, :3] = given[:3]
        value[i, 5, :3] = given[3:] if given.size == 6 else 0.0
    return value


def _numbers(element: Element, what: str, value: Any) -> Vec:
    try:
        return np.asarray(value, dtype=np.float64)
    except (TypeError, ValueError, OverflowError) as error:
        raise element.invalid(what, value, "numbers") from error


def _index(element: Element, world: tuple[Shape, ...], name: str) -> int:
    names = [s.name for s in world]
    if name not in names:
        raise element.invalid("shape", name, ", ".join(names) or "none, the element has no world")
    return names.index(name)
