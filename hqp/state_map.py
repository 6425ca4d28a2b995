"""States of a simulator or a driver in hqp's order: quaternion, joints, axes of the base's velocity."""

from __future__ import annotations

from collections.abc import Sequence
from typing import Any, Literal, get_args

import numpy as np
from numpy.typing import ArrayLike, NDArray

from hqp import dlpack
from hqp.arrays import Mat
from hqp.errors import DeclarationError, JointNotFound, ModelError

Quaternion = Literal["xyzw", "wxyz"]
Axes = Literal["base", "world"]


class StateMap:
    """Map between arrays of another program and (q, v), for one state or for many along leading axes.

    q = (position ``(3,)`` [m], quaternion x y z w, joints [rad, m]), v = (linear, angular velocity in the axes of the
    base [m/s, rad/s], joint rates); without a free base, joints alone.

    robot: a Robot, or what steps an exported plan (``hqp.load``, ``Batch``).  joints: names in the order of the other
    program; names that the robot does not have are left out.  quaternion: order there.  linear, angular: axes of its
    base velocities: MuJoCo has ``"world"`` and ``"base"``, ROS odometry ``"base"`` twice, PyBullet and Isaac Lab's
    ``root_*_vel_w`` ``"world"`` twice.

    ``driven`` ``(2, n_actuated)`` has the places of the joints of a command in q and in v.

    Raises JointNotFound for a joint of the robot that ``joints`` lacks, ModelError for joints of several axes,
    DeclarationError for a name that occurs twice or an unknown convention.
    """

    def __init__(
        self,
        robot: Any,
        joints: Sequence[str],
        *,
        quaternion: Quaternion = "xyzw",
        linear: Axes = "base",
        angular: Axes = "base",
    ) -> None:
        for what, given, known in (
            ("quaternion", quaternion, Quaternion), ("linear", linear, Axes), ("angular", angular, Axes),
        ):  # fmt: skip
            if given not in get_args(known):
                raise DeclarationError("StateMap", what, value=given, allowed=", ".join(get_args(known)))
        self.joints = tuple(joints)
        if len(set(self.joints)) < len(self.joints):
            twice = next(name for name in self.joints if self.joints.count(name) > 1)
            raise DeclarationError("StateMap", "joints: a name that occurs twice", value=twice)
        self.nq, self.nv = int(robot.nq), int(robot.nv)
        own = _joints(robot)
        lacking = [name for name, *_ in own if name not in self.joints]
        if lacking:
            raise JointNotFound(lacking[0], self.joints, "the joints of the other program")
        self.floating = self.nv - len(own) == 6
        there = {name: k for k, name in enumerate(self.joints)}
        self._single = _columns((q, there[name]) for name, q, width, _ in own if width == 1)
        self._turning = _columns((q, there[name]) for name, q, width, _ in own if width == 2)
        self._rates = _columns((v, there[name]) for name, _, _, v in own)
        column = {name: (q, v) for name, q, _, v in own}
        self._commands = _columns((there[name], k) for k, name in enumerate(robot.joint_names) if name in column)
        self.driven = _columns(column[name] for name in robot.joint_names if name in column)
        self._size = len(robot.joint_names)
        self._order = [1, 2, 3, 0] if quaternion == "wxyz" else [0, 1, 2, 3]
        self._turned = tuple(name == "world" for name in (linear, angular))

    def state(
        self,
        positions: ArrayLike,
        rates: ArrayLike | None = None,
        *,
        place: ArrayLike | None = None,
        quaternion: ArrayLike | None = None,
        linear: ArrayLike | None = None,
        angular: ArrayLike | None = None,
    ) -> tuple[Any, Any]:
        """Return q ``(..., nq)`` and v ``(..., nv)``.

        positions, rates: joints in the other program's order ``(..., len(joints))`` [rad, m; per s].  place [m],
        quaternion, linear [m/s], angular [rad/s]: of a free base, ``(..., 3)`` and ``(..., 4)``; velocities are zero
        for None.  torch tensors are read in place through DLPack, and q and v are then tensors.
        Raises DeclarationError for a wrong shape, or a free base without a place or a quaternion.
        """
        given: tuple[Any, ...] = (positions, rates, place, quaternion, linear, angular)
        like = dlpack.first_foreign(*given)
        at, speed, origin, turn, *twist = map(_numbers, given)
        lead = at.shape[:-1]
        q, v = np.zeros((*lead, self.nq)), np.zeros((*lead, self.nv))
        self._require("positions", at, (*lead, len(self.joints)))
        q[..., self._single[0]] = at[..., self._single[1]]
        q[..., self._turning[0]], q[..., self._turning[0] + 1] = (
            f(at[..., self._turning[1]]) for f in (np.cos, np.sin)
        )
        if speed is not None:
            self._require("rates", speed, at.shape)
            v[..., self._rates[0]] = speed[..., self._rates[1]]
        if self.floating:
            if origin is None or turn is None:
                raise DeclarationError("StateMap", "a free base needs place and quaternion", value=None)
            self._require("place", origin, (*lead, 3))
            self._require("quaternion", turn, (*lead, 4))
            q[..., :3], q[..., 3:7] = origin, turn[..., self._order]
            for k, (what, rate) in enumerate(zip(("linear", "angular"), twist, strict=True)):
                if rate is None:
                    continue
                self._require(what, rate, (*lead, 3))
                v[..., 3 * k : 3 * k + 3] = _into_base(q[..., 3:7], rate) if self._turned[k] else rate
        return dlpack.returned(q, like), dlpack.returned(v, like)

    def command(self, command: Any, others: Any = 0.0) -> Any:
        """Return a command ``(..., n_actuated)`` in the other program's order ``(..., len(joints))``.

        others: values of joints that the command does not have.
        """
        like = dlpack.first_foreign(command, others)
        numbers = _numbers(command)
        self._require("command", numbers, (*numbers.shape[:-1], self._size))
        found = np.empty((*numbers.shape[:-1], len(self.joints)))
        found[...] = dlpack.numbers(others)
        found[..., self._commands[0]] = numbers[..., self._commands[1]]
        return dlpack.returned(found, like)

    @staticmethod
    def _require(what: str, given: Mat, shape: tuple[int, ...]) -> None:
        if given.shape != shape:
            raise DeclarationError("StateMap", f"shape of {what}", value=given.shape, allowed=str(shape))


def _joints(robot: Any) -> list[tuple[str, int, int, int]]:
    """Name, place in q, numbers in q and place in v of each joint but a free base."""
    model = getattr(robot, "model", None)
    if model is None:  # a plan: motors in the order of q, behind the base
        names, base = tuple(robot.joint_names), robot.nv - len(robot.joint_names)
        if base not in (0, 6) or robot.nq - len(names) != (7 if base else 0):
            raise ModelError(
                f"StateMap: {len(names)} motors, but {robot.nq} coordinates: a plan does not name joints that are no "
                "motors: give the robot instead"
            )
        return [(name, robot.nq - len(names) + k, 1, base + k) for k, name in enumerate(names)]
    found = []
    for name, joint in list(zip(model.names, model.joints, strict=True))[1:]:
        if joint.nv == 6 and joint.idx_q == 0:
            continue
        if joint.nv != 1:
            raise ModelError(f"StateMap: joint {name!r} has {joint.nv} axes, allowed 1: {joint.shortname()}")
        found.append((str(name), int(joint.idx_q), int(joint.nq), int(joint.idx_v)))
    return found


def _columns(pairs: Any) -> NDArray[np.intp]:
    return np.array(list(pairs), dtype=np.intp).reshape(-1, 2).T.copy()


def _numbers(given: Any) -> Any:
    return None if given is None else np.atleast_1d(np.asarray(dlpack.numbers(given), dtype=np.float64))


def _into_base(xyzw: Mat, world: Mat) -> Mat:
    """R' w of unit quaternions of any leading shape; zero for one of no length."""
    turn = xyzw / np.maximum(np.linalg.norm(xyzw, axis=-1, keepdims=True), 1e-300)
    axis, angle = -turn[..., :3], turn[..., 3:]
    across = 2.0 * np.cross(axis, world)
    return np.asarray(world + angle * across + np.cross(axis, across))
