"""Step adjustment after a push: a step that meets the divergent component of motion as it is."""

from __future__ import annotations

import math
from dataclasses import astuple, dataclass

import numpy as np

from hqp import _session
from hqp.arrays import Vec
from hqp.declare.reference import numbers
from hqp.kinds import require
from hqp.numbers import number, set_numbers
from hqp.walking.footsteps import FOOTHOLD, Foothold, Footsteps


@dataclass(frozen=True, kw_only=True)
class Landing:
    """Plan of a swing: the step, where the DCM is to be then, and the time left for it [s].

    stance: the foot on the ground, where the plan has the ZMP.  offset: offset of the DCM from the foothold at the
    landing ``(2,)`` [m].  Raises DeclarationError for fields.
    """

    stance: Foothold
    foothold: Foothold
    offset: Vec
    left: float

    def __post_init__(self) -> None:
        for field in ("stance", "foothold"):
            require("landing", field, getattr(self, field), Foothold, FOOTHOLD)
        object.__setattr__(self, "offset", numbers("landing", "offset", self.offset, (2,)))
        set_numbers(self, "landing", ("left",))

    def dcm(self, omega: float, left: float) -> Vec:
        """DCM of the plan at this time before the landing ``(2,)`` [m]."""
        zmp = self.stance.xy
        return np.asarray(zmp + (self.foothold.xy + self.offset - zmp) * math.exp(-omega * left))


def adjust(
    planned: Landing,
    footsteps: Footsteps,
    error: Vec,
    ankle: Vec,
    omega: float,
    *,
    now: Vec,
    soonest: float,
    latest: float,
    usual: float,
    speed: float,
    least: float = 0.0,
) -> tuple[Foothold, float]:
    """Foothold and time left with which the DCM is least off at the landing, then nearest to the planned ones.

    error ``(2,)`` [m]: error of the DCM against ``planned.dcm(omega, planned.left)``.  ankle ``(2,)`` [m]: displacement
    of the ZMP from that of the plan.  If it reduces the error no step is needed; the remaining error is

        xi(L) = z + (xi - z) exp(omega L),   z the ZMP with the ankle's part,

    at the landing, and over times L and footholds u within reach

        10^2 |xi(L) - u - offset|^2 / reach^2 + |u - planned|^2 / reach^2 + (L - usual)^2 / period^2

    is smallest (after Khadiv, Herzog, Moosavian, Righetti 2020, there as a quadratic programme).  now ``(2,)`` [m]:
    present place of the foot, which moves no faster than ``speed`` [m/s].  soonest, latest: bounds of L, usual: its
    value without a push [s].  least [m]: an error at the landing that no step answers.  Raises DeclarationError for
    arguments.
    """
    require("adjust", "planned", planned, Landing, "Landing(...)")
    require("adjust", "footsteps", footsteps, Footsteps, "Footsteps(...)")
    omega, speed = (number("adjust", *named, 0.0, strict=True) for named in (("omega", omega), ("speed", speed)))
    given = (("soonest", soonest), ("latest", latest), ("usual", usual), ("least", least))
    soonest, latest, usual, least = (number("adjust", *named) for named in given)
    found, left = _session.adjusted(
        astuple(planned.stance), astuple(planned.foothold), _two("offset", planned.offset), planned.left,
        footsteps.period, astuple(footsteps.reach), _two("error", error), _two("ankle", ankle), omega,
        _two("now", now), (soonest, latest, usual, speed, least),
    )  # fmt: skip
    return Foothold(*found), left


def _two(what: str, given: Vec) -> tuple[float, float]:
    x, y = numbers("adjust", what, given, (2,)).tolist()
    return x, y
