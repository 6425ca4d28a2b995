"""The ground a plant moves on: geometry and friction as plain data."""

from __future__ import annotations

import math
from abc import ABC, abstractmethod
from dataclasses import dataclass

import numpy as np

from hqp.arrays import Vec
from hqp.errors import DeclarationError
from hqp.numbers import set_numbers

_THICK, _LONG = 0.5, 20.0  # thickness of slabs, and length of an endless slope [m]
_BURIED = 0.05  # least depth of a slope below the ground [m]


@dataclass(frozen=True)
class Slab:
    """A box on the ground: centre, half sizes [m], inclination about -y [rad]."""

    centre: tuple[float, float, float]
    half: tuple[float, float, float]
    angle: float


@dataclass(frozen=True)
class Cap:
    """Part of a sphere above the ground: centre and radius [m]."""

    centre: tuple[float, float, float]
    radius: float


@dataclass(frozen=True, kw_only=True)
class Terrain(ABC):
    """Ground whose height depends on x alone, but for caps; its friction and stiffness win over the robot's.

    friction: sliding coefficient [-].  solref: MuJoCo's time constant [s] and damping ratio of contacts.
    impedance: MuJoCo's least and largest impedance of contacts, nearer to 1 for harder ground.
    Raises DeclarationError for a negative friction, a time constant not above 0, an impedance outside (0, 1).
    """

    friction: float = 0.8
    solref: tuple[float, float] = (0.006, 1.0)
    impedance: tuple[float, float] = (0.9, 0.95)

    def __post_init__(self) -> None:
        set_numbers(self, "terrain", ("friction",), 0.0)
        if not self.solref[0] > 0.0:
            raise DeclarationError("terrain", "bad solref", value=self.solref, allowed="time constant > 0 s")
        if not 0.0 < self.impedance[0] <= self.impedance[1] < 1.0:
            raise DeclarationError("terrain", "bad impedance", value=self.impedance, allowed="0 < least <= largest < 1")

    def _above_zero(self, where: str, *names: str) -> None:
        """Raise DeclarationError for a length that is not above 0."""
        for name in names:
            if not getattr(self, name) > 0.0:
                raise DeclarationError(where, f"bad {name}", value=getattr(self, name), unit="m", allowed="above 0")

    @abstractmethod
    def slabs(self) -> tuple[Slab, ...]:
        """Slabs on the plane z = 0."""

    def caps(self) -> tuple[Cap, ...]:
        """Bumps on it."""
        return ()

    @abstractmethod
    def slope(self, x: float) -> float:
        """Inclination at x [rad], positive uphill."""

    @abstractmethod
    def height(self, x: float) -> float:
        """Height at x [m]."""

    def normal(self, x: float) -> Vec:
        """Unit normal at x, ``(3,)``, upwards."""
        angle = self.slope(x)
        return np.array([-math.sin(angle), 0.0, math.cos(angle)])


@dataclass(frozen=True, kw_only=True)
class Plane(Terrain):
    """Level ground."""

    def slabs(self) -> tuple[Slab, ...]:
        return ()

    def slope(self, x: float) -> float:
        return 0.0

    def height(self, x: float) -> float:
        return 0.0


@dataclass(frozen=True, kw_only=True)
class Ramp(Terrain):
    """Level ground, a slope that rises along x, and a level plateau on top of it.

    start: x of the lower edge [m].  angle: inclination of the slope [rad].  top: height of the plateau [m], None for a
    slope without end.  width: along y [m].  Raises DeclarationError for an angle outside (0, pi/3] or a top not above
    0.
    """

    start: float = 0.35
    angle: float = math.radians(7.0)
    top: float | None = None
    width: float = 6.0

    def __post_init__(self) -> None:
        super().__post_init__()
        if not 0.0 < self.angle <= math.pi / 3.0:
            raise DeclarationError(
                "ramp", "bad angle", value=self.angle, unit="rad", allowed="0 < angle <= pi/3; Plane() if level"
            )
        if self.top is not None and not self.top > 0.0:
            raise DeclarationError("ramp", "bad top", value=self.top, unit="m", allowed="above 0, or None")
        if not self.width > 0.0:
            raise DeclarationError("ramp", "bad width", value=self.width, unit="m", allowed="above 0")

    @property
    def end(self) -> float:
        """x of the upper edge [m], inf without one."""
        return math.inf if self.top is None else self.start + self.top / math.tan(self.angle)

    @property
    def underground(self) -> float:
        """Length of the slope below the level ground, along itself [m].

        Without it the slab's front edge lies at the foot, just where wheels touch: a roller that meets the edge gets a
        contact whose normal is that of no surface (measured: one sample at 121 degrees and 1411 N).
        """
        return max(1.0, _BURIED / math.sin(self.angle))

    def slabs(self) -> tuple[Slab, ...]:
        upper = _LONG if self.top is None else self.top / math.sin(self.angle)
        lower = self.underground
        sin, cos = math.sin(self.angle), math.cos(self.angle)
        middle = (
            self.start + 0.5 * ((upper - lower) * cos + _THICK * sin),
            0.0,
            0.5 * ((upper - lower) * sin - _THICK * cos),
        )
        slope = Slab(middle, (0.5 * (upper + lower), 0.5 * self.width, 0.5 * _THICK), self.angle)
        if self.top is None:
            return (slope,)
        half = (0.5 * _LONG, 0.5 * self.width, 0.5 * _THICK)
        return slope, Slab((self.end + half[0], 0.0, self.top - half[2]), half, 0.0)

    def slope(self, x: float) -> float:
        return self.angle if self.start < x < self.end else 0.0

    def height(self, x: float) -> float:
        return math.tan(self.angle) * (min(max(x, self.start), self.end) - self.start)


@dataclass(frozen=True, kw_only=True)
class Step(Terrain):
    """Level ground and a step up, square to x, onto level ground that goes on.

    start: x of the edge [m].  rise [m], width along y [m].  Raises DeclarationError for values that are not above 0.
    """

    start: float = 0.35
    rise: float = 0.01
    width: float = 6.0

    def __post_init__(self) -> None:
        super().__post_init__()
        self._above_zero("step", "rise", "width")

    def slabs(self) -> tuple[Slab, ...]:
        half = (0.5 * _LONG, 0.5 * self.width, 0.5 * _THICK)
        return (Slab((self.start + half[0], 0.0, self.rise - half[2]), half, 0.0),)

    def slope(self, x: float) -> float:
        return 0.0

    def height(self, x: float) -> float:
        return self.rise if x > self.start else 0.0


@dataclass(frozen=True, kw_only=True)
class Bumps(Plane):
    """Level ground strewn with bumps, caps of spheres at random places on a grid from ``start`` on along x.

    rise: largest height of a bump over the ground; each has half of it to all of it [m].  radius: radius of its foot
    [m].  spacing: distance of grid points [m]; every place is off by up to a quarter of it.  length, width: size size
    of the field [m].  ``height`` leaves the bumps out.  Raises DeclarationError for values that are not above 0.
    """

    start: float = 0.35
    rise: float = 0.005
    radius: float = 0.06
    spacing: float = 0.16
    length: float = 1.6
    width: float = 1.6
    seed: int = 0

    def __post_init__(self) -> None:
        super().__post_init__()
        self._above_zero("bumps", "rise", "radius", "spacing", "length", "width")

    def caps(self) -> tuple[Cap, ...]:
        rng = np.random.default_rng(self.seed)
        found = []
        for x in np.arange(self.start, self.start + self.length, self.spacing).tolist():
            for y in np.arange(-0.5 * self.width, 0.5 * self.width, self.spacing).tolist():
                dx, dy = rng.uniform(-0.25, 0.25, 2).tolist()
                rise = self.rise * float(rng.uniform(0.5, 1.0))
                size = 0.5 * (self.radius**2 + rise**2) / rise  # radius of the sphere with that cap
                found.append(Cap((x + dx * self.spacing, y + dy * self.spacing, rise - size), size))
        return tuple(found)


@dataclass(frozen=True, kw_only=True)
class Tiles(Plane):
    """Square tiles whose tops are up to ``rise`` above or below the ground at the start, which is at ``rise``.

    start: x where they begin [m].  rise [m].  size: side of a tile [m].  length, width: size of the field [m].
    ``height`` is that of the start.  Raises DeclarationError for values that are not above 0.
    """

    start: float = 0.25
    rise: float = 0.02
    size: float = 0.4
    length: float = 2.8
    width: float = 2.4
    seed: int = 0

    def __post_init__(self) -> None:
        super().__post_init__()
        self._above_zero("tiles", "rise", "size", "length", "width")

    def slabs(self) -> tuple[Slab, ...]:
        rng = np.random.default_rng(self.seed)
        half, thick = 0.5 * self.size, 0.5 * _THICK
        long = 0.5 * _LONG
        found = [Slab((self.start - long, 0.0, self.rise - thick), (long, 0.5 * self.width, thick), 0.0)]
        for x in np.arange(self.start + half, self.start + self.length, self.size).tolist():
            for y in np.arange(half - 0.5 * self.width, 0.5 * self.width, self.size).tolist():
                top = self.rise * float(rng.uniform(0.0, 2.0))
                found.append(Slab((x, y, top - thick), (half, half, thick), 0.0))
        return tuple(found)

    def height(self, x: float) -> float:
        return self.rise
