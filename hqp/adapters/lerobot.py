"""LeRobot's RobotKinematics on hqp: degrees and homogeneous matrices in, degrees out, limits kept."""

from __future__ import annotations

from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import ArrayLike

from hqp.arrays import Mat, Vec
from hqp.declare.law import P
from hqp.declare.stack import Level, Stack
from hqp.loop.session import Controller
from hqp.programs.formulation import Velocity


class RobotKinematics:
    """The interface of ``lerobot.model.kinematics.RobotKinematics``: the position strictly before the orientation.

    urdf_path: or a name that ``hqp.robots.load`` takes, or a fixed-base Robot.  target_frame_name: frame of the
    gripper.  joint_names: joints in the arguments of ``forward_kinematics`` and ``inverse_kinematics``, all by default.
    steps: number of steps of 20 ms at a gain of 25/s in one call of ``inverse_kinematics``, at most.  Raises
    ModelError, FrameNotFound or JointNotFound.
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
        from hqp.tasks import JointLimits, Orientation, Position

        loaded: Any = urdf_path
        self.robot: Any = robots.load(urdf_path, floating=False) if isinstance(loaded, (str, Path)) else loaded
        self.target_frame_name = target_frame_name
        self.joint_names = list(self.robot.joint_names) if joint_names is None else list(joint_names)
        self._columns = self.robot.joints(self.joint_names)
        self._steps = steps
        law = P(25.0)
        self._position = Position(frame=target_frame_name, law=law, name="position")
        self._turn = Orientation(frame=target_frame_name, law=law, name="orientation")
        limits = [JointLimits(acceleration=None, braking=None)]
        with_turn = Stack(Level(self._position), Level(self._turn), subject_to=limits)
        self._sessions = [
            Controller(stack, Velocity()).session(self.robot, 0.02)
            for stack in (with_turn, with_turn.without("orientation"))
        ]

    def forward_kinematics(self, joint_pos_deg: ArrayLike) -> Mat:
        """Pose ``(4, 4)`` of the target frame at joint positions [deg]."""
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

        The orientation is met as well as the position allows; with ``orientation_weight`` 0 it is left free.
        position_weight: taken for LeRobot's sake, the order is strict.
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
        found = current.copy()
        found[: len(self.joint_names)] = np.rad2deg(self.robot.state(q).angles[self._columns])
        return found

    def _configuration(self, degrees: Vec) -> Vec:
        robot = self.robot
        step = np.zeros(robot.nv)
        home = robot.state(robot.home)
        step[self._columns] = np.deg2rad(degrees[: len(self.joint_names)]) - home.angles[self._columns]
        q: Vec = robot.integrate(robot.home, step, 1.0)
        return q
