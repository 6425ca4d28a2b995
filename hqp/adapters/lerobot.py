"""LeRobot's RobotKinematics on hqp: degrees and homogeneous matrices in, degrees out, limits kept."""

from __future__ import annotations

import math
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import ArrayLike

from hqp.angles import all_wrapped
from hqp.arrays import Mat, Vec
from hqp.declare.element import Element
from hqp.declare.law import P
from hqp.declare.stack import Level, Stack
from hqp.errors import DeclarationError
from hqp.loop.session import Controller
from hqp.programs.formulation import Velocity

PERIOD = 0.02
"""Step within a call of ``inverse_kinematics`` [s]."""

RETURN = 0.5
"""Return per call of a joint measured outside its limits, unless the pose needs more [deg]."""


class RobotKinematics:
    """The interface of ``lerobot.model.kinematics.RobotKinematics``: the position strictly before the orientation.

    Joints that are not named stay at home, but for those that the file couples with named ones.  The answer of a joint
    without limits is the turn nearest to the current position.  As in LeRobot, every position is in degrees, that of a
    prismatic joint d [m] as d 180 / pi.

    urdf_path: or a name that ``hqp.robots.load`` takes, or a fixed-base Robot.  target_frame_name: frame of the
    gripper.  joint_names: joints in the arguments of ``forward_kinematics`` and ``inverse_kinematics``, by default all
    of one axis in the order of the model, followers of mimic joints as well.
    steps: number of steps of 20 ms at a gain of 25/s in one call of ``inverse_kinematics``, at most.  Raises
    ModelError, FrameNotFound or JointNotFound, DeclarationError for joints of several axes.
    """

    def __init__(
        self,
        urdf_path: str | Path | Any,
        target_frame_name: str = "gripper_frame_link",
        joint_names: list[str] | None = None,
        *,
        steps: int = 30,
    ) -> None:
        from hqp import robots
        from hqp.tasks import JointLimits, Orientation, Position, Posture

        loaded: Any = urdf_path
        self.robot: Any = robots.load(urdf_path, floating=False) if isinstance(loaded, (str, Path)) else loaded
        self.target_frame_name = target_frame_name
        if self.robot.floating:
            raise DeclarationError("RobotKinematics", "floating base", value=self.robot.name, allowed="a fixed base")
        every = [n for n in self.robot.model.names[1:] if self.robot.joints(n).size == 1]
        self.joint_names = every if joint_names is None else list(joint_names)
        self._columns = self.robot.joints(self.joint_names)
        if self._columns.size != len(self.joint_names):
            raise DeclarationError("RobotKinematics", "joint_names", value=joint_names, allowed="joints of one axis")
        self._turning = np.flatnonzero(np.isin(self._columns, self.robot.continuous))
        self._steps = steps
        law = P(25.0)
        self._position = Position(frame=target_frame_name, law=law, name="position")
        self._turn = Orientation(frame=target_frame_name, law=law, name="orientation")
        back = math.radians(RETURN) / (PERIOD * max(1, steps))
        fixed: list[Element] = [JointLimits(acceleration=None, braking=None, return_velocity=back)]
        if still := self._still():
            fixed.append(Posture(joints=still, law=law, name="joints without a name"))
        with_turn = Stack(Level(self._position), Level(self._turn), subject_to=fixed)
        self._sessions = [
            Controller(stack, Velocity(), deadline=math.inf).session(self.robot, PERIOD, stuck=False)
            for stack in (with_turn, with_turn.without("orientation"))
        ]

    def forward_kinematics(self, joint_pos_deg: ArrayLike) -> Mat:
        """Pose ``(4, 4)`` of the target frame at joint positions [deg]; raises DeclarationError for too few."""
        state = self.robot.state(self._configuration(np.asarray(joint_pos_deg, dtype=np.float64)))
        pose = np.eye(4)
        pose[:3, 3], pose[:3, :3] = state.position(self.target_frame_name), state.rotation(self.target_frame_name)
        return pose

    def inverse_kinematics(
        self,
        current_joint_pos: ArrayLike,
        desired_ee_pose: ArrayLike,
        position_weight: float = 1.0,
        orientation_weight: float = 0.01,
    ) -> Vec:
        """Joint positions [deg] for a pose ``(4, 4)``, from the current ones; further entries are handed through.

        The orientation is met as well as the position allows; with ``orientation_weight`` 0 it is left free.  A joint
        that is outside its limits returns by half a degree in a call, more if the pose needs it.  Raises
        DeclarationError for too few positions.  position_weight: taken for LeRobot's sake, the order is strict.
        """
        current = np.asarray(current_joint_pos, dtype=np.float64)
        pose = np.asarray(desired_ee_pose, dtype=np.float64)
        q, v = self._configuration(current), np.zeros(self.robot.nv)
        free = orientation_weight == 0.0
        session = self._sessions[1 if free else 0]
        targets = [self._position.at(pose[:3, 3])]
        if not free:
            targets.append(self._turn.at(pose[:3, :3]))
        for _ in range(self._steps):
            tick = session.step(self.robot.state(q, v), *targets)
            if tick.solution is None:
                break
            q, v = tick.advance()
            if float(np.abs(v).max()) < 1e-4:
                break
        given = np.deg2rad(current[: len(self.joint_names)])
        moved = self.robot.state(q).angles[self._columns] - given
        moved[self._turning] = all_wrapped(moved[self._turning])
        found = current.copy()
        found[: len(self.joint_names)] = np.rad2deg(given + moved)
        return found

    def _configuration(self, degrees: Vec) -> Vec:
        """The named joints at their positions, coupled ones where the couplings put them, others at home."""
        robot, count = self.robot, len(self.joint_names)
        if degrees.ndim != 1 or degrees.size < count:
            allowed = f"at least {count} numbers [deg]: {', '.join(self.joint_names)}"
            raise DeclarationError("RobotKinematics", f"joint positions have shape {degrees.shape}", allowed=allowed)
        angles = robot.state(robot.home).angles.copy()
        angles[self._columns] = np.deg2rad(degrees[:count])
        for column, terms, offset in self._led():
            (_, factor), *others = terms
            angles[column] = (offset - sum(c * angles[other] for other, c in others)) / factor
        q: Vec = robot.configuration(angles)
        return q

    def _led(self) -> list[tuple[int, list[tuple[int, float]], float]]:
        """Joints that follow named ones, in the order in which they are known: column, terms with it first, offset."""
        from hqp.tasks import JointCoupling

        known, found, waiting = set(self._columns.tolist()), [], []
        for coupling in self.robot.couplings:
            if isinstance(coupling, JointCoupling):
                terms = [(int(self.robot.joints(n)[0]), c) for n, c in dict(coupling.coefficients).items()]
                waiting.append((terms, coupling.offset))
        while ready := [k for k in waiting if sum(column not in known for column, _ in k[0]) == 1]:
            waiting.remove(ready[0])
            terms = sorted(ready[0][0], key=lambda term: term[0] in known)
            known.add(terms[0][0])
            found.append((terms[0][0], terms, ready[0][1]))
        return found

    def _still(self) -> list[str]:
        """Joints that are neither named nor coupled with a named one."""
        state, moving = self.robot.state(), set(self._columns.tolist())
        coupled = [set(np.flatnonzero(k.jacobian(state).any(axis=0)).tolist()) for k in self.robot.couplings]
        for _ in coupled:
            moving.update(*(columns for columns in coupled if columns & moving))
        return [n for n in self.robot.model.names[1:] if not moving.intersection(self.robot.joints(n).tolist())]
