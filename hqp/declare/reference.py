"""References: desired value of an element for one tick, with velocity and acceleration feedforward."""

from __future__ import annotations

from copy import copy
from dataclasses import dataclass
from typing import TypeAlias

import numpy as np
from numpy.typing import ArrayLike

from hqp.arrays import FLOAT, Mat, Vec
from hqp.errors import DeclarationError

Given: TypeAlias = "ArrayLike | None"
"""Numbers that may be left out."""


@dataclass(frozen=True, eq=False)
class Reference:
    """A target for the element of that name, good for one tick.

    value: see ``Element.value``; None keeps the hold value.  velocity, acceleration: ``(k,)``, zero by default.
    normal, gravity_normal: ``(3,)`` ground normals of a wheel, world axes.  load: measured load of the contact [N], see
    ``loaded``.  remarks: remarks of its source, which become notes of the tick.  on: true or false switches the
    element, None leaves it to the phase; see ``Element.off``.
    """

    name: str
    value: Vec | Mat | None = None
    velocity: Vec | None = None
    acceleration: Vec | None = None
    normal: Vec | None = None
    gravity_normal: Vec | None = None
    load: float | None = None
    remarks: tuple[str, ...] = ()
    on: bool | None = None

    def loaded(self, load: float) -> Reference:
        """Return a copy with the measured load of the contact [N]: ``foot.at().loaded(312.0)``.

        A contact that carries nothing for a while ends the tick in ``Status.CONTACT_LOST``; NaN is no measurement.
        """
        return Reference(**{**vars(self), "load": float(load)})

    def aiming_at(self, value: Vec | Mat | None) -> Reference:
        """Return a copy with another value."""
        return Reference(**{**vars(self), "value": value})

    def __init__(
        self,
        name: str,
        value: Vec | Mat | None = None,
        velocity: Vec | None = None,
        acceleration: Vec | None = None,
        normal: Vec | None = None,
        gravity_normal: Vec | None = None,
        load: float | None = None,
        remarks: tuple[str, ...] = (),
        on: bool | None = None,
    ) -> None:
        # past the frozen class's __setattr__, which costs a tick too much; missing fields keep the class's default
        fields = self.__dict__
        fields["name"] = name
        if value is not None:
            fields["value"] = value
        if velocity is not None:
            fields["velocity"] = velocity
        if acceleration is not None:
            fields["acceleration"] = acceleration
        if normal is not None:
            fields["normal"] = normal
        if gravity_normal is not None:
            fields["gravity_normal"] = gravity_normal
        if load is not None:
            fields["load"] = load
        if remarks:
            fields["remarks"] = remarks
        if on is not None:
            fields["on"] = on

    @property
    def finite(self) -> bool:
        """True if no number is NaN or infinite."""
        for part in (self.value, self.velocity, self.acceleration, self.normal, self.gravity_normal):
            if part is not None:
                flat = part.ravel()
                if not float(flat @ flat) < np.inf:
                    return False
        return True


_new = object.__new__


def target(name: str, value: Vec | Mat) -> Reference:
    """Make a reference with a value only, at two thirds of the cost of ``Reference(name, value)``."""
    made = _new(Reference)
    fields = made.__dict__
    fields["name"], fields["value"] = name, value
    return made


def copied(reference: Reference) -> Reference:
    """Return a copy with its own arrays."""
    return Reference(**{name: copy(part) for name, part in vars(reference).items()})


def numbers(element: str, what: str, value: object, shape: tuple[int, ...], remedy: str = "") -> Vec:
    """A float64 copy of ``value``, of that shape; raises DeclarationError with the given value and the remedy."""
    allowed = f"shape {shape}{remedy and ': '}{remedy}"
    try:
        array = value.copy() if isinstance(value, np.ndarray) and value.dtype is FLOAT else np.array(value, FLOAT)
    except (TypeError, ValueError, OverflowError) as error:
        raise DeclarationError(element, f"{what} is not numeric", value=value, allowed=allowed) from error
    if array.shape != shape:
        raise DeclarationError(element, f"{what} has shape {array.shape}", allowed=allowed)
    return array
