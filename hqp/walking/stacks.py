"""The stack of a walk at torque level, and its phases: two feet on the ground, or one of them alone."""

from __future__ import annotations

from dataclasses import dataclass, replace
from typing import Any

import numpy as np

from hqp.arrays import Vec
from hqp.declare.law import DCM, PD
from hqp.declare.price import Price
from hqp.declare.stack import Level, Stack
from hqp.kinds import require
from hqp.tasks import (
    Balance,
    CenterOfPressure,
    Com,
    FixedContact,
    FrictionCone,
    JointLimits,
    LoadShare,
    Orientation,
    Pose,
    Posture,
    TorqueLimits,
)
from hqp.tasks.polygons import shrunk
from hqp.walking.feet import Foot, base_of, upper
from hqp.walking.knees import bent

BOTH = "both"
"""The phase of two feet on the ground; the phase of one foot has its name."""

FIRM = 4.0
"""Weight of the balance beside trunk and swing foot: at 1 the foot of a long step pushes the body off its course."""

HASTE = Price(0.03, turning=False)
"""Price of the body level: the gains alone would set a price at which a swing foot lags during its half second.  The
body misses 0.01 to 0.1 m/s^2 in many ticks: if that slowed the posture, waist and arms would be thrown each time."""

_BALANCE, _CONTACT = DCM(3.0), PD(0.0, 20.0)
_HEIGHT, _SWING, _TRUNK, _POSTURE = PD(400.0, 40.0), PD(300.0, 35.0), PD(100.0, 20.0), PD(40.0, 13.0)


@dataclass(frozen=True, kw_only=True)
class Laws:
    """Gains of a walk: PD(kp [1/s^2], kd [1/s]) each, and k [1/s] of the balance.  Raises DeclarationError."""

    balance: DCM = _BALANCE
    height: PD = _HEIGHT
    swing: PD = _SWING
    trunk: PD = _TRUNK
    posture: PD = _POSTURE
    contact: PD = _CONTACT

    def __post_init__(self) -> None:
        for name, law in vars(self).items():
            kind, allowed = (DCM, "DCM(k)") if name == "balance" else (PD, "PD(kp, kd)")
            require("laws", name, law, kind, allowed)


class Stacks:
    """Stack of a walk, with phases by standing feet: ``both``, ``left`` or ``right``.

        knees > swing, balance, height, trunk, legs > posture > load share
        s.t. contacts, torques, joints, friction, soles

    If a sole or the friction bounds one level, each of its tasks yields a little: in an order the last of them is
    thrown about for the others' angular momentum.  legs: joints with which a leg of more than six turns between its
    ends; on a level below they bent a knee at its limit by next to nothing at 900 rad/s^2, and CBi's torques changed by
    200 N m in a tick.

    height: height of the pendulum [m]. friction: mu. limits: limits of joints, without names of all but the legs',
    whose loads need unlimited acceleration; None for none.
    """

    def __init__(
        self,
        robot: Any,
        feet: tuple[Foot, Foot],
        height: float,
        friction: float,
        laws: Laws,
        limits: JointLimits | None,
        start: Vec,
    ) -> None:
        rest = upper(robot, feet)
        names = feet[0].name, feet[1].name
        self.supports = {
            phase: Balance(
                law=laws.balance,
                points=tuple((foot.frame, *corner, 0.0) for foot in on for corner in foot.support),
                of=tuple(foot.name for foot in on for _ in foot.support),
                height=height,
                weight=FIRM,
            )
            for phase, on in ((BOTH, feet), *((foot.name, (foot,)) for foot in feet))
        }
        """The balance by phase, with the support that it has there."""
        self.balance = self.supports[BOTH]
        self.height = Com(axes="z", law=laws.height, name="height")
        self.trunk = Orientation(frame=base_of(robot), law=laws.trunk, name="trunk")
        self.posture = Posture(joints=rest, law=laws.posture) if rest else None
        spare = [name for foot in feet for name in redundant(robot, foot, start)]
        self.legs = Posture(joints=spare, law=laws.posture, name="legs") if spare else None
        self.share = LoadShare(contacts=names, when=BOTH)
        self.swing = tuple(
            Pose(frame=foot.frame, law=laws.swing, name=f"{foot.name}_swing", when=other)
            for foot, other in zip(feet, names[::-1], strict=True)
        )
        if limits is not None and limits.joints is None:
            limits = replace(limits, joints=rest) if rest else None
        self.soles = [FixedContact(frame=foot.frame, name=foot.name, when=(BOTH, foot.name)) for foot in feet]
        within: list[Any] = [*self.soles, TorqueLimits(), *([] if limits is None else [limits])]
        for foot in feet:
            within.append(FrictionCone(contact=foot.name, mu=friction, sole=foot.rectangle))
            within.append(CenterOfPressure(contact=foot.name, polygon=shrunk(foot.corners, foot.margin)))
        postures = [] if self.posture is None else [Level(self.posture, name="posture")]
        swivel = [] if self.legs is None else [self.legs]
        body = Level(*self.swing, self.balance, self.height, self.trunk, *swivel, name="body", price=HASTE)
        self.knees = bent(robot, feet, start)
        self.stack = Stack(
            Level(self.knees, name="knees"), body, *postures, Level(self.share, name="share"), subject_to=within
        )


def redundant(robot: Any, foot: Foot, start: Vec) -> list[str]:
    """Joints of a leg beyond the six that place its foot; they move most while foot and base stand still."""
    columns = robot.joints(foot.leg)
    jacobian = robot.copy().state(start).jacobian(foot.frame)[:, columns]
    still = np.linalg.svd(jacobian)[2][6:]  # (k, n), motions with the foot at rest
    found: list[str] = []
    while len(still):
        most = int(np.argmax(np.linalg.norm(still, axis=0)))
        found.append(foot.leg[most])
        still = np.linalg.svd(still[:, [most]].T)[2][1:] @ still
    return found
