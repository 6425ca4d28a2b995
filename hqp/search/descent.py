"""Terms of a descent from one start: its end, its pace."""

from __future__ import annotations

from typing import NamedTuple, TypeAlias

from hqp.arrays import Vec

STEP = 0.8
"""Largest change of a coordinate in one step [rad or m]."""
LEAST = 0.01
"""A step that makes things worse is halved down to this, then taken all the same [rad or m]."""
STALLED, PROGRESS = 6, 0.7
"""Steps in which the first unmet level must fall to this share; else the start is given up."""
POLISH = 0.01
"""Once the targets are met, steps go on while they are larger than this [rad or m]: levels below settle."""
SETTLED = 1e-4
"""Shorter steps lead no nearer to a target out of reach [rad or m]."""
LAST = 30
"""Most steps of that kind."""
STILL = 1e-9
"""Steps below this are none [rad or m]."""

Merit: TypeAlias = tuple[float, ...]
"""Largest error of each group, ``subject_to`` first, in tolerances and at least 1: compared in that order."""


class Descent(NamedTuple):
    """End of a start: configuration, merit, steps taken, reason of its end, errors by element if known."""

    q: Vec
    merit: Merit
    steps: int
    reason: str
    errors: dict[str, float] | None = None

    @property
    def met(self) -> bool:
        """True if every target is within the tolerance."""
        return max(self.merit) <= 1.0
