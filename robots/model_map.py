"""States of one robot in Pinocchio's coordinates and in MuJoCo's.

=====================  ==============================  =======================================
of a free body         Pinocchio (q, v)                MuJoCo (qpos, qvel)
=====================  ==============================  =======================================
orientation            quaternion x y z w              quaternion w x y z
linear velocity        base axes                       world axes
angular velocity       base axes                       base axes
=====================  ==============================  =======================================

Joints are matched by name; their order differs. A wheel may be a ball joint in MuJoCo and turn about one axle in
Pinocchio: its rate is the component about the axle, which the base carries.
"""

from __future__ import annotations

import math
from typing import Any

import numpy as np

from hqp.angles import wrapped
from hqp.arrays import Index, Mat, Vec
from hqp.errors import JointNotFound, ModelError

from .kinematic_tree import unit_twist
from .mjcf_names import joint_names
from .mujoco_extra import mujoco

_XYZW = [1, 2, 3, 0]  # positions of Pinocchio's quaternion entries in MuJoCo's


class ModelMap:
    """Index tables between Pinocchio's ``(q, v)`` and MuJoCo's ``(qpos, qvel)``, built once.

    simulated: a MjModel.  controlled: a pinocchio.Model, or a Robot that holds one.  Joints of the simulation that
    the controller does not know (rollers) are left out of q and zero in qpos.
    Raises ModelError where the bases or joint types do not fit, JointNotFound for a joint that MuJoCo lacks.
    """

    def __init__(self, simulated: Any, controlled: Any) -> None:
        model = getattr(controlled, "model", controlled)
        self.nq, self.nv = int(model.nq), int(model.nv)
        self._model = simulated
        self.floating = model.njoints > 1 and model.joints[1].nv == 6
        names = list(joint_names(simulated))
        base = self._match_base(model, names)
        self._free: list[tuple[int, int, int, int]] = []  # equally for free bodies
        simple: list[tuple[int, int, int, int]] = []  # idx_q, qposadr, idx_v, dofadr
        self._turning: list[tuple[int, int, int, int]] = []  # equally for continuous joints, (cos, sin) in q
        balls: list[tuple[int, int, int, int]] = []  # spherical in both
        self.wheels: dict[str, tuple[int, int, int, int]] = {}  # ball in MuJoCo, one axle in Pinocchio
        self.axles: dict[str, Vec] = {}
        for i in range(1, model.njoints):
            name, joint = base if i == 1 and self.floating else model.names[i], model.joints[i]
            if name not in names:
                raise JointNotFound(name, filter(None, names), "the MuJoCo model")
            there = names.index(name)
            entry = (
                int(joint.idx_q),
                int(simulated.jnt_qposadr[there]),
                int(joint.idx_v),
                int(simulated.jnt_dofadr[there]),
            )
            kind = int(simulated.jnt_type[there])
            single = kind in (mujoco.mjtJoint.mjJNT_HINGE, mujoco.mjtJoint.mjJNT_SLIDE)
            ball = kind == mujoco.mjtJoint.mjJNT_BALL
            if single and (joint.nq, joint.nv) == (1, 1):
                simple.append(entry)
            elif single and (joint.nq, joint.nv) == (2, 1):
                self._turning.append(entry)
            elif ball and (joint.nq, joint.nv) == (4, 3):
                balls.append(entry)
            elif kind == mujoco.mjtJoint.mjJNT_FREE and (joint.nq, joint.nv) == (7, 6):
                self._free.append(entry)
            elif ball and (joint.nq, joint.nv) == (1, 1):
                self.wheels[name] = entry
                self.axles[name] = _axis(model, i)
            else:
                raise ModelError(
                    f"joint {name!r} is a {joint.shortname()} in Pinocchio and a "
                    f"{mujoco.mjtJoint(kind).name} in MuJoCo: no map between these types"
                )
        self._single_q: Index = np.array([i for i, *_ in simple], dtype=np.intp)
        self._single_v: Index = np.array([j for *_, j, _ in simple], dtype=np.intp)
        same_q = [(i, a) for i, a, *_ in simple]  # coordinates that are the same number here and there
        same_v = [(j, b) for *_, j, b in simple]
        for i, a, j, b in self._free:
            same_q += [(i + k, a + k) for k in range(3)]
            same_v += [(j + k, b + k) for k in range(3)]  # once they are turned
            balls.append((i + 3, a + 3, j + 3, b + 3))
        for i, a, j, b in balls:
            same_q += [(i + k, a + _XYZW[k]) for k in range(4)]
            same_v += [(j + k, b + k) for k in range(3)]
        self._q, self._qpos = np.array(same_q, dtype=np.intp).reshape(-1, 2).T.copy()
        self._v, self._qvel = np.array(same_v, dtype=np.intp).reshape(-1, 2).T.copy()
        self._back: Vec = np.zeros(4)  # the conjugate of a free body's quaternion

    def _match_base(self, model: Any, names: list[str]) -> str:
        """Name in MuJoCo of the joint that the free base is, empty for a fixed base."""
        simulated, free = self._model, int(mujoco.mjtJoint.mjJNT_FREE)
        carried = {j for j in range(simulated.njnt) if names[j] in set(model.names[1:])}
        roots = {int(simulated.body_rootid[simulated.jnt_bodyid[j]]) for j in carried}
        found = [
            j
            for j in np.flatnonzero(simulated.jnt_type == free).tolist()
            if names[j] in model.names[1:2] or int(simulated.jnt_bodyid[j]) in roots
        ]
        if not self.floating:
            strange = [names[j] for j in found if names[j] not in set(model.names[1:])]
            if strange:
                raise ModelError(f"the base is fixed in Pinocchio and floating in MuJoCo ({strange[0]})")
            return ""
        if not found and not carried:  # a lone free body, with any joint name
            found = np.flatnonzero(simulated.jnt_type == free).tolist()
        if not found:
            raise ModelError("the base is floating in Pinocchio and fixed in MuJoCo")
        if not model.jointPlacements[1].isIdentity(1e-9):
            raise ModelError(
                "the Pinocchio model's free base starts from a displaced frame: load the robot from its file"
            )
        return next((names[j] for j in found if names[j] == model.names[1]), names[found[0]])

    def to_mujoco(self, q: Vec, v: Vec) -> tuple[Vec, Vec]:
        """``(qpos, qvel)`` of a state ``(q, v)``; coordinates that only MuJoCo has are at their neutral value."""
        qpos, qvel = self._model.qpos0.copy(), np.zeros(self._model.nv)
        qpos[self._qpos], qvel[self._qvel] = q[self._q], v[self._v]
        for _, a, j, b in self._free:
            qvel[b : b + 3] = _rotation(qpos[a + 3 : a + 7]) @ v[j : j + 3]
        for i, a, j, b in self._turning:
            qpos[a], qvel[b] = math.atan2(q[i + 1], q[i]), v[j]
        for name, (i, a, j, b) in self.wheels.items():
            qpos[a] = math.cos(0.5 * q[i])
            qpos[a + 1 : a + 4] = math.sin(0.5 * q[i]) * self.axles[name]
            qvel[b : b + 3] = self.axles[name] * v[j]
        return qpos, qvel

    def to_pinocchio(self, qpos: Vec, qvel: Vec) -> tuple[Vec, Vec]:
        """``(q, v)`` of a state ``(qpos, qvel)``.

        A ball wheel's angle is the turn of its orientation about the axle, in (-pi, pi]; it means something only
        while the ball has not rolled sideways.
        """
        q, v = np.zeros(self.nq), np.zeros(self.nv)
        q[self._q], v[self._v] = qpos[self._qpos], qvel[self._qvel]
        for _, a, j, b in self._free:
            mujoco.mju_negQuat(self._back, qpos[a + 3 : a + 7])
            mujoco.mju_rotVecQuat(v[j : j + 3], qvel[b : b + 3], self._back)
        for i, a, j, b in self._turning:
            q[i], q[i + 1], v[j] = math.cos(qpos[a]), math.sin(qpos[a]), qvel[b]
        for name, (i, a, j, b) in self.wheels.items():
            axle, ball = self.axles[name], qpos[a : a + 4]
            angle = 2.0 * math.atan2(axle @ ball[1:], ball[0])
            q[i] = wrapped(angle)
            turning = np.empty(3)
            mujoco.mju_rotVecQuat(turning, qvel[b : b + 3], ball)
            v[j] = axle @ turning
        return q, v

    def tangent(self, qpos: Vec) -> Mat:
        """B ``(nv_mujoco, nv)`` with qvel = B v at qpos, so that Pinocchio's mass matrix is B' M B."""
        B = np.zeros((self._model.nv, self.nv))
        B[self._qvel, self._v] = 1.0
        for _, a, j, b in self._free:
            B[b : b + 3, j : j + 3] = _rotation(qpos[a + 3 : a + 7])
        for _, _, j, b in self._turning:
            B[b, j] = 1.0
        for name, (_, a, j, b) in self.wheels.items():
            B[b : b + 3, j] = _rotation(qpos[a : a + 4]).T @ self.axles[name]
        return B

    def turn_joints(self, q: Vec, angles: Vec) -> None:
        """Add angles ``(nv,)`` [rad] to the single-axis joints of q, in place."""
        q[self._single_q] += angles[self._single_v]
        for i, _, j, _ in self.wheels.values():
            q[i] += angles[j]
        for i, _, j, _ in self._turning:
            angle = math.atan2(q[i + 1], q[i]) + angles[j]
            q[i], q[i + 1] = math.cos(angle), math.sin(angle)


def _axis(model: Any, index: int) -> Vec:
    """Axle of a single-axis joint in its parent's axes, ``(3,)``."""
    return np.asarray(model.jointPlacements[index].rotation @ unit_twist(model.joints[index]).angular)


def _rotation(wxyz: Vec) -> Mat:
    """Rotation matrix ``(3, 3)`` of a unit quaternion w x y z."""
    flat = np.empty(9)
    mujoco.mju_quat2Mat(flat, wxyz)
    return flat.reshape(3, 3)


def quaternion(rotation: Mat) -> Vec:
    """Unit quaternion x y z w of a rotation matrix ``(3, 3)``."""
    wxyz = np.empty(4)
    mujoco.mju_mat2Quat(wxyz, rotation.ravel())
    return wxyz[_XYZW]
