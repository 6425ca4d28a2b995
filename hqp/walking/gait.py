"""Parameters of a walk: times, heights, and how far its feet reach."""

from __future__ import annotations

from dataclasses import dataclass, replace

from hqp.errors import DeclarationError
from hqp.numbers import number, set_numbers

GAIT, REACH = "Gait(...)", "Reach(forward=..., least=..., most=...)"


@dataclass(frozen=True, kw_only=True)
class Gait:
    """Times and heights of a walk.

    single, double: duration of single and of double support [s].  first: duration of the shift to the first stance
    foot, and of the one back between the feet [s].  height: clearance of a swing foot above the higher of lift-off and
    ground [m].  search: downward speed of a foot without contact at its landing time [m/s], for
    ``patience`` [s].  lower: distance of the CoM below its height at home, as a share of that, which keeps knees bent;
    less where joints would bear too much (``standing``).  Raises DeclarationError for numbers that are not positive and
    finite (double, height, lower: not negative).
    """

    single: float = 0.6
    double: float = 0.15
    first: float = 0.6
    height: float = 0.05
    search: float = 0.1
    patience: float = 0.4
    lower: float = 0.06

    def __post_init__(self) -> None:
        set_numbers(self, "gait", ("single", "double", "first", "search", "patience"), 0.0, strict=True)
        set_numbers(self, "gait", ("height",), 0.0)
        set_numbers(self, "gait", ("lower",), 0.0, below=1.0)

    @property
    def numbers(self) -> tuple[float, float, float, float, float, float]:
        """single, double, first, height, search, patience: the numbers of the native gait."""
        return self.single, self.double, self.first, self.height, self.search, self.patience

    def quicker(self, share: float) -> Gait:
        """The gait with that share of the time of its steps."""
        share = number("gait", "share", share, 0.0, strict=True)
        return replace(self, single=share * self.single, double=share * self.double)

    @property
    def period(self) -> float:
        """Period of one step [s]."""
        return self.single + self.double


@dataclass(frozen=True, kw_only=True)
class Reach:
    """Reachable landings of a foot, relative to the other one: |x| <= forward, least <= |y| <= most [m], turned by
    |turn| [rad].

    y is positive where the left foot lands.  Raises DeclarationError for numbers that are negative or not finite, and
    for most below least.
    """

    forward: float
    least: float
    most: float
    turn: float = 0.4

    def __post_init__(self) -> None:
        set_numbers(self, "reach", ("forward", "least", "most", "turn"), 0.0)
        if self.most < self.least:
            raise DeclarationError("reach", "most below least", value=(self.least, self.most), unit="m")
