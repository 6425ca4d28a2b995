"""An axis that an element declares, its orthonormal complement, and references of a point and a direction."""

from __future__ import annotations

import math

import numpy as np

from hqp.arrays import Mat, Vec
from hqp.declare.element import Element
from hqp.declare.reference import Given, Reference, numbers

from .fields import make_reference, set_vector
from .relative import skew

ROW_NAMES = ("x", "y", "z", "tilt 1", "tilt 2")
"""Rows of a point and of the two tilts across an axis."""


def check_axis(element: Element, axis: str | tuple[float, float, float]) -> None:
    """Store the field ``axis``; raises DeclarationError unless it is "x", "y", "z" or a nonzero ``(3,)``."""
    if isinstance(axis, str):
        if axis not in ("x", "y", "z"):
            raise element.invalid("axis", axis, '"x", "y", "z" or three numbers')
        return
    set_vector(element, "axis")
    if not any(axis):
        raise element.invalid("axis", axis, "a nonzero vector")


def with_complement(axis: str | tuple[float, float, float]) -> tuple[Vec, Mat]:
    """Unit axis ``(3,)`` and its orthonormal complement B ``(3, 2)``."""
    given = np.eye(3)["xyz".index(axis)] if isinstance(axis, str) else np.array(axis)
    unit: Vec = given / math.hypot(*given)
    across = skew(unit)
    first: Vec = across[int(np.argmin(np.abs(unit)))]
    first = first / math.hypot(*first)
    return unit, np.column_stack((first, across @ first))


def force_basis(B: Mat) -> Mat:
    """Wrench ``(6, 5)`` of a force ``(3,)`` and of moments along B ``(3, 2)``."""
    basis = np.zeros((6, 5))
    basis[:3, :3], basis[3:, 3:] = np.eye(3), B
    return basis


def line_reference(element: Element, value: Given, velocity: Given, acceleration: Given) -> Reference:
    """Position and unit direction ``(6,)`` with rates ``(5,)``; raises DeclarationError."""
    line = None if value is None else numbers(element.name, "position and direction", value, (6,))
    square = 1.0 if line is None else float(line[3:] @ line[3:])
    if line is not None and math.isfinite(square) and abs(square - 1.0) > 1e-6:
        raise element.invalid("direction", line[3:], "a unit vector")
    return make_reference(element.name, 5, line, velocity, acceleration)
