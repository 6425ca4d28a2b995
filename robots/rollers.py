"""The passive rollers of an omnidirectional wheel: one row of ellipsoids, long axis tangential.

Their number is the real robot's; shape and distance make the wheel's rim round to 0.1 mm. The mass is an estimate: the
table's wheel includes it, so the hub gets the remainder.
"""

from __future__ import annotations

import xml.etree.ElementTree as ET
from collections.abc import Iterator

import numpy as np

from .tables import Array, rotation, text

NUMBER = 18
CENTRE = 0.088  # distance of a roller's centre from the axle [m]
MASS = 0.010  # [kg]
SEMI_AXES = np.array([0.013, 0.013, 0.0362])  # the last one tangential [m]
DAMPING = 1e-5  # damping of a roller's hinge [N m s/rad]


def add_rollers(body: ET.Element, wheel: str, axle: Array) -> None:
    """Put the rollers, each on a hinge, under a wheel's hub."""
    for k, (centre, tangent) in enumerate(_frames(axle)):
        name = f"{wheel}_roller_{k}"
        # the body's z axis lies along the tangent, so that inertia and ellipsoid are diagonal in it
        roller = ET.SubElement(body, "body", name=name, pos=text(centre), zaxis=text(tangent))
        ET.SubElement(roller, "inertial", pos="0 0 0", mass=text(MASS), diaginertia=text(_principal()))
        ET.SubElement(roller, "joint", name=name, axis="0 0 1", damping=text(DAMPING))
        tread = {"class": "contact", "name": name, "type": "ellipsoid", "size": text(SEMI_AXES), "group": "1"}
        ET.SubElement(roller, "geom", tread)


def inertia_about_hub(axle: Array) -> Array:
    """Inertia of all rollers about the hub (3, 3) [kg m^2]."""
    across, _, along = _principal()
    total = np.zeros((3, 3))
    for centre, tangent in _frames(axle):
        total += across * np.eye(3) + (along - across) * np.outer(tangent, tangent)
        total += MASS * (centre @ centre * np.eye(3) - np.outer(centre, centre))
    return total


def _frames(axle: Array) -> Iterator[tuple[Array, Array]]:
    """Centre and tangent of every roller in the wheel's axes; the first one is lowest."""
    down = np.array([0.0, 0.0, -1.0])
    for k in range(NUMBER):
        radial = rotation(axle, 2 * np.pi * k / NUMBER) @ down
        yield CENTRE * radial, np.cross(axle, radial)


def _principal() -> Array:
    """Principal inertia of a solid ellipsoid (3,) [kg m^2]."""
    x, y, z = SEMI_AXES**2
    return MASS / 5 * np.array([y + z, x + z, x + y])
