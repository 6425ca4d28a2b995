"""Step adjustment after a push: a step that meets the divergent component of motion as it is."""

from __future__ import annotations

import math
from dataclasses import astuple, dataclass

import numpy as np

from hqp import _session
from hqp.arrays import Vec
from hqp.walking.footsteps import Foothold, Footsteps


@dataclass(frozen=True, kw_only=True)
class Landing:
    """Plan of a swing: the step, where the DCM is to be then, and the time left for it [s].

    stance: the foot on the ground, where the plan has the ZMP.  offset: offset of the DCM from the foothold at the
    landing ``(2,)`` [m].
    """

    stance: Foothold
    foothold: Foothold
    offset: Vec
    left: float

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
    value without a push [s].  least [m]: an error at the landing that no step answers.
    """
    found, left = _session.adjusted(
        astuple(planned.stance), astuple(planned.foothold), _two(planned.offset), planned.left, footsteps.period,
        astuple(footsteps.reach), _two(error), _two(ankle), omega, _two(now), (soonest, latest, usual, speed, least),
    )  # fmt: skip
    return Foothold(*found), left


def _two(given: Vec) -> tuple[float, float]:
    x, y = np.asarray(given, dtype=np.float64).tolist()
    return x, y
