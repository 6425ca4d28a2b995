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
    from hqp.walking.gait import Gait

BENT = 0.5
"""Least bend of knees at the start of the search [rad]: a straight knee has no direction of bending."""

SPARE = 0.02
"""Reserve of the legs' length as a share of the CoM's height."""

HARD, RELIEVED = 0.7, 0.05
"""Largest share of a joint's torque limit on one foot, and the relief by longer legs (SPARE) that rejects a stance."""

FALLING = 0.5
"""Largest fall that a weak joint may cause in a step, as a share of the fall from which both feet return in their time:
with 1.0 one of six drawn bipeds with weak hips falls, without a bound two, with 0.5 none."""

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
    where = f"of its torque as the weight comes onto the {foot.name} foot"
    return [f"{name} needs {100.0 * share:.0f} % {where}" for name, share in parts if share > 1.0]


def weakest(robot: Any, feet: Sequence[Foot], start: Vec, gait: Gait) -> tuple[str, float, float]:
    """The joint of a leg that bears the least mass in steps of a gait, with its share of torque by the model, and the
    largest share at which the body does not fall.

    A joint that needs r times its torque tau lets the body fall about it, I x'' = K x + (r - 1) tau, with its inertia
    I and the stiffness K of gravity, lambda^2 = K / I.  After T = ``single`` the diverging part of x has grown to
    (r - 1) E tau / K, E = e^(lambda T) - 1.  Both feet return (2 - r) (1 - e^(-lambda D)) tau / K of it in D =
    ``double``, as a joint still bears the weight there.  The largest share causes FALLING of that, r = (E + 2 c) /
    (E + c) with c = FALLING (1 - e^(-lambda D)).
    """
    found = feet[0].leg[0], 0.0, 1.0
    names, twin, apart = list(robot.joint_names), robot.copy(), 1e-3
    state = robot.copy().state(start)
    M, height = state.mass_matrix().copy(), float(state.com()[2])
    for foot in feet:
        shares, J = borne(robot, foot, start), state.jacobian(foot.frame).copy()
        for name in foot.leg:
            column = int(robot.joints([name])[0])
            turn = np.zeros(robot.nv)
            turn[column] = 1.0
            turn[:6] = -np.linalg.solve(J[:, :6], J[:, column])  # the foot stays
            back, ahead = (float(twin.state(robot.integrate(start, turn, x)).com()[2]) for x in (-apart, apart))
            gravity = robot.mass * robot.gravity[2] * (back - 2.0 * height + ahead) / apart**2
            rate = math.sqrt(max(gravity / float(turn @ M @ turn), 1e-12))  # it falls, if slowly
            grown, returned = math.expm1(rate * gait.single), -FALLING * math.expm1(-rate * gait.double)
            share, most = float(shares[names.index(name)]), (grown + 2.0 * returned) / (grown + returned)
            if share * found[2] > most * found[1]:
                found = name, share, most
    return found


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
