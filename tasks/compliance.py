"""A point that gives way to the force on it: impedance and admittance, and a force along an axis."""

from __future__ import annotations

import math
from abc import abstractmethod
from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from numpy.typing import ArrayLike

from hqp.arrays import Vec
from hqp.declare.law import PD, Law, P
from hqp.declare.reference import Given, Reference, numbers

from .position import Position

Numbers = float | Sequence[float]
"""One number, or one for each axis."""


@dataclass(frozen=True, kw_only=True)
class _Compliant(Position):
    """Common base: a spring, a damper, and the force that moves them."""

    stiffness: Numbers = 500.0
    damping: Numbers

    def __post_init__(self) -> None:
        super().__post_init__()
        self._set("stiffness", least=0.0)
        self._complete()
        self._set("damping", least=math.ulp(0.0))
        law = self._law()
        if self.law is not None and self.law != law:
            raise self.invalid("law", self.law, "none, stiffness and damping define the law")
        object.__setattr__(self, "law", law)

    def _complete(self) -> None:
        """Check the stiffness and complete the fields that follow from it."""

    @abstractmethod
    def _law(self) -> Law:
        """Spring and damper as gains."""

    def _set(self, name: str, least: float) -> None:
        """Check a number for each axis, and keep it as such."""
        given = getattr(self, name)
        try:
            values = np.broadcast_to(np.asarray(given, dtype=np.float64), (len(self.axes),)).tolist()
        except (TypeError, ValueError, OverflowError):
            values = [math.nan]
        if not all(least <= x < math.inf for x in values):
            above = "0 or above" if least == 0.0 else "above 0"
            raise self.invalid(name, given, f"one number, or one for each of {self.axes!r}: {above}, finite")
        object.__setattr__(self, name, self._kept(np.asarray(given, dtype=np.float64)))

    @staticmethod
    def _kept(values: Vec) -> Numbers:
        """Return a field value: a number or a tuple."""
        found: float | list[float] = values.tolist()
        return tuple(found) if isinstance(found, list) else found

    def _yields(self, force: ArrayLike | None, bears: ArrayLike | None, over: Numbers, given: Given) -> Vec | None:
        """A feedforward more by (force - bears) / over."""
        if force is None and bears is None:
            return None if given is None else numbers(self.name, "feedforward", given, (len(self.axes),))
        size = (len(self.axes),)
        pull = np.zeros(size) if force is None else numbers(self.name, "force", force, size)
        if bears is not None:
            pull -= numbers(self.name, "bears", bears, size)
        pull /= np.asarray(over)
        return pull if given is None else pull + numbers(self.name, "feedforward", given, size)


@dataclass(frozen=True, kw_only=True)
class Impedance(_Compliant):
    """A point of a frame that moves as a mass on a spring and a damper under the force f on it:

        M (dv/dt - a_ref) + D (v - v_ref) + K (p - p_ref) = f - f_ref

    rows J qdd + dJ/dt v = a_ref + (f - f_ref) / M - (D / M)(v - v_ref) - (K / M) e, a number each for every axis.  If K
    is 0 the point follows f_ref: it comes to rest where the world bears it.  frame, axes, offset, relative_to, heading:
    see Position.  stiffness: K [N/m].  mass: M [kg].  damping: D [N s/m], 2 sqrt(K M) by default.  For accelerations
    and torques; for torques, let an ``ExternalWrench`` pass the force to the dynamics too.  f is measured by a sensor
    or a MomentumObserver.  Raises DeclarationError for fields (Hogan 1985).
    """

    damping: Numbers | None = None  # type: ignore[assignment]
    mass: Numbers = 5.0

    def _complete(self) -> None:
        self._set("mass", least=math.ulp(0.0))
        if self.damping is None:
            critical = 2.0 * np.sqrt(np.asarray(self.stiffness) * np.asarray(self.mass))
            object.__setattr__(self, "damping", self._kept(critical))

    def _law(self) -> PD:
        K, D, M = (np.broadcast_to(np.asarray(x), (len(self.axes),)) for x in (self.stiffness, self.damping, self.mass))
        return PD(tuple((K / M).tolist()), tuple((D / M).tolist()))

    def at(
        self,
        value: Given = None,
        *,
        velocity: Given = None,
        acceleration: Given = None,
        force: ArrayLike | None = None,
        bears: ArrayLike | None = None,
    ) -> Reference:
        """p_ref, v_ref, a_ref, the force on the robot and the one that it is to bear, ``(k,)`` each [N].

        force, bears: f and f_ref in the axes of the value, zero by default.  Raises DeclarationError for shapes.
        """
        return super().at(value, velocity=velocity, acceleration=self._yields(force, bears, self.mass, acceleration))


@dataclass(frozen=True, kw_only=True)
class Admittance(_Compliant):
    """A point of a frame that gives way to the force f on it as a spring and a damper do, where x is a velocity:

        D (v - v_ref) + K (p - p_ref) = f - f_ref,       rows J x = v_ref + (f - f_ref) / D - (K / D) e

    a number each for every axis.  If K is 0 the point moves at (f - f_ref) / D until the world bears f_ref; on a
    surface of stiffness k f follows at k / D [1/s], so D is to be well above k times the delay of the loop.  Other
    fields and ``at`` as of ``Impedance``; damping: D [N s/m].  Raises DeclarationError for fields (Whitney 1977).
    """

    def _law(self) -> P:
        K, D = (np.broadcast_to(np.asarray(x), (len(self.axes),)) for x in (self.stiffness, self.damping))
        return P(tuple((K / D).tolist()))

    def at(  # type: ignore[override]
        self,
        value: Given = None,
        *,
        velocity: Given = None,
        force: ArrayLike | None = None,
        bears: ArrayLike | None = None,
    ) -> Reference:
        """p_ref, v_ref, the force on the robot and the one that it is to bear, ``(k,)`` each [m, m/s, N]."""
        return super().at(value, velocity=self._yields(force, bears, self.damping, velocity))
