"""Scenes of Dreamer: everything of a run but its controller."""

from __future__ import annotations

import math
from dataclasses import dataclass, field
from typing import Any

from benchmarks.sentis2012.experiments.human import SpringHand, Walk
from hqp.robots.on_mujoco import Bumps, Plane, Ramp, Sensors, Step, Terrain

GROUND: dict[str, dict[str, Any]] = {
    "dreamer": {"impedance": (0.95, 0.95), "solref": (0.033, 1.0)},
    "dreamer_rollers": {"impedance": (0.998, 0.998), "solref": (0.04, 1.0)},
}
"""Equal rubber under both plants: wheels sink in by 0.7 mm at rest, critically damped.  Each plant needs its own
numbers, since MuJoCo scales a contact's stiffness with the apparent mass of the bodies: a sphere that carries the
robot, or a roller of 10 g that spins freely.  With the ball wheels' numbers, rollers sink in by some 5 mm; with
MuJoCo's defaults the robot rocks on them at 15 Hz."""

RAMP_START = 0.35
"""Distance from the middle of the base to the ramp's lower edge at the start [m]."""

OFF = (0.20, 0.12, 0.25, 0.20, -0.12, 0.35, -0.20, 0.15, 0.20)
"""Posture errors of a start out of place, in the upper body's order, 7 to 20 degrees [rad]."""


@dataclass(frozen=True, kw_only=True)
class Scene:
    """Everything of a run but the controller.

    plant: ``dreamer`` (ball wheels) or ``dreamer_rollers``.  slope [deg], top: height of a plateau [m].
    bumps, step: height of random bumps, of a step up, on level ground in place of the slope [m].  heading: of
    the robot, the ramp rises towards 0 [rad].  out_of_place: factor of the posture errors OFF at the start.
    enable: times at which the motors of upper body and base start [s]; brakes hold them before.
    payload at the hand [kg], extra_mass: factor on the upper body's masses, both unknown to the controller.
    strength: factor on the motors' torque limits.
    push: force on the hand ``(3,)`` [N] in place of the walk, from 1 s to 2.5 s.
    tilt: angle by which a helper lifts the front of the base [rad].
    """

    plant: str = "dreamer"
    slope: float = 7.0
    top: float | None = None
    bumps: float = 0.0
    step: float = 0.0
    friction: float = 0.8
    walk: Walk = field(default_factory=Walk)
    hand: SpringHand = field(default_factory=SpringHand)
    heading: float = 0.0
    out_of_place: float = 0.0
    enable: tuple[float, float] = (0.0, 0.0)
    delay: float = 0.0
    sensors: Sensors = field(default_factory=Sensors)
    payload: float = 0.0
    extra_mass: float = 1.0
    strength: float = 1.0
    push: tuple[float, float, float] | None = None
    tilt: float = 0.0
    seconds: float | None = None
    seed: int = 0

    @property
    def duration(self) -> float:
        """Duration of the run [s]."""
        return self.walk.end + 1.5 if self.seconds is None else self.seconds

    def terrain(self) -> Terrain:
        """The ground."""
        ground: dict[str, Any] = {"friction": self.friction, **GROUND[self.plant]}
        if self.bumps:
            return Bumps(start=RAMP_START, rise=self.bumps, seed=self.seed, **ground)
        if self.step:
            return Step(start=RAMP_START, rise=self.step, **ground)
        if self.slope == 0.0:
            return Plane(**ground)
        return Ramp(start=RAMP_START, angle=math.radians(self.slope), top=self.top, **ground)
