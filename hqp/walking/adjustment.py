"""Step adjustment after a push: a step that meets the divergent component of motion as it is."""

from __future__ import annotations

import math
from dataclasses import dataclass, replace

import numpy as np

from hqp.arrays import Vec
from hqp.walking.footsteps import Foothold, Footsteps

TIMES = 24
"""Number of landing times compared."""

MEETS = 10.0
"""Weight of the DCM error relative to changes of foothold and time, before squaring."""


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

        MEETS^2 |xi(L) - u - offset|^2 / reach^2 + |u - planned|^2 / reach^2 + (L - usual)^2 / period^2

    is smallest (after Khadiv, Herzog, Moosavian, Righetti 2020, there as a quadratic programme).  now ``(2,)`` [m]:
    present place of the foot, which moves no faster than ``speed`` [m/s].  soonest, latest: bounds of L, usual: its
    value without a push [s].  least [m]: an error at the landing that no step answers.
    """
    stance, nominal = planned.stance, planned.foothold
    turn, zmp = stance.turn, stance.xy
    both = zip((turn.T @ error).tolist(), (turn.T @ ankle).tolist(), strict=True)
    # if the ZMP is beyond the DCM the ankle reduces the error
    axes = [(0.0, 0.0) if e * dz > 0.0 and abs(dz) >= abs(e) else (e, dz) for e, dz in both]
    grown = [dz + (e - dz) * math.exp(omega * planned.left) for e, dz in axes]
    size = math.hypot(*grown)
    if size <= least:
        return nominal, planned.left
    left = np.linspace(soonest, max(latest, soonest), TIMES)
    left = np.append(left, min(max(planned.left, soonest), latest))
    e, dz = np.transpose(axes) * (1.0 - least / size)
    start = turn.T @ (planned.dcm(omega, planned.left) - zmp) + e
    xi = dz + (start - dz) * np.exp(omega * left)[:, None]
    reach, out = footsteps.reach, 1.0 if nominal.side == 0 else -1.0
    step, offset, foot = (turn.T @ v for v in (nominal.xy - zmp, planned.offset, now - zmp))
    low = np.array([-reach.forward, min(out * reach.least, out * reach.most)])
    high = np.array([reach.forward, max(out * reach.least, out * reach.most)])
    far = np.maximum(speed * left[:, None], 1e-3)
    low, high = np.clip(foot - far, low, high), np.clip(foot + far, low, high)
    u = np.clip((MEETS**2 * (xi - offset) + step) / (MEETS**2 + 1.0), low, high)
    wide = np.array([reach.forward, reach.most - reach.least])
    missed, moved = (xi - offset - u) / wide, (u - step) / wide
    cost = MEETS**2 * np.sum(missed**2, axis=1) + np.sum(moved**2, axis=1)
    cost += ((left - usual) / footsteps.period) ** 2
    best = int(np.argmin(cost))
    x, y = zmp + turn @ u[best]
    return footsteps.within(replace(nominal, x=float(x), y=float(y)), stance), float(left[best])
