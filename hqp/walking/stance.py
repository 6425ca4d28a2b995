"""Start pose of a biped: on level soles, its CoM above their middle, knees bent as far as they bear it."""

from __future__ import annotations

import math
from collections.abc import Sequence
from typing import TYPE_CHECKING, Any

import numpy as np

from hqp.arrays import Mat, Vec
from hqp.declare.stack import Level, Stack
from hqp.errors import DeclarationError
from hqp.estimation.rotations import yaw_of
from hqp.robots.knees import knee
from hqp.tasks import Com, Orientation, Pose, Posture
from hqp.walking.feet import Foot, base_of, upper
from hqp.walking.footsteps import rotation

if TYPE_CHECKING:
    from hqp.declare.robot import State

BENT = 0.5
"""Least bend of knees at the start of the search [rad]: a straight knee has no direction of bending."""

SPARE = 0.02
"""Reserve of the legs' length as a share of the CoM's height."""

HARD, RELIEVED = 0.7, 0.05
"""Largest share of a joint's torque limit on one foot, and the relief by longer legs (SPARE) that rejects a stance."""

LOWER = 1.0, 2.0 / 3.0, 1.0 / 3.0, 0.0, 2.0, 3.0, 4.0
"""Candidates as factors of ``lower``, in order: less for weak knees, more for knees that are straight at home."""


def standing(robot: Any, feet: tuple[Foot, Foot], lower: float) -> Vec:
    """The configuration ``(nq,)`` nearest to home with the CoM above the middle of level soles, and lower.

    Soles keep their place from above and come to the height z = 0 of the ground, the base keeps its orientation; legs
    alone lower the body, as a waist at its limit cannot balance.  lower: lowering of the CoM, a share of its height at
    home above the soles; less where standing on one foot takes more than HARD of a joint's torque, more where knees are
    straight at home.  Raises DeclarationError where no such configuration is found.
    """
    stance = Stance(robot, feet)
    stiff = None
    for share in LOWER:
        if share > 1.0 and stiff is not None:
            break
        low = share * lower
        if stance.on(feet, low - SPARE) is None or (q := stance.on(feet, low)) is None:
            continue
        if not any(stance.weak(foot, low) for foot in feet):
            return q
        stiff = q
    if stiff is None:
        raise DeclarationError("walker", f"{robot.name} does not stand", value=lower, allowed="soles that legs reach")
    return stiff


def borne(robot: Any, foot: Foot, q: Vec) -> Vec:
    """Share of its largest torque that each motor bears with the ZMP at ``aim`` of one foot, at rest ``(n,)``.

    The CoM c accelerates away from the ZMP p as a pendulum, a = g / (c_z - p_z) (c - p) along the ground, with all
    links: f = m (g + a), U' tau = g(q) + m J_c' a - J' (f, moment of f), as near as motors with the actuation U get.
    """
    state = robot.copy().state(q)
    c, at = state.com(), foot.placed(state)
    p, up = np.array([at.x, at.y, at.z]), np.array([0.0, 0.0, -float(robot.gravity[2])])
    away = up[2] / (c - p)[2] * (c - p) - up
    f = robot.mass * (up + away)
    moment = np.cross(p - state.position(foot.frame), f)
    needed = state.bias_force() + robot.mass * state.com_jacobian().T @ away
    needed -= state.jacobian(foot.frame).T @ np.concatenate((f, moment))
    tau = np.linalg.lstsq(robot.actuation.T, needed, rcond=None)[0]
    return np.asarray(np.abs(tau) / robot.effort_limit[robot.actuated])


def overloaded(robot: Any, foot: Foot, start: Vec) -> list[str]:
    """A reason for each motor that a step overloads: its share of torque as the other foot lifts off, the CoM still
    between the feet."""
    parts = zip(robot.joint_names, borne(robot, foot, start).tolist(), strict=True)
    where = f"of its torque as the weight comes onto the {foot.name} foot: walks fall if that lasts"
    return [f"{name} needs {100.0 * share:.0f} % {where}" for name, share in parts if share > 1.0]


class Stance:
    """Inverse kinematics of standing, with the CoM above the middle of some feet; both feet on the ground."""

    def __init__(self, robot: Any, feet: tuple[Foot, Foot]) -> None:
        self.robot = robot
        self.home = robot.copy().state(robot.home)
        self.height = float(self.home.com()[2]) - 0.5 * sum(foot.placed(self.home).z + foot.depth for foot in feet)
        self.com = Com()
        soles = [Pose(frame=foot.frame, name=foot.name) for foot in feet]
        rest = upper(robot, feet)
        above = [Level(Posture(joints=rest, name="upper"))] if rest else []
        trunk = Orientation(frame=base_of(robot))
        self.stack = Stack(
            Level(*soles, name="soles"), Level(self.com, name="balance"), Level(trunk), *above, Level(Posture())
        )
        targets = [_level(foot, self.home) for foot in feet]
        self.targets = [pose.at(target) for target, pose in zip(targets, soles, strict=True)]
        self.start = _bent(robot, feet, targets)

    def on(self, feet: Sequence[Foot], lower: float) -> Vec | None:
        """Lower by a share of the height, the CoM between these feet ``(nq,)``; None where it is out of reach."""
        from hqp.goals import reach

        middle = np.mean([foot.placed(self.home).xy for foot in feet], axis=0)
        goal = self.com.at(np.array([*middle, (1.0 - lower) * self.height]))
        found = reach(
            self.stack, self.robot, *self.targets, goal, q0=self.start, restarts=0, tolerance=1e-4, budget=60.0
        )
        return np.asarray(found.q) if found.success else None

    def weak(self, foot: Foot, lower: float) -> bool:
        """Return true if a joint is highly loaded, alone on a foot, and longer legs would relieve it."""
        low, tall = (self.on((foot,), x) for x in (lower, lower - SPARE))
        if low is None or tall is None:
            return False
        share = borne(self.robot, foot, low)
        return bool(np.any((share > HARD) & (share > borne(self.robot, foot, tall) + RELIEVED)))


def _level(foot: Foot, home: State) -> Any:
    """Pose of a foot's frame ``(4, 4)`` with a level sole on the ground z = 0 below where it is at home."""
    target = np.eye(4)
    target[:2, :2] = rotation(yaw_of(home.rotation(foot.frame)))
    target[:3, 3] = *home.position(foot.frame)[:2], -foot.depth
    return target


def _bent(robot: Any, feet: Sequence[Foot], targets: Sequence[Mat]) -> Vec:
    """Home on the ground, each knee bent by BENT or more to the side of its larger range ``(nq,)``."""
    v = np.zeros(robot.nv)
    for foot in feet:
        name, bend = knee(robot, foot.leg, robot.home)
        column = int(robot.joints([name])[0])
        straight = float(robot.copy().state(robot.home).angles[column]) - bend
        ahead, behind = robot.upper[column] - straight, straight - robot.lower[column]
        side = math.copysign(1.0, bend if ahead == behind else ahead - behind)
        v[column] = side * max(side * bend, BENT) - bend
    q = np.asarray(robot.integrate(robot.home, v, 1.0))
    state = robot.copy().state(q)
    off = [target[:3, 3] - state.position(foot.frame) for target, foot in zip(targets, feet, strict=True)]
    q[:3] += np.mean(off, axis=0)
    return q
