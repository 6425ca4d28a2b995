"""A recorded motion: joint positions over time."""

from __future__ import annotations

from dataclasses import dataclass, replace
from typing import Any

import numpy as np

from hqp.arrays import Mat
from hqp.errors import DeclarationError, closest
from hqp.kinds import require
from hqp.numbers import number, whole

from .box import Box

CUTOFF = 10.0
"""Cutoff of ``Motion.smoothed`` [Hz]: marker noise is above it and motion of human limbs below."""

EDGE = 9
"""Least number of point-reflected samples that a filter adds beyond each end."""

RATES = (1.0, 1e5)
"""Least and largest frame rate [1/s]: below it a file has its frame time in milliseconds."""

TURNS: dict[str, tuple[tuple[int, int, int], tuple[int, int, int]]] = {
    "x": ((1, 2, 0), (1, 1, 1)),
    "y": ((0, 2, 1), (1, -1, 1)),
    "z": ((0, 1, 2), (1, 1, 1)),
    "-x": ((1, 2, 0), (1, -1, -1)),
    "-y": ((0, 2, 1), (1, 1, -1)),
    "-z": ((0, 1, 2), (1, -1, -1)),
}
"""By the axis that is up: the axes that become x, y and z, and their signs."""

UPS = ("auto", *TURNS)


@dataclass(frozen=True)
class Motion:
    """Positions of the joints of a person, z up.

    names: names of the J joints.  positions ``(T, J, 3)``, in any unit of length.  fps [1/s].  parents: index of each
    joint's parent, -1 for a root, empty if unknown.  notes: remarks of its reader, for the report.  box: a box that the
    hands carry.  Raises DeclarationError for shapes that do not fit, numbers that are not finite, and less than two
    frames.
    """

    names: tuple[str, ...]
    positions: Any
    fps: float
    parents: tuple[int, ...] = ()
    notes: tuple[str, ...] = ()
    box: Box | None = None

    def __post_init__(self) -> None:
        try:
            places = np.array(self.positions, dtype=np.float64)
        except (TypeError, ValueError) as error:
            raise DeclarationError("motion", "positions are not numeric", allowed="an array (T, J, 3)") from error
        names = tuple(str(name) for name in _listed("names", self.names))
        if places.ndim != 3 or places.shape[1:] != (len(names), 3) or len(places) < 2:
            allowed = f"(T, {len(names)}, 3) for {len(names)} names, T at least 2"
            raise DeclarationError("motion", f"positions have shape {places.shape}", allowed=allowed)
        if len(set(names)) < len(names):
            twice = sorted({name for name in names if names.count(name) > 1})
            raise DeclarationError("motion", "duplicate joint name", value=twice)
        if not np.isfinite(places).all():
            frame, joint = np.argwhere(~np.isfinite(places).all(axis=2))[0]
            raise DeclarationError(
                "motion", f"{names[joint]} is not finite in frame {frame}", allowed="finite numbers, gaps filled"
            )
        fps = number("motion", "frames per second", self.fps, RATES[0], most=RATES[1], unit="1/s")
        parents = tuple(whole("motion", "parent", p, -1, len(names) - 1) for p in _listed("parents", self.parents))
        if parents and len(parents) != len(names):
            raise DeclarationError("motion", f"{len(parents)} parents", allowed=f"{len(names)}, one for each joint")
        require("motion", "box", self.box, (Box, type(None)), "a Box, or None")
        if self.box is not None and len(self.box) != len(places):
            raise DeclarationError("motion", "frames of the box", value=len(self.box), allowed=str(len(places)))
        object.__setattr__(self, "names", names)
        object.__setattr__(self, "positions", places)
        object.__setattr__(self, "fps", float(fps))
        object.__setattr__(self, "parents", parents)

    def __len__(self) -> int:
        """Number of frames."""
        return len(self.positions)

    def joint(self, name: str) -> Mat:
        """Positions ``(T, 3)`` of a joint; raises DeclarationError with the closest names."""
        if name not in self.names:
            near = ", ".join(closest(name, self.names) or self.names)
            raise DeclarationError("motion", "unknown joint", value=name, allowed=near)
        return np.asarray(self.positions[:, self.names.index(name)])

    def part(self, first: int, last: int) -> Motion:
        """The frames from ``first`` up to but not ``last``."""
        box = None if self.box is None else self.box.frames(slice(first, last))
        return replace(self, positions=self.positions[first:last], box=box)

    def smoothed(self, cutoff: float = CUTOFF) -> Motion:
        """The motion below a frequency [Hz], without lag (Butterworth of second order, forwards and backwards).

        Unchanged where the frame rate has nothing above it.
        """
        if cutoff >= 0.5 * self.fps or len(self) <= EDGE:
            return self
        return replace(self, positions=low_pass(self.positions, cutoff, self.fps))

    def at_rate(self, fps: float) -> Motion:
        """The motion in another frame rate [1/s], by cubic splines."""
        from scipy.interpolate import CubicSpline

        fps = float(number("motion", "frames per second", fps, RATES[0], most=RATES[1], unit="1/s"))
        if fps == self.fps:
            return self
        before = np.arange(len(self)) / self.fps
        after = np.arange(int(np.floor(before[-1] * fps + 1e-9)) + 1) / fps
        box = None if self.box is None else self.box.at_times(before, after)
        return replace(self, positions=CubicSpline(before, self.positions)(after), fps=fps, box=box)

    def turned(self, up: str) -> Motion:
        """The motion with z up, if the axis ``up`` (x, y, z, -x, -y, -z) is up so far.

        Raises DeclarationError for another name.
        """
        if up not in TURNS:
            raise DeclarationError("motion", "up", value=up, allowed=", ".join(UPS))
        axes, signs = TURNS[up]
        box = None if self.box is None else self.box.turned(np.eye(3)[list(axes)] * np.array(signs)[:, None])
        return replace(self, positions=self.positions[..., axes] * signs, box=box)


def _listed(field: str, values: Any) -> list[Any]:
    """The values of a field; raises DeclarationError for a text, and for one that has none."""
    try:
        if not isinstance(values, (str, bytes)):
            return list(values)
    except TypeError:
        pass
    raise DeclarationError("motion", field, value=values, allowed="a sequence, one for each joint")


def low_pass(values: Mat, cutoff: float, fps: float) -> Mat:
    """Values ``(T, ...)`` below a frequency [Hz], without lag (Butterworth of second order, forwards and backwards)."""
    from scipy.signal import butter, sosfiltfilt

    edge = min(len(values) - 1, max(EDGE, round(fps / cutoff)))
    return np.asarray(sosfiltfilt(butter(2, cutoff, fs=fps, output="sos"), values, axis=0, padlen=edge))


def moving(values: Mat, cutoff: float, fps: float) -> Mat:
    """Values ``(T, ...)`` below a frequency that keep their acceleration at both ends, where ``low_pass`` has none.

    Both ends are prolonged with the second derivative of a cubic fitted there.
    """
    edge = min(len(values) - 1, round(fps / cutoff))
    k = np.arange(1, edge + 1).reshape(-1, *[1] * (values.ndim - 1))

    def before(part: Mat) -> Mat:
        second = 2.0 * np.polyfit(np.arange(edge + 1), part[: edge + 1].reshape(edge + 1, -1), 3)[1]
        return np.asarray(2.0 * part[0] - part[1 : edge + 1] + second.reshape(part.shape[1:]) * k**2)

    return low_pass(np.concatenate((before(values)[::-1], values, before(values[::-1]))), cutoff, fps)[edge:-edge]


def accelerated(values: Mat, fps: float) -> Mat:
    """Second derivative of values ``(T, ...)``, at their ends too [1/s^2]."""
    order: Any = min(2, len(values) - 1)  # two frames have no acceleration
    rate: Any = np.gradient(values, axis=0, edge_order=order)
    found: Any = np.gradient(rate, axis=0, edge_order=order)
    return np.asarray(found * fps**2)


def unit(vectors: Mat) -> Mat:
    """Vectors ``(..., 3)`` of length one."""
    return np.asarray(vectors / np.maximum(np.linalg.norm(vectors, axis=-1, keepdims=True), 1e-9))
