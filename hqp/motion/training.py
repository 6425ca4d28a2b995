"""Reference motions for training, in the layout that mjlab and Isaac Lab's motion trackers load."""

from __future__ import annotations

from collections.abc import Sequence
from pathlib import Path
from typing import Any, Protocol

import numpy as np
from scipy.spatial.transform import Rotation

from hqp.arrays import Mat, Vec
from hqp.declare.robot import Robot
from hqp.errors import DeclarationError, JointNotFound


class Frames(Protocol):
    """Configurations ``(T, nq)``, velocities ``(T, nv)``, fps [1/s]: a ``Retargeted``, a ``Walk`` of a walker."""

    @property
    def q(self) -> Mat: ...
    @property
    def v(self) -> Mat: ...
    @property
    def fps(self) -> float: ...


def training_arrays(
    robot: Robot, motion: Frames, *, joints: Sequence[str] | None = None, bodies: Sequence[str] | None = None
) -> dict[str, Any]:
    """Return the arrays that motion trackers load, of T frames, n joints and b bodies.

    fps ``(1,)`` [1/s]; joint_pos, joint_vel ``(T, n)`` [rad, rad/s]; body_pos_w ``(T, b, 3)`` [m]; body_quat_w ``(T, b,
    4)``, wxyz with w >= 0 in the first frame and no change of sign afterwards; body_lin_vel_w, body_ang_vel_w ``(T, b,
    3)`` [m/s, rad/s], at the body's origin, all in world axes; joint_names, body_names.

    joints, bodies: names in the order of the trainer, which its articulation lists (MuJoCo numbers depth first, Isaac
    Sim breadth first).  By default ``robot.joint_names`` and the links of the robot's file.  Raises JointNotFound,
    FrameNotFound for a name, DeclarationError for a motion of another robot or with a number that is not finite.
    """
    q, v = np.asarray(motion.q, dtype=np.float64), np.asarray(motion.v, dtype=np.float64)
    if q.ndim != 2 or q.shape != (len(q), robot.nq) or v.shape != (len(q), robot.nv):
        allowed = f"q (T, {robot.nq}), v (T, {robot.nv})"
        raise DeclarationError("training", "a motion of another robot", value=(q.shape, v.shape), allowed=allowed)
    if not (np.isfinite(q).all() and np.isfinite(v).all()):
        raise DeclarationError("training", "the motion has numbers that are not finite", allowed="finite q and v")
    names = tuple(robot.joint_names if joints is None else joints)
    for name in names:
        if name not in robot.joint_names:
            raise JointNotFound(str(name), robot.joint_names, robot.name)
    links = tuple(_links(robot) if bodies is None else bodies)
    for link in links:
        robot.frame(link)
    columns = robot.actuated[[robot.joint_names.index(name) for name in names]]
    angles, poses, twists = [], [], []
    for at, speed in zip(q, v, strict=True):
        state = robot.state(at, speed)
        angles.append(state.angles[columns])
        poses.append([state.pose(link) for link in links])
        twists.append([state.velocity(link) for link in links])
    pose, twist = np.reshape(poses, (len(q), len(links), 4, 4)), np.reshape(twists, (len(q), len(links), 6))
    return {
        "fps": np.array([motion.fps]), "joint_pos": np.array(angles), "joint_vel": v[:, columns],
        "body_pos_w": pose[..., :3, 3], "body_quat_w": _quaternions(pose[..., :3, :3]),
        "body_lin_vel_w": twist[..., :3], "body_ang_vel_w": twist[..., 3:],
        "joint_names": np.array(names), "body_names": np.array(links),
    }  # fmt: skip


def save_training(path: str | Path, robot: Robot, motion: Frames, **order: Any) -> Path:
    """Write ``training_arrays`` as .npz; order: its joints and bodies.  Raises its errors, and for another suffix."""
    path = Path(path)
    if path.suffix != ".npz":
        raise DeclarationError("training", "not a file of arrays", value=str(path), allowed="a path that ends in .npz")
    np.savez_compressed(path, **training_arrays(robot, motion, **order))
    return path


def _links(robot: Any) -> list[str]:
    return [frame.name for frame in robot.model.frames if frame.type.name == "BODY" and frame.parentJoint > 0]


def _quaternions(R: Mat) -> Vec:
    """Quaternions wxyz of ``(T, b, 3, 3)`` without a change of sign between frames."""
    found = Rotation.from_matrix(R.reshape(-1, 3, 3)).as_quat()[:, [3, 0, 1, 2]].reshape(*R.shape[:2], 4)
    signs = np.sign(np.sum(found[1:] * found[:-1], axis=-1))
    first = np.where(found[:1, :, 0] < 0.0, -1.0, 1.0)
    turned = np.cumprod(np.concatenate((first, np.where(signs < 0.0, -1.0, 1.0))), axis=0)
    return np.asarray(found * turned[..., None])
