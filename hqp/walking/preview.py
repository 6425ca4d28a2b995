"""Limits between a velocity command and the next steps: feasible velocities, their rate of change, step times."""

from __future__ import annotations

import math
from dataclasses import dataclass

from hqp.walking.footsteps import Command
from hqp.walking.gait import Gait, Reach

QUICK = 2.0 / 3.0
"""Shortest step time as a share of the gait's: a swing foot of G1 still follows its path to 1 mm."""

COMFORT = 0.6
"""Share of the reach above which steps become quicker instead of longer."""

CHANGE = 0.04
"""Largest change of velocity from step to step as a share of sqrt(g h): 0.1 m/s for G1."""

TURNS = 0.3
"""Largest change of the turning rate from step to step [rad/s]."""


@dataclass(frozen=True, kw_only=True)
class Ability:
    """Limits of a walk on a robot.

    gait, reach: times and reach of steps.  width: distance of the feet side by side [m].  height: of the CoM above the
    ground [m].  gravity [m/s^2].
    """

    gait: Gait
    reach: Reach
    width: float
    height: float
    gravity: float

    @property
    def change(self) -> float:
        """Largest change of velocity from step to step [m/s]."""
        return CHANGE * math.sqrt(self.gravity * self.height)

    def allowed(self, requested: Command) -> tuple[Command, tuple[str, ...]]:
        """The nearest command that steps within reach follow, and the reason for each change in words."""
        T, reach = QUICK * self.gait.period, self.reach
        aside = reach.most - self.width
        bounds = (
            ("forward", "m/s", reach.forward / T, f"knees stretch beyond steps of {reach.forward:.2f} m in {T:.2f} s"),
            ("left", "m/s", 0.5 * aside / T, f"feet get {aside:.2f} m further apart in {2.0 * T:.2f} s"),
            ("turn", "rad/s", 0.5 * reach.turn / T, f"a foot turns by {reach.turn:.2f} rad in {2.0 * T:.2f} s"),
        )  # fmt: skip
        found, why = [], []
        for name, unit, most, reason in bounds:
            value = getattr(requested, name)
            kept = min(max(value, -most), most)
            found.append(kept)
            if kept != value:
                why.append(f"{name} {value:.2f} -> {kept:.2f} {unit}: {reason}")
        return Command(*found), tuple(why)

    def paced(self, now: Command, requested: Command) -> Command:
        """Velocity of the next step: a bounded change towards the command."""
        x, y = requested.forward - now.forward, requested.left - now.left
        share = min(1.0, self.change / max(math.hypot(x, y), 1e-12))
        turn = min(max(requested.turn - now.turn, -TURNS), TURNS)
        if share == 1.0:
            return Command(requested.forward, requested.left, now.turn + turn)
        return Command(now.forward + share * x, now.left + share * y, now.turn + turn)

    def paces(self, now: Command, requested: Command, most: int = 24) -> list[Command]:
        """Velocities of the steps until the command is met."""
        found: list[Command] = []
        while len(found) < most and (not found or now != requested):
            now = self.paced(now, requested)
            found.append(now)
        return found

    def haste(self, pace: Command) -> float:
        """Time of a step at a velocity, a share of that of the gait."""
        T, reach = self.gait.period, self.reach
        aside = reach.most - self.width
        needed = max(abs(pace.forward) * T / reach.forward, 2.0 * abs(pace.left) * T / max(aside, 1e-9))
        return min(1.0, max(QUICK, COMFORT / max(needed, 1e-9)))
