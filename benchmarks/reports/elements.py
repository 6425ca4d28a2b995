"""Every element in every formulation, run; and who else has it.

``python -m benchmarks.reports.elements`` writes the table of docs/elements-compared.md.
"""

from __future__ import annotations

import math
from collections.abc import Callable
from functools import cache
from pathlib import Path

import numpy as np

import hqp
from benchmarks.reports import report
from hqp import Level, Stack, shapes
from hqp import tasks as t
from hqp.element import Element
from hqp.errors import DeclarationError
from hqp.formulation import Formulation
from hqp.robots import Robot

PAGE = Path(__file__).parents[2] / "docs" / "elements-compared.md"
MARK = "<!-- table: python -m benchmarks.reports.elements -->"
FORMULATIONS: dict[str, Callable[[], Formulation]] = {
    "velocity": hqp.Velocity,
    "acceleration": hqp.Acceleration,
    "torque": hqp.Torque,
}
LIBRARIES = ("pink 4.4", "mink 1.3", "placo 0.10", "tsid 1.10", "embodik 0.23")

HAND, HEAD, FEET = "r_palm", "head", ("l_sole", "r_sole")
FOOT = "l_sole"
EXAMPLES: dict[str, Callable[[], tuple[Element, ...]]] = {
    "AlignAxis": lambda: (t.AlignAxis(frame=HAND),),
    "BallLimits": lambda: (t.BallLimits(),),
    "BaseVelocityLimits": lambda: (t.BaseVelocityLimits(linear=0.5, angular=1.0),),
    "CenterOfPressure": lambda: (t.CenterOfPressure(contact=FOOT, rectangle=(-0.05, 0.05, -0.03, 0.03)),),
    "CollisionAvoidance": lambda: (t.CollisionAvoidance(world=shapes.sphere("ball", 0.1, (0.6, 0.0, 1.0))),),
    "Com": lambda: (t.Com(),),
    "Cone": lambda: (t.Cone(t.AlignAxis(frame=HAND), angle=0.4),),
    "ContactForce": lambda: (t.ContactForce(contact=FOOT),),
    "Damping": lambda: (t.Damping(kinetic_energy=True),),
    "Distance": lambda: (t.Distance(frame=HAND, other="l_palm"),),
    "EdgeContact": lambda: (t.EdgeContact(frame="l_palm", axis="y"),),
    "ExternalWrench": lambda: (t.ExternalWrench(frame=HAND),),
    "FixedContact": lambda: (t.FixedContact(frame="l_palm"),),
    "ForceLimits": lambda: (t.ForceLimits(contact=FOOT, force=1e4, moment=1e4),),
    "FrictionCone": lambda: (t.FrictionCone(contact=FOOT, mu=0.8),),
    "Frozen": lambda: (t.Frozen(joints=["R_EB"]),),
    "JointCoupling": lambda: (t.JointCoupling({"R_EB": 1.0, "L_EB": -1.0}),),
    "JointLimits": lambda: (t.JointLimits(),),
    "JointTorque": lambda: (t.JointTorque(),),
    "JointVelocity": lambda: (t.JointVelocity(),),
    "LookAt": lambda: (t.LookAt(frame=HAND),),
    "LowAcceleration": lambda: (t.LowAcceleration(),),
    "Manipulability": lambda: (t.Manipulability(frame=HAND),),
    "Momentum": lambda: (t.Momentum(),),
    "OmniWheelContact": lambda: (t.OmniWheelContact(wheel="l_palm", radius=0.1, axle=(0.0, 1.0, 0.0)),),
    "Orientation": lambda: (t.Orientation(frame=HAND),),
    "Payload": lambda: (t.Payload(frame=HAND),),
    "PointContact": lambda: (t.PointContact(frame="l_palm"),),
    "Pose": lambda: (t.Pose(frame=HAND),),
    "Position": lambda: (t.Position(frame=HAND),),
    "Posture": lambda: (t.Posture(),),
    "SupportPolygon": lambda: (t.SupportPolygon(sole=(-0.05, 0.05, -0.03, 0.03)),),
    "TorqueLimits": lambda: (t.TorqueLimits(),),
    "TorqueSpeedLimits": lambda: (t.TorqueSpeedLimits(),),
    "UnilateralContact": lambda: (t.UnilateralContact(contact=FOOT),),
    "Weld": lambda: (t.Weld(frame=HAND, relative_to="l_palm"),),
    "WheelContact": lambda: (t.WheelContact(wheel="l_palm", radius=0.1, axle=(0.0, 1.0, 0.0)),),
    "Within": lambda: (t.Within(t.Position(frame=HAND), lower=-0.1, upper=0.1),),
}
"""An element of each class, on CBi standing on both feet."""

HELD = ("ExternalWrench", "Payload", "Frozen", "JointLimits", "BallLimits", "TorqueLimits", "ForceLimits")
"""Those that belong into ``subject_to``."""
CONTACTS = ("EdgeContact", "FixedContact", "OmniWheelContact", "PointContact", "WheelContact", "Weld", "JointCoupling")

ELSEWHERE: dict[str, tuple[str, str, str, str, str]] = {
    "AlignAxis": ("", "AxisAlignTask", "AxisAlignTask", "", ""),
    "BaseVelocityLimits": ("FloatingBaseVelocityLimit", "FreeJointVelocityLimit", "", "", "set_base_*_bounds"),
    "CenterOfPressure": ("", "", "Contact6D", "Contact6d, TaskCopEquality", "ZmpAccelerationConstraint"),
    "CollisionAvoidance": (
        "SelfCollisionBarrier", "CollisionAvoidanceLimit", "AvoidSelfCollisions*Constraint", "", "CollisionConstraint",
    ),
    "Com": ("ComTask", "ComTask", "CoMTask", "TaskComEquality", "COMTask"),
    "Cone": ("", "", "ConeConstraint", "", ""),
    "ContactForce": ("", "", "Contact (objective weights)", "ContactBase force task", ""),
    "Damping": ("DampingTask", "DampingTask, KineticEnergyRegularizationTask", "RegularizationTask", "", ""),
    "Distance": ("", "", "DistanceTask", "", ""),
    "EdgeContact": ("", "", "LineContact", "", ""),
    "ExternalWrench": ("", "", "ExternalWrenchContact", "", ""),
    "FixedContact": ("FrameTask as constraint", "FrameTask as constraint", "Contact6D", "Contact6d", "TightFramePose"),
    "FrictionCone": ("", "", "Contact", "Contact6d", ""),
    "Frozen": ("", "DofFreezingTask", "mask_dof", "", "excluded_joint_indices"),
    "JointCoupling": ("JointCouplingTask, LinearHolonomicTask", "EqualityConstraintTask", "GearTask", "", ""),
    "JointLimits": (
        "ConfigurationLimit, VelocityLimit, AccelerationLimit", "ConfigurationLimit, VelocityLimit",
        "enable_*_limits", "TaskJointBounds", "enable_*_limits",
    ),
    "JointTorque": ("", "", "DynamicsTorqueTask", "TaskActuationEquality", ""),
    "JointVelocity": ("JointVelocityTask", "", "", "", ""),
    "LookAt": ("", "LookAtTask", "", "", ""),
    "LowAcceleration": ("LowAccelerationTask", "", "", "", ""),
    "Manipulability": ("ManipulabilityTask", "", "ManipulabilityTask", "", "ManipulabilityTask"),
    "Momentum": ("", "", "CentroidalMomentumTask", "TaskAMEquality", "CentroidalMomentumTask"),
    "OmniWheelContact": ("OmniwheelTask", "", "WheelTask", "", ""),
    "Orientation": ("FrameTask", "FrameTask", "OrientationTask", "TaskSE3Equality, masked", "FrameTask"),
    "PointContact": ("", "", "PointContact", "ContactPoint", "TightPoint"),
    "Pose": ("FrameTask", "FrameTask", "FrameTask", "TaskSE3Equality", "FrameTask"),
    "Position": ("FrameTask", "FrameTask", "PositionTask", "TaskSE3Equality, masked", "FrameTask"),
    "Posture": ("PostureTask", "PostureTask", "JointsTask", "TaskJointPosture", "PostureTask"),
    "SupportPolygon": ("", "", "CoMPolygonConstraint", "", "ComSupportPolygon*"),
    "TorqueLimits": ("", "", "enable_torque_limits", "TaskActuationBounds", "EffortConstraintOptions"),
    "TorqueSpeedLimits": ("", "", "enable_velocity_vs_torque_limits", "", ""),
    "UnilateralContact": ("", "", "Contact", "Contact6d", ""),
    "Weld": ("", "EqualityConstraintTask", "RelativeFrameTask, hard", "ContactTwoFramePositions", "RelativePose"),
    "WheelContact": ("RollingTask", "", "WheelTask", "", ""),
    "Within": ("PositionBarrier, BodySphericalBarrier", "", "", "", "TaskAccelerationBounds"),
}  # fmt: skip
"""Class or function of pink, mink, placo, tsid and embodik by element; nobody else has what is not listed."""


@cache
def _robot(name: str) -> Robot:
    if name == "BallLimits":
        return _ball()
    return hqp.robots.load("cbi")


def _ball() -> Robot:
    import pinocchio as pin

    model = pin.Model()
    joint = model.addJoint(0, pin.JointModelSpherical(), pin.SE3.Identity(), "ball")
    model.appendBodyToJoint(joint, pin.Inertia.FromSphere(1.0, 0.1), pin.SE3(np.eye(3), np.array([0.0, 0.0, 0.2])))
    robot = Robot(model, name="ball")
    robot.cones["ball"] = 0.5
    return robot


def works(name: str, formulation: str) -> bool:
    """Whether a stack with the element takes three ticks with usable answers; False where it is refused by name."""
    robot, elements = _robot(name), EXAMPLES[name]()
    feet = [] if name == "BallLimits" else [t.FixedContact(frame=f, name=f) for f in FEET]
    hard: list[Element] = [*feet]
    levels = []
    if name in (*HELD, *CONTACTS):
        hard += elements
    else:
        levels.append(Level(*elements, name="own"))
    if not any(isinstance(e, t.Posture) for e in elements):
        levels.append(Level(t.Posture(name="posture"), name="posture"))
    try:
        controller = hqp.Controller(Stack(*levels, subject_to=hard), FORMULATIONS[formulation](), deadline=math.inf)
        session = controller.session(robot, 0.002)
    except DeclarationError:
        return False
    q, v = robot.home, np.zeros(robot.nv)
    for _ in range(3):
        tick = session.step(robot.state(q, v))
        if not tick.status.usable:
            raise AssertionError(f"{name}, {formulation}: {tick.status.name}: {tick.notes}")
        q, v = tick.advance()
    return True


def table() -> str:
    """The table, every cell of ours run."""
    rows = []
    for name in sorted(t.__all__):
        others = ELSEWHERE.get(name, ("",) * len(LIBRARIES))
        rows.append((f"`{name}`", *("yes" if works(name, f) else "–" for f in FORMULATIONS), *others))
    return report.table(("element", *FORMULATIONS, *LIBRARIES), rows)


def main() -> None:
    """Write the page."""
    head, mark, _ = PAGE.read_text(encoding="utf-8").partition(MARK)
    PAGE.write_text(f"{head}{mark}\n\n{table()}", encoding="utf-8")


if __name__ == "__main__":
    main()
