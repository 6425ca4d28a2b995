"""Checks of declared fields and of references."""

from __future__ import annotations

import math
from collections.abc import Sequence
from functools import cache
from typing import Any

import numpy as np

from hqp.arrays import Index, Mat, Vec
from hqp.declare.element import Element
from hqp.declare.reference import Reference, numbers
from hqp.declare.robot import Robot
from hqp.errors import DeclarationError
from hqp.numbers import set_numbers


@cache
def indices(axes: str) -> list[int]:
    """Positions of the letters of ``axes`` in "xyz"."""
    return ["xyz".index(letter) for letter in axes]


def check_axes(element: Element, axes: object) -> None:
    """Raise DeclarationError unless ``axes`` is made of distinct letters of "xyz"."""
    if not isinstance(axes, str) or not axes or len(set(axes)) < len(axes) or not set(axes) <= set("xyz"):
        raise element.invalid("axes", axes, 'distinct letters of "xyz", such as "xy"')


def check_frame(element: Element, what: str, frame: object) -> None:
    """Raise DeclarationError unless ``frame`` is a name."""
    if not isinstance(frame, str) or not frame:
        raise element.invalid(what, frame, "the name of a frame")


def check_relative(element: Element, relative_to: object, heading: object = False) -> None:
    """Raise DeclarationError unless ``relative_to`` is a name or None, and there is one where ``heading`` is set."""
    if not isinstance(heading, bool):
        raise element.invalid("heading", heading, "True or False")
    if relative_to is not None:
        check_frame(element, "relative_to", relative_to)
    elif heading:
        raise element.invalid("heading", heading, "False, or relative_to=... to name the frame with the heading")


def set_number(element: Element, what: str, low: float = -math.inf, **bounds: Any) -> None:
    """Store a field as a plain number within bounds of ``hqp.numbers.number``; raises DeclarationError."""
    set_numbers(element, element.owner, (what,), low, **bounds)


def set_vector(element: Element, what: str, count: int = 3) -> None:
    """Store a field as a tuple of ``count`` finite floats; raises DeclarationError."""
    value = getattr(element, what)
    try:
        numbers = tuple(float(x) for x in value)
    except (TypeError, ValueError, OverflowError):
        numbers = ()
    if len(numbers) != count or not all(map(math.isfinite, numbers)):
        raise element.invalid(what, value, f"{count} finite numbers")
    object.__setattr__(element, what, numbers)


def set_names(element: Element, what: str) -> None:
    """Store a field as None, a name or a tuple of distinct names; raises DeclarationError."""
    value = getattr(element, what)
    if value is None or (isinstance(value, str) and value):
        return
    try:
        names = () if isinstance(value, (str, dict)) else tuple(value)
    except TypeError:
        names = ()
    if not names or not all(isinstance(n, str) and n for n in names) or len(set(names)) < len(names):
        raise element.invalid(what, value, "None, a name or distinct names")
    object.__setattr__(element, what, names)


def joint_columns(element: Element, robot: Robot, joints: str | Sequence[str] | None) -> Index:
    """Tangent coordinates of joints or groups; raises JointNotFound, DeclarationError where one occurs twice."""
    columns = robot.joints(joints)
    if len(set(columns.tolist())) < columns.size:
        raise element.invalid("joints", joints, "joints and groups that do not overlap")
    return columns


def motor_positions(element: Element, robot: Robot, joints: str | Sequence[str] | None) -> Index:
    """Positions among ``robot.actuated`` of joints or groups, all for None; raises as ``joint_columns``."""
    motors = robot.actuated.tolist()
    if joints is None:
        return np.arange(len(motors), dtype=np.intp)
    columns = joint_columns(element, robot, joints).tolist()
    if not set(columns) <= set(motors):
        raise element.invalid("joints", joints, f"joints with a motor: {', '.join(robot.joint_names)}")
    return np.array([motors.index(column) for column in columns], dtype=np.intp)


def make_reference(
    name: str, rows: int, value: Vec | Mat | None, velocity: Any, acceleration: Any, remarks: Sequence[str] = ()
) -> Reference:
    """A reference with a value already checked; raises DeclarationError for feedforwards not ``(rows,)``."""
    return Reference(
        name,
        value,
        None if velocity is None else numbers(name, "velocity", velocity, (rows,)),
        None if acceleration is None else numbers(name, "acceleration", acceleration, (rows,)),
        remarks=tuple(remarks),
    )


def unit(name: str, what: str, value: Any) -> Vec:
    """A direction of unit length ``(3,)``; raises DeclarationError for a zero one.  One that is not finite stays."""
    vector = numbers(name, what, value, (3,))
    length = math.hypot(*vector.tolist())
    if length == 0.0:
        raise DeclarationError(name, f"{what} is zero", allowed="a direction")
    return vector / length if math.isfinite(length) else vector


def set_normal(element: Element) -> None:
    """Store the field ``normal`` with unit length; raises DeclarationError."""
    given = getattr(element, "normal", None)
    if given is not None:
        set_vector(element, "normal")
        object.__setattr__(element, "normal", tuple(unit(element.name, "normal", given).tolist()))


def with_normal(reference: Reference, normal: Any) -> Reference:
    """The reference with the ground's normal of this tick; raises DeclarationError."""
    return Reference(**{**vars(reference), "normal": unit(reference.name, "normal", normal)})
