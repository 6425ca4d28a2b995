"""The two feet of a robot: their soles, and which joints are legs."""

from __future__ import annotations

import warnings
from collections.abc import Sequence
from dataclasses import dataclass
from typing import TYPE_CHECKING, Any

import numpy as np

from hqp.angles import wrapped
from hqp.errors import DeclarationError, ModelWarning
from hqp.estimation.rotations import yaw_of
from hqp.kinds import names
from hqp.tasks.polygons import rectangle_in, shrunk
from hqp.walking.ankle import supporting
from hqp.walking.footsteps import LEFT, Foothold, rotation

if TYPE_CHECKING:
    from hqp.declare.robot import State

EDGE, PART = 0.005, 0.6
"""Margin of the ZMP to the edge of the support, beyond the margin of the centres of pressure [m], and its limit as a
share of the latter: a biped on soles of +-9 mm, whose ankles had +-1 mm for the balance, fell."""

MARGIN, SHARE = 0.01, 0.3
"""Margin of the centre of pressure to the edge of a sole [m], and its limit as a share of the sole's half width."""


@dataclass(frozen=True)
class Foot:
    """A sole: its frame, LEFT or RIGHT, the polygon that touches the ground, its middle and depth, in its axes [m].

    yaw: angle from ahead to the frame's x axis at home [rad].  leg: names of the joints with motors that move this sole
    and not the other one.  support: corners of the part in which the ankle holds the ZMP.  aim: planned place of
    the ZMP, the middle unless that takes too much of the ankle's torque; why: then the reason.
    """

    frame: str
    side: int
    corners: tuple[tuple[float, float], ...]
    middle: tuple[float, float]
    depth: float
    margin: float
    yaw: float
    leg: tuple[str, ...]
    support: tuple[tuple[float, float], ...]
    aim: tuple[float, float]
    why: str

    @property
    def name(self) -> str:
        """left or right, the name of its contact."""
        return ("left", "right")[self.side]

    @property
    def rectangle(self) -> tuple[float, float, float, float]:
        """Largest rectangle like the box of the corners, about its middle, inside them (x_min, x_max, y_min, y_max)."""
        return rectangle_in(self.corners, np.array(self.middle))

    @property
    def breadth(self) -> float:
        """Width of the sole, across its way ahead [m]."""
        return float(np.ptp((np.array(self.corners) @ rotation(self.yaw).T)[:, 1]))

    @property
    def inwards(self) -> float:
        """Distance from the middle to ``aim``, towards the other foot [m]."""
        off = rotation(self.yaw) @ (np.array(self.middle) - self.aim)
        return float(off[1]) if self.side == LEFT else -float(off[1])

    @property
    def half(self) -> float:
        """Largest distance of the sole's inner corners ahead of ``aim`` or behind it [m]."""
        inner = np.array(_inner(self.corners, self.margin)) - self.aim
        return float(np.max(np.abs(inner @ rotation(self.yaw)[0])))

    def placed(self, state: State) -> Foothold:
        """Present foothold, the place of ``aim``."""
        R, p = state.rotation(self.frame), state.position(self.frame)
        x, y, z = p + R @ [*self.aim, 0.0]
        return Foothold(self.side, float(x), float(y), float(z), wrapped(yaw_of(R) - self.yaw))


def _inner(corners: tuple[tuple[float, float], ...], margin: float) -> tuple[tuple[float, float], ...]:
    """Corners of the part of a sole that may have the ZMP."""
    return shrunk(shrunk(corners, margin), min(EDGE, PART * margin))


def feet_of(robot: Any, soles: Sequence[str] | None = None) -> tuple[Foot, Foot]:
    """Left and right foot; soles: their frames, those of the catalogue for None.

    Raises DeclarationError for a robot without two soles or a free base, ModelError where no shape touches the ground.
    """
    from hqp.robots.soles import faces, sole, sole_points, standing_axes

    allowed = "a free base and the frames of two soles"
    frames = names("walker", "soles", robot.landmarks.get("soles", ()) if soles is None else soles, allowed)
    if len(frames) != 2 or not robot.floating:
        given = frames if robot.floating else "a fixed base"
        raise DeclarationError("walker", "no biped", value=given, allowed=allowed)
    feet, home = [], robot.copy().state(robot.home)
    legs, joints = _legs(robot, frames), [robot.body(robot.frame(frame)) for frame in frames]
    axes = standing_axes(robot, *joints)
    if soles is not None and not faces(robot, *joints):
        exchanged = (
            f"knees or toes of {robot.name} face back with {frames[0]} as the left sole and {frames[1]} as the right"
        )
        warnings.warn(f"{exchanged}: forward is where they say, or exchange them", ModelWarning, stacklevel=3)
    for side, frame in enumerate(frames):
        corners = sole(robot, frame)
        box = np.array(corners)
        low, high = box.min(axis=0), box.max(axis=0)
        x, y = (0.5 * (low + high)).tolist()
        depth = sole_points(robot, frame)[0][2]
        margin = min(MARGIN, SHARE * float(np.min(0.5 * (high - low))))
        yaw = yaw_of(axes.T @ home.rotation(frame))
        held = supporting(robot, frame, legs[side], _inner(corners, margin), (x, y))
        feet.append(Foot(frame, side, corners, (x, y), depth, margin, yaw, legs[side], *held))
    return feet[0], feet[1]


def _legs(robot: Any, frames: Sequence[str]) -> list[tuple[str, ...]]:
    """Joints with motors of each leg.  Raises DeclarationError for fewer than six."""
    moving = np.array([robot.support(robot.frame(frame)) for frame in frames], dtype=bool)
    legs = []
    for frame, moved in zip(frames, moving & ~moving[::-1], strict=True):
        legs.append(tuple(n for n, c in zip(robot.joint_names, robot.actuated, strict=True) if moved[c]))
        if len(legs[-1]) < 6:
            raise DeclarationError(
                "walker",
                f"joints that move {frame!r} and not the other sole",
                value=f"{len(legs[-1])} ({', '.join(legs[-1])})",
                allowed="six or more: a flat sole stays on the ground if the leg holds it in all directions",
            )
    return legs


def base_of(robot: Any) -> str:
    """Frame of the trunk: the catalogue's, or the first body that the free joint moves."""
    named: tuple[str, ...] = robot.landmarks.get("base", ())
    moved = (f.name for f in robot.model.frames if f.parentJoint == 1 and f.type.name == "BODY")
    return named[0] if named else next(moved)


def upper(robot: Any, feet: Sequence[Foot]) -> tuple[str, ...]:
    """Names of the joints with motors of no leg."""
    return tuple(name for name in robot.joint_names if all(name not in foot.leg for foot in feet))
