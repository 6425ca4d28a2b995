"""References: where an element should be at one tick, as a value with velocity and acceleration feedforward."""

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

    value: what ``Element.value`` returns; None keeps the hold value.  velocity, acceleration: ``(k,)``, zero by
    default.  normal, gravity_normal: ``(3,)`` ground normals of a wheel, world axes.  load: what the contact was
    measured to carry [N], see ``loaded``.  remarks: what its source has to say, which becomes notes of the tick.
    on: whether the element is in this tick, None for what the phase says; see ``Element.off``.
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
        """The same with the measured load of the contact [N]: ``foot.at().loaded(312.0)``.

        A contact that carries nothing for a while ends the tick in ``Status.CONTACT_LOST``; NaN is no measurement.
        """
        return Reference(**{**vars(self), "load": float(load)})

    def aiming_at(self, value: Vec | Mat | None) -> Reference:
        """The same with another value."""
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
        # past the frozen class's __setattr__, which costs a tick too much; what is not given stays the class's default
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
        """Whether no number is NaN or infinite."""
        for part in (self.value, self.velocity, self.acceleration, self.normal, self.gravity_normal):
            if part is not None:
                flat = part.ravel()
                if not float(flat @ flat) < np.inf:
                    return False
        return True


_new = object.__new__


def target(name: str, value: Vec | Mat) -> Reference:
    """A reference of a value alone, at two thirds of what ``Reference(name, value)`` costs."""
    made = _new(Reference)
    fields = made.__dict__
    fields["name"], fields["value"] = name, value
    return made


def copied(reference: Reference) -> Reference:
    """The same with numbers of its own, whatever becomes of the arrays that were given."""
    return Reference(**{name: copy(part) for name, part in vars(reference).items()})


def numbers(element: str, what: str, value: object, shape: tuple[int, ...]) -> Vec:
    """A float64 copy of ``value``, of that shape; raises DeclarationError naming what was given."""
    try:
        array = value.copy() if isinstance(value, np.ndarray) and value.dtype is FLOAT else np.array(value, FLOAT)
    except (TypeError, ValueError, OverflowError) as error:
        raise DeclarationError(element, f"{what} is not numeric", value=value) from error
    if array.shape != shape:
        raise DeclarationError(element, f"{what} has shape {array.shape}", allowed=f"shape {shape}")
    return array
