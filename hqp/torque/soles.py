"""Friction cones of soles: the yaw moment that a sole's corners hold, if the stack knows them."""

from __future__ import annotations

from dataclasses import replace

import numpy as np

from hqp.declare.element import Element
from hqp.declare.stack import Stack


def with_soles(stack: Stack) -> Stack:
    """The stack whose friction cones bound the yaw moment by the sole of a ``CenterOfPressure`` of the same contact.

    Cones with a sole or a torsion of their own stay as they are.
    """
    from hqp.tasks import CenterOfPressure, FrictionCone
    from hqp.tasks.polygons import rectangle_in

    corners = {e.contact: e.corners() for e in stack if isinstance(e, CenterOfPressure)}

    def bounded(element: Element) -> Element:
        if not isinstance(element, FrictionCone) or element.torsion is not None or element.sole is not None:
            return element
        known = corners.get(element.contact)
        return replace(element, sole=rectangle_in(known, np.mean(known, axis=0))) if known else element

    levels = (level.replace(*map(bounded, level)) for level in stack.levels)
    return Stack(*levels, subject_to=tuple(map(bounded, stack.subject_to)))
