"""The motors of a plant: torque motors or position servos instead of those in the model file."""

from __future__ import annotations

import math
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field
from typing import Any, Literal

import numpy as np

from hqp.errors import DeclarationError, JointNotFound
from hqp.numbers import number, set_numbers

from .mujoco_extra import mujoco

Actuation = Literal["torque", "position", "native"]
_SINGLE = (mujoco.mjtJoint.mjJNT_HINGE, mujoco.mjtJoint.mjJNT_SLIDE)


@dataclass(frozen=True, kw_only=True)
class Servo:
    """Position servo: torque = kp (command - q) + kp damping_time (command rate - qd), within the effort limits.

    kp: by joint [N m/rad].  other: gain of every joint not named.  damping_time: kv / kp [s].  Raises DeclarationError
    for gains that are negative or not finite.
    """

    kp: Mapping[str, float] = field(default_factory=dict)
    other: float = 100.0
    damping_time: float = 0.05

    def __post_init__(self) -> None:
        object.__setattr__(self, "kp", {name: number("servo", name, value, 0.0) for name, value in self.kp.items()})
        set_numbers(self, "servo", ("other", "damping_time"), 0.0)

    def gain(self, joint: str) -> float:
        """kp of a joint [N m/rad]."""
        return self.kp.get(joint, self.other)

    @classmethod
    def from_description(cls, description: Mapping[str, Any]) -> Servo | None:
        """The servo of a ``robot.toml``: gains by group, joints overriding; None where it names none."""
        table = description.get("plant", {}).get("servo")
        if table is None:
            return None
        groups = description["groups"]
        kp = {joint: gain for group, gain in table["kp"].items() for joint in groups[group]}
        kp |= table.get("kp_joints", {})
        return cls(kp=kp, other=table["other"], damping_time=table["damping_time"])

    @classmethod
    def stiff(cls, robot: Any, bandwidth: float = 20.0) -> Servo:
        """Servos of a bandwidth omega [rad/s] for any robot: kp = I omega^2, critically damped.

        I is the inertia of all carried links about the joint's axis at home [kg m^2, kg]. A joint between a free base
        and a sole of the landmarks takes the inertia of the rest of the body if that is larger.
        """
        state = robot.state(robot.home)
        A = state.mass_matrix()
        inertia = np.diagonal(A).copy()
        soles = robot.landmarks.get("soles", ()) if robot.floating else ()
        for sole in soles:
            legs = robot.support(robot.model.getFrameId(sole)) > 0.0
            # M_bb is the inertia of the whole robot: turning about an axis s it is s^T M_bb s.
            axes = np.linalg.lstsq(robot.joint_twists[:, :6], robot.joint_twists, rcond=None)[0]
            above = np.einsum("ij,ij->j", axes, A[:6, :6] @ axes) - np.diagonal(A)
            inertia[legs] = np.maximum(inertia, above)[legs]
        kp = bandwidth**2 * inertia[robot.actuated]
        return cls(kp=dict(zip(robot.joint_names, kp.tolist(), strict=True)), damping_time=2.0 / bandwidth)


def fit(
    spec: Any,
    actuation: Actuation,
    servo: Servo | None,
    wanted: Sequence[str] | None = None,
    tendons: Mapping[str, tuple[Mapping[str, float], float]] | None = None,
) -> tuple[str, ...]:
    """Make every actuator of a MjSpec a motor or a servo; names of the driven joints, in actuator order.

    wanted: the joints to be driven; by default those of the file's actuators, or all hinges and slides where it has
    none.  tendons: coefficients of the joints that a motor pulls and its largest torque, by its joint.  One actuator
    a joint is kept, those of other tendons, sites and bodies go.  Limits are kept: the actuator's force range, a plain
    motor's control range, or the joint's force range.  ``native`` leaves everything as the file has it.  Raises
    JointNotFound for a wanted joint that the file lacks, DeclarationError for servos on tendons.
    """
    joints = {joint.name: joint for joint in spec.joints}
    if actuation == "native":
        return tuple(a.target if a.trntype == mujoco.mjtTrn.mjTRN_JOINT else a.name for a in spec.actuators)
    driven: list[str] = []
    tendons = tendons or {}
    if tendons and actuation == "position":
        names = ", ".join(tendons)
        raise DeclarationError("plant", f"no servo for motors of tendons: {names}", allowed="actuation='torque'")
    for actuator in list(spec.actuators):
        on_joint = actuator.trntype == mujoco.mjtTrn.mjTRN_JOINT
        on_wheel = actuator.trntype == mujoco.mjtTrn.mjTRN_SITE and bool(actuator.refsite)
        name = actuator.target if on_joint else actuator.name
        known = (wanted is None or name in wanted) and name not in tendons
        if name in driven or not known or not (on_wheel or (on_joint and joints[name].type in _SINGLE)):
            spec.delete(actuator)
        else:
            driven.append(name)
    missing = [n for n in wanted if n not in driven] if wanted else []
    if not driven and wanted is None:
        missing = [name for name, joint in joints.items() if joint.type in _SINGLE]
    for name in missing:
        if name not in joints or joints[name].type not in _SINGLE:
            raise JointNotFound(name, driven or joints, "the MuJoCo model, among its motors,")
        if name in tendons:
            _pull(spec, name, *tendons[name])
        else:
            spec.add_actuator(name=f"{name}_motor", target=name, trntype=mujoco.mjtTrn.mjTRN_JOINT)
        driven.append(name)
    for actuator, name in zip(spec.actuators, driven, strict=True):
        _make(actuator, name, joints.get(name), actuation, servo)
    return tuple(driven)


def _pull(spec: Any, name: str, coefficients: Mapping[str, float], most: float) -> None:
    """Add a motor that pulls joints by a fixed tendon, with its largest torque [N m or N]."""
    tendon = spec.add_tendon(name=f"{name}_tendon")
    for joint, factor in coefficients.items():
        tendon.wrap_joint(joint, factor)
    motor = spec.add_actuator(name=f"{name}_motor", target=tendon.name, trntype=mujoco.mjtTrn.mjTRN_TENDON)
    if most < math.inf:
        motor.forcerange, motor.forcelimited = (-most, most), mujoco.mjtLimited.mjLIMITED_TRUE


def _make(actuator: Any, name: str, joint: Any | None, actuation: Actuation, servo: Servo | None) -> None:
    effort = _effort(actuator, joint if actuator.trntype == mujoco.mjtTrn.mjTRN_JOINT else None)
    no, yes = mujoco.mjtLimited.mjLIMITED_FALSE, mujoco.mjtLimited.mjLIMITED_TRUE
    limited = yes if effort[0] < effort[1] else no
    if actuation == "torque":
        _set_force(actuator, 1.0, (0.0, 0.0))
        actuator.ctrlrange, actuator.ctrllimited = effort, limited
        actuator.forcelimited = no
    else:
        assert servo is not None
        kp = servo.gain(name)
        _set_force(actuator, kp, (kp, servo.damping_time * kp))
        actuator.ctrllimited = no
        actuator.forcerange, actuator.forcelimited = effort, limited
    if actuator.trntype == mujoco.mjtTrn.mjTRN_JOINT:
        actuator.gear = [1.0, 0.0, 0.0, 0.0, 0.0, 0.0]


def _set_force(actuator: Any, gain: float, stiffness: tuple[float, float]) -> None:
    """Make the force gain u - kp q - kv v, stiffness = (kp, kv); MuJoCo 3.2 has no set_to_motor and set_to_position."""
    kp, kv = stiffness
    actuator.dyntype, actuator.gaintype = mujoco.mjtDyn.mjDYN_NONE, mujoco.mjtGain.mjGAIN_FIXED
    actuator.biastype = mujoco.mjtBias.mjBIAS_AFFINE if kp or kv else mujoco.mjtBias.mjBIAS_NONE
    actuator.gainprm[0] = gain
    actuator.biasprm[:3] = 0.0, -kp, -kv


def _effort(actuator: Any, joint: Any | None) -> tuple[float, float]:
    """Least and largest torque [N m], of all ranges; (0, 0), MuJoCo's word for no limit, where the file gives none."""
    plain = (
        actuator.gaintype == mujoco.mjtGain.mjGAIN_FIXED
        and actuator.biastype == mujoco.mjtBias.mjBIAS_NONE
        and actuator.dyntype == mujoco.mjtDyn.mjDYN_NONE
    )
    gear = float(actuator.gear[0]) if joint is not None else 1.0
    ranges = [(actuator.forcelimited, actuator.forcerange, gear)]
    if plain:
        ranges.insert(0, (actuator.ctrllimited, actuator.ctrlrange, gear * float(actuator.gainprm[0])))
    if joint is not None:
        ranges.append((joint.actfrclimited, joint.actfrcrange, 1.0))
    least, largest = -math.inf, math.inf
    for limited, (low, high), factor in ranges:  # MuJoCo clips by one after the other
        if limited != mujoco.mjtLimited.mjLIMITED_FALSE and low < high:
            ends = sorted((float(low) * factor, float(high) * factor))
            least, largest = (min(max(end, ends[0]), ends[1]) for end in (least, largest))
    if least < largest < math.inf:
        return least, largest
    return 0.0, 0.0
