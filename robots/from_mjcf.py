"""MJCF files as Pinocchio models, through MuJoCo's compiled model: the controlled model is the simulated one.

Actuated trees form the robot (``mjcf_parts``): several roots, several joints on a body, hinges, slides, balls and
free bodies.  Bodies that cannot move, mocap bodies among them, are fixed in the world where the file has them; other
moving bodies are obstacles.  Joint positions are MuJoCo's qpos, measured from the same zero.  ``agreement.check``
compares the result with MuJoCo.
"""

from __future__ import annotations

from collections.abc import Sequence
from operator import attrgetter
from pathlib import Path
from typing import Any

import numpy as np
import pinocchio as pin

from hqp.arrays import Mat, Vec
from hqp.errors import DeclarationError, ModelError

from . import mjcf_limits, mjcf_numbers, mjcf_obstacles, mjcf_parts
from .description import LARGEST, Description, require_room
from .mjcf_names import body_names, joint_names, site_name
from .mjcf_size import check_bodies
from .mujoco_extra import mujoco

_FREE, _BALL, _SLIDE, _HINGE = (int(getattr(mujoco.mjtJoint, f"mjJNT_{k}")) for k in ("FREE", "BALL", "SLIDE", "HINGE"))

_NUMBERS = (
    "opt.gravity", "body_pos", "body_quat", "body_ipos", "body_iquat", "body_mass", "body_inertia", "body_gravcomp",
    "jnt_pos", "jnt_axis", "jnt_stiffness", "dof_armature", "dof_damping", "dof_frictionloss", "qpos0", "key_qpos",
    "site_pos", "site_quat", "geom_pos", "geom_quat", "geom_size", "actuator_gear", "actuator_gainprm", "eq_data",
    "tendon_armature", "wrap_prm",
)  # fmt: skip
_RANGES = ("jnt_range", "jnt_actfrcrange", "actuator_forcerange", "actuator_ctrlrange")
"""Ranges read from a MjModel; ranges may be infinite."""


def compiled(path: Path, floating: bool | None = None, root: str | Sequence[str] | None = None) -> Any:
    """Compile the file to a MjModel, with the robot's root freed or fixed on request; raises ModelError."""
    spec = parsed(path)
    simulated = _compile(spec, path)
    if floating is not None and simulated.nv:
        set_root(spec, floating, root_bodies(simulated, mjcf_parts.robot_bodies(simulated, root, path)))
        simulated = _compile(spec, path)
    return simulated


def parsed(path: Path) -> Any:
    """The file as a MjSpec; raises ModelError."""
    check_bodies(path)
    mjcf_numbers.check(path)
    try:
        if path.suffix == ".xml":
            return mujoco.MjSpec.from_file(str(path.absolute()))
        spec = mujoco.MjSpec.from_string(path.read_text(encoding="utf-8"))  # MuJoCo's reader goes by the suffix
        spec.modelfiledir = str(path.absolute().parent)
        return spec
    except (OSError, ValueError, MemoryError, mujoco.FatalError) as error:
        raise ModelError(mjcf_numbers.explained(path, error)) from error


def _compile(spec: Any, path: Path) -> Any:
    try:
        return spec.compile()
    except (ValueError, MemoryError, mujoco.FatalError) as error:
        raise ModelError(mjcf_numbers.explained(path, error)) from error


def root_bodies(simulated: Any, own: frozenset[int]) -> list[int]:
    """Bodies that carry the robot and hang on the world, by index."""
    return sorted({int(simulated.body_rootid[body]) for body in own})


def _represented(simulated: Any, path: Path | str) -> None:
    """Raise ModelError for parts that a tree of rigid bodies cannot represent, and for invalid names and numbers."""
    if simulated.nflex:
        raise ModelError(f"{path}: deformable bodies (flex) are not supported, rigid bodies only")
    try:
        bytes(simulated.names).decode()
    except UnicodeDecodeError as error:
        raise ModelError(f"{path}: a name is not valid UTF-8: {error}") from error
    for name in (*_NUMBERS, *_RANGES):
        values = np.asarray(attrgetter(name)(simulated))
        if np.isnan(values).any() or (name in _NUMBERS and np.any(np.abs(values) >= LARGEST)):
            computed = f"{path}: MuJoCo computes {name} as a number that is not finite or too large"
            raise ModelError(mjcf_numbers.first(path) or computed)
    mjcf_limits.check(simulated, path)


def set_root(spec: Any, floating: bool, own: Sequence[int]) -> None:
    """Give the one root body of the robot a free joint in a MjSpec, or take it away.

    own: its root bodies, by index.  Raises DeclarationError where unclear.
    """
    bodies = list(spec.bodies)
    roots = [bodies[i] for i in own]
    free = [j for body in roots for j in body.joints if j.type == mujoco.mjtJoint.mjJNT_FREE]
    if floating == bool(free):
        return
    if len(free) > 1 or (floating and (len(roots) != 1 or list(roots[0].joints))):
        raise DeclarationError(
            "floating",
            f"the robot has {len(roots)} root bodies, {len(free)} of them free",
            value=floating,
            allowed="None, to use the root of the file",
        )
    for key in list(spec.keys):
        spec.delete(key)  # their qpos no longer fit
    if floating:
        roots[0].add_freejoint(name="root_joint")
    else:
        spec.delete(free[0])


def read(path: Path, floating: bool | None = None, root: str | Sequence[str] | None = None) -> Description:
    """The file's robot: model, home, keyframes, motors, couplings and limits; raises ModelError, DeclarationError.

    root: see ``mjcf_parts.robot_bodies``.
    """
    simulated = compiled(path, floating, root)
    found = describe(simulated, path, root)
    found.rooted = floating
    free = found.model.joints[1].shortname() == "JointModelFreeFlyer"
    if floating is not None and free != floating:
        raise DeclarationError(
            "floating",
            "root differs from that of the file",
            value=floating,
            allowed="None, to use the root of the file",
        )
    return found


def describe(simulated: Any, path: Path | None, root: str | Sequence[str] | None = None) -> Description:
    """The robot of a compiled MjModel, of a file or None, as a description; raises ModelError, DeclarationError."""
    where = "the MjModel" if path is None else path
    _represented(simulated, where)
    if simulated.nv == 0:
        raise ModelError(f"{where}: no joint (MuJoCo compiles it with nv = 0), needed at least one")
    own = mjcf_parts.robot_bodies(simulated, root, where)
    require_room(where, sum(int(simulated.body_dofnum[body]) for body in own))
    tree = _Tree(simulated, own)
    found = Description(model=tree.model, source=path, simulated=simulated, carriers=tree.carriers)
    found.roots = tuple(root_bodies(simulated, own))
    mjcf_limits.read(simulated, found, own)
    if tree.renamed:
        found.notes.append(f"sites with the name of another body are renamed to NAME_site: {', '.join(tree.renamed)}")
    if others := mjcf_parts.scene_roots(simulated, own):
        found.scene = frozenset(np.flatnonzero(simulated.body_treeid >= 0).tolist()) - own
        found.obstacles = mjcf_obstacles.read(simulated, tree.bodies, own)
        why = "no actuator moves them" if root is None else f"root={root!r}"
        note = f"not part of the robot ({why}), frames that stay in place and robot.obstacles: {', '.join(others)}"
        found.notes.append(note)
    return found


class _Tree:
    """Builds the Pinocchio model: a chain of joints for each of the robot's bodies, inertias, frames."""

    def __init__(self, simulated: Any, own: frozenset[int]) -> None:
        self.source, self.own = simulated, own
        self.model = model = pin.Model()
        model.name = bytes(simulated.names).split(b"\0")[0].decode() or "mjcf"
        model.gravity.linear = np.array(simulated.opt.gravity)
        if simulated.opt.disableflags & mujoco.mjtDisableBit.mjDSBL_GRAVITY:
            model.gravity.linear = np.zeros(3)
        self.bodies, self.joints = body_names(simulated), joint_names(simulated)
        self.carriers: list[tuple[int, Any]] = [(0, pin.SE3.Identity())] * simulated.nbody
        self.renamed: list[str] = []
        for body in self._order():
            self._add(body)
        self._add_frames()

    def _order(self) -> list[int]:
        """Bodies, parents first; the root that carries most motors, then joints, first, other free bodies last."""
        source = self.source
        driven = {int(source.jnt_bodyid[j]) for j in mjcf_limits.driven(source)}
        members: dict[int, list[int]] = {}
        for body in range(1, source.nbody):
            members.setdefault(int(source.body_rootid[body]), []).append(body)

        def rank(root: int) -> tuple[int, int]:
            carried = members[root]
            return sum(b in driven for b in carried), sum(int(source.body_jntnum[b]) for b in carried)

        base = max(members, key=rank)
        ordered = sorted(members, key=lambda root: (root != base, self._is_free(root)))
        return [body for root in ordered for body in members[root]]

    def _is_free(self, body: int) -> bool:
        source = self.source
        return bool(source.body_jntnum[body]) and source.jnt_type[source.body_jntadr[body]] == _FREE

    def _add(self, body: int) -> None:
        source, model = self.source, self.model
        joint, placement = self.carriers[int(source.body_parentid[body])]
        placement = placement * _placement(source.body_pos[body], source.body_quat[body])
        first, count = int(source.body_jntadr[body]), int(source.body_jntnum[body])
        for j in range(first, first + count if body in self.own else first):
            kind, anchor, axis = int(source.jnt_type[j]), np.array(source.jnt_pos[j]), np.array(source.jnt_axis[j])
            zero = float(source.qpos0[source.jnt_qposadr[j]])
            if kind == _FREE:
                joint = model.addJoint(0, pin.JointModelFreeFlyer(), pin.SE3.Identity(), self.joints[j])
                placement = pin.SE3.Identity()
                continue
            at = placement * pin.SE3(np.eye(3), anchor)
            if kind == _HINGE and zero:
                at = at * pin.SE3(pin.AngleAxis(-zero, axis).toRotationMatrix(), np.zeros(3))
            elif kind == _SLIDE and zero:
                at = at * pin.SE3(np.eye(3), -zero * axis)
            joint = model.addJoint(joint, _joint(kind, axis), at, self.joints[j])
            placement = pin.SE3(np.eye(3), -anchor)
        self.carriers[body] = (joint, placement)
        turn = _placement(source.body_ipos[body], source.body_iquat[body])
        moments = turn.rotation @ np.diag(source.body_inertia[body]) @ turn.rotation.T
        if joint:
            own = pin.Inertia(float(source.body_mass[body]), turn.translation, moments)
            model.appendBodyToJoint(joint, own, placement)

    def _add_frames(self) -> None:
        """Bodies, then sites, then joints: the first of a name keeps it, a site elsewhere is ``NAME_site``."""
        source, model = self.source, self.model
        for name, (joint, placement) in zip(self.bodies, self.carriers, strict=True):
            model.addFrame(pin.Frame(name, joint, 0, placement, pin.FrameType.BODY), False)
        places = dict(zip(self.bodies, self.carriers, strict=True))
        for s in range(source.nsite):
            name = source.site(s).name
            if not name:
                continue
            joint, placement = self.carriers[int(source.site_bodyid[s])]
            placement = placement * _placement(source.site_pos[s], source.site_quat[s])
            if name in places:
                if places[name][0] == joint and places[name][1].isApprox(placement, 1e-12):
                    continue
                self.renamed.append(name)
                name = site_name(name, places)
            places[name] = joint, placement
            model.addFrame(pin.Frame(name, joint, 0, placement, pin.FrameType.OP_FRAME), False)
        for joint in range(1, model.njoints):
            if model.names[joint] not in places:
                model.addFrame(pin.Frame(model.names[joint], joint, 0, pin.SE3.Identity(), pin.FrameType.JOINT), False)


def _joint(kind: int, axis: Vec) -> Any:
    if kind == _BALL:
        return pin.JointModelSpherical()
    plain = (
        ("JointModelRX", "JointModelRY", "JointModelRZ")
        if kind == _HINGE
        else ("JointModelPX", "JointModelPY", "JointModelPZ")
    )
    for unit, name in zip(np.eye(3), plain, strict=True):
        if np.array_equal(axis, unit):
            return getattr(pin, name)()
    return pin.JointModelRevoluteUnaligned(axis) if kind == _HINGE else pin.JointModelPrismaticUnaligned(axis)


def _placement(position: Vec, wxyz: Vec) -> Any:
    return pin.SE3(_rotation(wxyz), np.array(position, dtype=np.float64))


def _rotation(wxyz: Vec) -> Mat:
    flat = np.empty(9)
    mujoco.mju_quat2Mat(flat, np.asarray(wxyz, dtype=np.float64))
    return flat.reshape(3, 3)
