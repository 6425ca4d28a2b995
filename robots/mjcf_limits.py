"""Data of an MJCF besides the tree: limits, motors, keyframes, couplings, and parts without a counterpart here."""

from __future__ import annotations

import math
from collections.abc import Sequence
from pathlib import Path
from typing import Any

import numpy as np

from hqp.arrays import Vec, rank
from hqp.errors import ModelError

from . import coupled, mjcf_equalities, xml_lines
from .description import Description
from .mjcf_names import body_names, joint_names
from .mjcf_parts import own_joints
from .model_map import ModelMap
from .mujoco_extra import mujoco

_SLIDE, _HINGE = int(mujoco.mjtJoint.mjJNT_SLIDE), int(mujoco.mjtJoint.mjJNT_HINGE)
_DIRECT = [int(k) for k in (mujoco.mjtTrn.mjTRN_JOINT, mujoco.mjtTrn.mjTRN_JOINTINPARENT)]
_RANGES = {
    "jnt_range": "range",
    "jnt_actfrcrange": "actuatorfrcrange",
    "actuator_ctrlrange": "ctrlrange",
    "actuator_forcerange": "forcerange",
    "tendon_range": "range",
}
"""Ranges by the field of a MjModel that holds them."""
_TENDONS = {
    "limits (a JointCoupling ties joints to each other)": ("tendon_limited",),
    "springs": ("tendon_stiffness",),
    "damping and friction": ("tendon_damping", "tendon_frictionloss"),
}
"""Parts of tendons that the model lacks, with the fields of a MjModel that hold them."""
_HOMES = ("home", "stand", "standing")


def check(simulated: Any, path: Path | str) -> None:
    """Raise ModelError for ranges that MuJoCo drops since they hold nothing, negative armature, motors of gear 0."""
    joints, motors = joint_names(simulated), [_motor_name(simulated, a) for a in range(simulated.nu)]
    tendons = [simulated.tendon(t).name or str(t) for t in range(simulated.ntendon)]
    parts = {"jnt": (joints, _joint), "actuator": (motors, _actuator), "tendon": (tendons, _tendon_place)}
    for field, word in _RANGES.items():
        names, where = parts[field.split("_")[0]]
        for name, (low, high) in zip(names, getattr(simulated, field), strict=True):
            if low >= high and (low or high):
                raise ModelError(f'{where(path, name)}: {word}="{low:g} {high:g}"; allowed: the lower end first')
    for j, name in enumerate(joints):
        if simulated.dof_armature[simulated.jnt_dofadr[j]] < 0.0:
            raise ModelError(f"{_joint(path, name)}: negative armature; allowed: 0 or above")
    for a, name in enumerate(motors):
        if int(simulated.actuator_trntype[a]) in _DIRECT and not np.any(simulated.actuator_gear[a]):
            raise ModelError(f"{_actuator(path, name)}: gear 0 moves nothing; allowed: another gear")


def _joint(path: Path | str, name: str) -> str:
    return f"{xml_lines.where(path, './/joint', name)}: joint {name!r}"


def _actuator(path: Path | str, name: str) -> str:
    return f"{xml_lines.where(path, './/actuator/*', name)}: actuator {name!r}"


def _tendon_place(path: Path | str, name: str) -> str:
    return f"{xml_lines.where(path, './/tendon/*', name)}: tendon {name!r}"


def read(simulated: Any, found: Description, own: frozenset[int]) -> None:
    """Fill in all of a description but its model, from a compiled MjModel; own: the bodies of the robot."""
    _read_joints(simulated, found, own)
    mjcf_equalities.read(simulated, found, own)
    _read_motors(simulated, found, own)
    _read_notes(simulated, found, own)


def _read_joints(simulated: Any, found: Description, own: frozenset[int]) -> None:
    """Position, effort and friction of each joint, rotor inertia, home and keyframes, in Pinocchio's order."""
    model = found.model
    lower, upper = np.full(model.nq, -np.inf), np.full(model.nq, np.inf)
    model.velocityLimit = np.full(model.nv, np.inf)
    effort, unequal, weak = np.full(model.nv, np.inf), [], {}
    for name, j in own_joints(simulated, own).items():
        joint, dof = model.joints[model.getJointId(name)], int(simulated.jnt_dofadr[j])
        columns = slice(joint.idx_v, joint.idx_v + joint.nv)
        model.armature[columns] = simulated.dof_armature[dof : dof + joint.nv]
        model.damping[columns] = np.asarray(simulated.dof_damping[dof : dof + joint.nv]).reshape(joint.nv, -1)[:, 0]
        model.friction[columns] = simulated.dof_frictionloss[dof : dof + joint.nv]
        low, high = (float(x) for x in simulated.jnt_range[j])
        if simulated.jnt_limited[j] and joint.nq == 1:
            lower[joint.idx_q], upper[joint.idx_q] = low, high
        elif simulated.jnt_limited[j] and joint.nv == 3:
            found.cones[name] = high
        if joint.nv == 1:
            bounds, pulls = _bounds(simulated, j), _pulls(simulated, j)
            effort[joint.idx_v], equal = _effort(bounds + pulls)
            if not equal:
                unequal.append(name)
            allowed, given = _effort(bounds)[0], _effort(pulls)[0]
            if given < allowed < math.inf:
                weak[f"{name} ({given:.4g} of {allowed:.4g})"] = given / allowed
    if weak:
        weakest = _some(sorted(weak, key=weak.__getitem__))
        found.notes.append(
            f"motors (forcerange, gear times ctrlrange) are weaker than actuatorfrcrange: {weakest} N m or N, using "
            "the smaller one; a ctrlrange of -1 to 1 without a gear is a motor of 1 N m"
        )
    if unequal:
        found.notes.append(f"unequal effort limits of a joint, using the smaller one: {_some(unequal)}")
    model.lowerPositionLimit, model.upperPositionLimit, model.effortLimit = lower, upper, effort
    convert = ModelMap(simulated, model)
    rest = np.zeros(simulated.nv)
    for k in range(simulated.nkey):
        name = simulated.key(k).name or f"key_{k}"
        found.configurations[name] = convert.to_pinocchio(np.array(simulated.key_qpos[k]), rest)[0]
    initial = convert.to_pinocchio(np.array(simulated.qpos0), rest)[0]
    named = [found.configurations[h] for h in (*_HOMES, *list(found.configurations)[:1]) if h in found.configurations]
    found.home = named[0].copy() if named else initial


def driven(simulated: Any) -> list[int]:
    """Joints that an actuator drives directly, in the order of the model's joints."""
    on_joint = np.isin(simulated.actuator_trntype, _DIRECT)
    return sorted({int(j) for j in simulated.actuator_trnid[on_joint, 0]})


def _read_motors(simulated: Any, found: Description, own: frozenset[int]) -> None:
    """Actuated joints: joints of joint actuators, a joint of each fixed tendon; without either all of one axis."""
    names = joint_names(simulated)
    moved = [j for j in driven(simulated) if int(simulated.jnt_bodyid[j]) in own]
    single = {j for j in range(simulated.njnt) if int(simulated.jnt_type[j]) in (_SLIDE, _HINGE)}
    motors = [names[j] for j in moved if j in single]
    if balls := [names[j] for j in moved if j not in single]:
        found.notes.append(f"motors on joints with several axes are ignored: {', '.join(balls)}")
    on_joint = np.isin(simulated.actuator_trntype, _DIRECT)
    used = sum(int(a) in moved for a in simulated.actuator_trnid[on_joint, 0])
    if several := [names[j] for j in moved if np.sum(simulated.actuator_trnid[on_joint, 0] == j) > 1]:
        found.notes.append(f"joints with several actuators have one motor, of their smallest limit: {_some(several)}")
    for a in np.flatnonzero(simulated.actuator_trntype == int(mujoco.mjtTrn.mjTRN_TENDON)).tolist():
        joint = _tendon_motor(simulated, found, own, a, motors)
        motors += [joint] if joint else []
        used += bool(joint)
    found.actuated = tuple(motors) if motors else None
    if simulated.nu > used:
        instead = "" if motors else ", and all joints of one axis have a motor instead"
        found.notes.append(f"{simulated.nu - used} actuators of the file are ignored: they drive no joint{instead}")


def _tendon_motor(simulated: Any, found: Description, own: frozenset[int], actuator: int, motors: Sequence[str]) -> str:
    """The joint that names the motor of a fixed tendon, with the motor's effort limit; "" if it adds no motor.

    With length = sum g_i q_i + constant in joints q_i that follow no others, a tendon's force f is the force g_i f on
    each of them. The motor's joint is the first one without a motor of its own: its torque g_1 f is the command, and
    g_i / g_1 are the coefficients of the others.
    """
    tendon, names = int(simulated.actuator_trnid[actuator, 0]), joint_names(simulated)
    title = simulated.actuator(actuator).name or simulated.tendon(tendon).name or str(actuator)
    known = mjcf_equalities.lengths(simulated)
    if tendon not in known:
        found.notes.append(f"motor {title} pulls a tendon along sites or geometries: ignored")
        return ""
    terms = {names[j]: c for j, c in known[tendon][0].items() if int(simulated.jnt_bodyid[j]) in own}
    leading = coupled.leaders(found.couplings, terms)
    joint_name = next((j for j in leading if j not in motors), "")
    rows = [found.tendons.get(motor, {motor: 1.0}) for motor in motors] + [leading]
    if not joint_name or rank(np.array([[row.get(j, 0.0) for j in found.model.names] for row in rows])) < len(rows):
        found.warnings.append(
            f"motor {title} moves the joints {', '.join(terms)} by a fixed tendon and is ignored: motors of the file "
            f"move {', '.join(leading) or 'no joints'} alike"
        )
        return ""
    ratio = leading[joint_name]
    ends = [sorted(abs(ratio * x) for x in r) for r in _ranges(simulated, actuator) if np.any(r)]
    ends += [  # MuJoCo clips the force on each joint of the tendon
        sorted(abs(ratio / c * x) for x in r) for j, c in known[tendon][0].items() if c for r in _bounds(simulated, j)
    ]
    joint = found.model.joints[found.model.getJointId(joint_name)]
    found.model.effortLimit[joint.idx_v] = min((low or high for low, high in ends), default=math.inf)
    others = {j: c / ratio for j, c in leading.items() if j != joint_name}
    also = "; " + ", ".join(f"{c:g} times that on {j}" for j, c in others.items()) if others else ""
    found.notes.append(
        f"motor {title} acts by a fixed tendon on {', '.join(terms)}: its joint is {joint_name}, with {ratio:g} times "
        f"the force of the tendon{also}"
    )
    if others:
        found.tendons[joint_name] = {joint_name: 1.0, **others}
    return joint_name


def _bounds(simulated: Any, joint: int) -> list[Vec]:
    """The range of the force on a joint, for any actuators; empty without one."""
    return [simulated.jnt_actfrcrange[joint]] if simulated.jnt_actfrclimited[joint] else []


def _pulls(simulated: Any, joint: int) -> list[Vec]:
    """Ranges of the forces that the actuators of a joint transmit."""
    on_joint = np.isin(simulated.actuator_trntype, _DIRECT)
    own = np.flatnonzero((simulated.actuator_trnid[:, 0] == joint) & on_joint)
    return [one for a in own.tolist() for one in _ranges(simulated, a)]


def _effort(ranges: list[Vec]) -> tuple[float, bool]:
    """The smaller end of effort ranges [N m or N], and whether their ends are equal.

    The other end if a range goes one way only (muscles, cables); inf without a range.
    """
    ends = [(float(min(abs(r))), float(max(abs(r))), r[0] * r[1] < 0.0) for r in ranges if np.any(r)]
    least = min((small if both else large for small, large, both in ends), default=math.inf)
    return least, all(small == large for small, large, both in ends if both)


def _ranges(simulated: Any, actuator: int) -> list[Vec]:
    """Ranges of the force that an actuator transmits: from the file, and from the control of a plain motor."""
    gear, found = float(simulated.actuator_gear[actuator, 0]), []
    if simulated.actuator_forcelimited[actuator]:
        found.append(gear * simulated.actuator_forcerange[actuator])
    plain = simulated.actuator_gaintype[actuator] == mujoco.mjtGain.mjGAIN_FIXED
    plain &= simulated.actuator_biastype[actuator] == mujoco.mjtBias.mjBIAS_NONE
    plain &= simulated.actuator_dyntype[actuator] == mujoco.mjtDyn.mjDYN_NONE
    if plain and simulated.actuator_ctrllimited[actuator]:
        found.append(gear * float(simulated.actuator_gainprm[actuator, 0]) * simulated.actuator_ctrlrange[actuator])
    return found


def _read_notes(simulated: Any, found: Description, own: frozenset[int]) -> None:
    bodies, stiffness = body_names(simulated), np.asarray(simulated.jnt_stiffness).reshape(simulated.njnt, -1)[:, 0]
    if springs := [name for name, j in own_joints(simulated, own).items() if stiffness[j]]:
        found.notes.append(f"springs of the file are ignored in the model's forces: {_some(springs)}")
    if light := [bodies[b] for b in np.flatnonzero(simulated.body_gravcomp) if b in own]:
        found.notes.append(f"gravity compensation of the file is ignored in the model's forces: {_some(light)}")
    ranged = (simulated.jnt_range[:, 0] < simulated.jnt_range[:, 1]) & (np.asarray(simulated.jnt_limited) == 0)
    if loose := [name for name, j in own_joints(simulated, own).items() if ranged[j]]:
        found.notes.append(f'ranges with limited="false" limit nothing: {_some(loose)}')
    for what, fields in _TENDONS.items():
        pulls = [np.any(np.reshape([getattr(simulated, f)[t] for f in fields], -1)) for t in range(simulated.ntendon)]
        tendons = [_tendon(simulated, t) for t in np.flatnonzero(pulls).tolist()]
        if tendons := sorted(tendons, key=lambda names: -names.count(",")):  # coupled joints first
            found.notes.append(f"{what} of tendons are ignored: {_some(tendons)}")
    if simulated.ntendon and np.any(simulated.tendon_armature):
        found.warnings.append("rotor inertia of tendons is ignored in the model's inertia, MuJoCo has it")


def _motor_name(simulated: Any, actuator: int) -> str:
    return simulated.actuator(actuator).name or str(actuator)


def _tendon(simulated: Any, tendon: int) -> str:
    """Name of a tendon, with the joints that it goes along if it is fixed, and its range if it has one."""
    name, joints = simulated.tendon(tendon).name or str(tendon), joint_names(simulated)
    terms = mjcf_equalities.lengths(simulated).get(tendon, ({}, 0.0))[0]
    along = f" along {', '.join(joints[j] for j in terms)}" if terms else ""
    low, high = simulated.tendon_range[tendon]
    return f"{name}{along}" + (f" in [{low:g}, {high:g}]" if simulated.tendon_limited[tendon] else "")


def _some(names: list[str]) -> str:
    return ", ".join(names[:4]) + (f" and {len(names) - 4} more" if len(names) > 4 else "")
