"""Every element in every formulation, run, and its counterparts in other libraries.

``python -m benchmarks.reports.elements`` writes the table of docs/elements-compared.md, and docs/elements/in-files.md:
every element as a file declares it.
"""

from __future__ import annotations

import math
from collections.abc import Callable
from functools import cache
from pathlib import Path

import numpy as np

import hqp
from benchmarks.reports import report
from hqp import Level, Stack, serial, shapes
from hqp import tasks as t
from hqp.declare.element import Element
from hqp.errors import DeclarationError
from hqp.programs.formulation import Formulation
from hqp.robots import Robot

PAGE = Path(__file__).parents[2] / "docs" / "elements-compared.md"
FILES = PAGE.with_name("elements") / "in-files.md"
MARK = "<!-- table: python -m benchmarks.reports.elements -->"
FORMULATIONS: dict[str, Callable[[], Formulation]] = {
    "velocity": hqp.Velocity,
    "acceleration": hqp.Acceleration,
    "torque": hqp.Torque,
}
LIBRARIES = ("pink 4.4", "mink 1.3", "placo 0.10", "tsid 1.10", "embodik 0.23", "OpenSoT")

HAND, HEAD, FEET = "r_palm", "head", ("l_sole", "r_sole")
FOOT = "l_sole"
EXAMPLES: dict[str, Callable[[], tuple[Element, ...]]] = {
    "Admittance": lambda: (t.Admittance(frame=HAND, stiffness=300.0, damping=80.0),),
    "AlignAxis": lambda: (t.AlignAxis(frame=HAND),),
    "Balance": lambda: (t.Balance(points=[(f, x, 0.0, 0.0) for f in FEET for x in (-0.05, 0.15)]),),
    "Ball": lambda: (t.Ball(frame=HAND, relative_to="l_palm"),),
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
    "FrameVelocityLimits": lambda: (t.FrameVelocityLimits(frame=HAND),),
    "FrictionCone": lambda: (t.FrictionCone(contact=FOOT, mu=0.8),),
    "Frozen": lambda: (t.Frozen(joints=["R_EB"]),),
    "Hinge": lambda: (t.Hinge(frame=HAND, relative_to="l_palm", axis="y"),),
    "HoldingTorque": lambda: (t.HoldingTorque(joints="R_SAA"),),
    "Impedance": lambda: (t.Impedance(frame=HAND, stiffness=(300.0, 300.0, 0.0), damping=60.0),),
    "JointCoupling": lambda: (t.JointCoupling({"R_EB": 1.0, "L_EB": -1.0}),),
    "JointLimits": lambda: (t.JointLimits(),),
    "JointLoad": lambda: (t.JointLoad(joints=["R_EB"], inertia=0.1),),
    "JointTorque": lambda: (t.JointTorque(),),
    "JointVelocity": lambda: (t.JointVelocity(),),
    "LoadShare": lambda: (t.LoadShare(contacts=FEET),),
    "LookAt": lambda: (t.LookAt(frame=HAND),),
    "LowAcceleration": lambda: (t.LowAcceleration(),),
    "Manipulability": lambda: (t.Manipulability(frame=HAND),),
    "Momentum": lambda: (t.Momentum(),),
    "NominalTorque": lambda: (t.NominalTorque(),),
    "OmniWheelContact": lambda: (t.OmniWheelContact(wheel="l_palm", radius=0.1, axle=(0.0, 1.0, 0.0)),),
    "Orientation": lambda: (t.Orientation(frame=HAND),),
    "Payload": lambda: (t.Payload(frame=HAND),),
    "PointContact": lambda: (t.PointContact(frame="l_palm"),),
    "Pose": lambda: (t.Pose(frame=HAND),),
    "Position": lambda: (t.Position(frame=HAND),),
    "Posture": lambda: (t.Posture(),),
    "PrescribedMotion": lambda: (t.PrescribedMotion(joints=["R_EB"]),),
    "SupportPolygon": lambda: (t.SupportPolygon(sole=(-0.05, 0.05, -0.03, 0.03)),),
    "TorqueLimits": lambda: (t.TorqueLimits(),),
    "TorqueSpeedLimits": lambda: (t.TorqueSpeedLimits(),),
    "UnilateralContact": lambda: (t.UnilateralContact(contact=FOOT),),
    "Weld": lambda: (t.Weld(frame=HAND, relative_to="l_palm"),),
    "WheelContact": lambda: (t.WheelContact(wheel="l_palm", radius=0.1, axle=(0.0, 1.0, 0.0)),),
    "Within": lambda: (t.Within(t.Position(frame=HAND), lower=-0.1, upper=0.1),),
}
"""An element of each class, on CBi standing on both feet."""

HELD = (
    "ExternalWrench",
    "Payload",
    "JointLoad",
    "NominalTorque",
    "Frozen",
    "PrescribedMotion",
    "JointLimits",
    "BallLimits",
    "TorqueLimits",
    "ForceLimits",
)
"""Elements that belong into ``subject_to``."""
EXACT = ("NominalTorque",)
"""Elements of controllers without a price."""
CONTACTS = (
    "EdgeContact",
    "FixedContact",
    "OmniWheelContact",
    "PointContact",
    "WheelContact",
    "Weld",
    "Ball",
    "Hinge",
    "JointCoupling",
)

ELSEWHERE: dict[str, tuple[str, str, str, str, str, str]] = {
    "Admittance": ("", "", "", "", "", "CartesianAdmittance"),
    "AlignAxis": ("", "AxisAlignTask", "AxisAlignTask", "", "", ""),
    "BaseVelocityLimits": ("FloatingBaseVelocityLimit", "FreeJointVelocityLimit", "", "", "set_base_*_bounds", ""),
    "CenterOfPressure": ("", "", "Contact6D", "Contact6d, TaskCopEquality", "ZmpAccelerationConstraint", "force::CoP"),
    "CollisionAvoidance": (
        "SelfCollisionBarrier", "CollisionAvoidanceLimit", "AvoidSelfCollisions*Constraint",
        "", "CollisionConstraint", "CollisionAvoidance",
    ),
    "Com": ("ComTask", "ComTask", "CoMTask", "TaskComEquality", "COMTask", "CoM"),
    "Cone": ("", "", "ConeConstraint", "", "", ""),
    "ContactForce": ("", "", "Contact (objective weights)", "ContactBase force task", "", "force::Wrench"),
    "Damping": (
        "DampingTask", "DampingTask, KineticEnergyRegularizationTask", "RegularizationTask",
        "", "", "MinimumVelocity",
    ),
    "Distance": ("", "", "DistanceTask", "", "", ""),
    "EdgeContact": ("", "", "LineContact", "", "", ""),
    "ExternalWrench": ("", "", "ExternalWrenchContact", "", "", ""),
    "FixedContact": (
        "FrameTask as constraint", "FrameTask as constraint", "Contact6D",
        "Contact6d", "TightFramePose", "Contact",
    ),
    "ForceLimits": ("", "", "", "", "", "force::WrenchLimits"),
    "FrameVelocityLimits": ("", "", "", "", "", "CartesianVelocity"),
    "FrictionCone": ("", "", "Contact", "Contact6d", "", "force::FrictionCone"),
    "Frozen": ("", "DofFreezingTask", "mask_dof", "", "excluded_joint_indices", ""),
    "Impedance": ("", "", "", "", "", ""),
    "JointCoupling": ("JointCouplingTask, LinearHolonomicTask", "EqualityConstraintTask", "GearTask", "", "", ""),
    "JointLimits": (
        "ConfigurationLimit, VelocityLimit, AccelerationLimit", "ConfigurationLimit, VelocityLimit", "enable_*_limits",
        "TaskJointBounds", "enable_*_limits", "JointLimits, VelocityLimits, AccelerationLimits",
    ),
    "JointTorque": ("", "", "DynamicsTorqueTask", "TaskActuationEquality", "", ""),
    "JointVelocity": ("JointVelocityTask", "", "", "", "", ""),
    "LookAt": ("", "LookAtTask", "", "", "", "Gaze"),
    "LowAcceleration": ("LowAccelerationTask", "", "", "", "", "MinimizeAcceleration"),
    "Manipulability": ("ManipulabilityTask", "", "ManipulabilityTask", "", "ManipulabilityTask", "Manipulability"),
    "Momentum": (
        "", "", "CentroidalMomentumTask",
        "TaskAMEquality", "CentroidalMomentumTask", "AngularMomentum, LinearMomentum",
    ),
    "OmniWheelContact": ("OmniwheelTask", "", "WheelTask", "", "", "OmniWheels4X"),
    "Orientation": (
        "FrameTask", "FrameTask", "OrientationTask",
        "TaskSE3Equality, masked", "FrameTask", "Cartesian, masked",
    ),
    "PointContact": ("", "", "PointContact", "ContactPoint", "TightPoint", ""),
    "Pose": ("FrameTask", "FrameTask", "FrameTask", "TaskSE3Equality", "FrameTask", "Cartesian"),
    "Position": ("FrameTask", "FrameTask", "PositionTask", "TaskSE3Equality, masked", "FrameTask", "Cartesian, masked"),
    "Posture": ("PostureTask", "PostureTask", "JointsTask", "TaskJointPosture", "PostureTask", "Postural"),
    "PrescribedMotion": ("", "", "", "", "", ""),
    "SupportPolygon": ("", "", "CoMPolygonConstraint", "", "ComSupportPolygon*", "ConvexHull"),
    "TorqueLimits": ("", "", "enable_torque_limits", "TaskActuationBounds", "EffortConstraintOptions", "TorqueLimits"),
    "TorqueSpeedLimits": ("", "", "enable_velocity_vs_torque_limits", "", "", ""),
    "UnilateralContact": ("", "", "Contact", "Contact6d", "", "force::WrenchLimits"),
    "Weld": (
        "", "EqualityConstraintTask", "RelativeFrameTask, hard",
        "ContactTwoFramePositions", "RelativePose", "Cartesian of two links",
    ),
    "WheelContact": ("RollingTask", "", "WheelTask", "", "", "PureRolling"),
    "Within": (
        "PositionBarrier, BodySphericalBarrier", "", "",
        "", "TaskAccelerationBounds", "CartesianPositionConstraint, TaskToConstraint",
    ),
}  # fmt: skip
"""Class or function of each library by element; OpenSoT's names are from its public headers."""


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
    """Return true if a stack with the element takes three usable ticks, false if an error names the element."""
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
        price = 0 if name in EXACT else None
        stack = Stack(*levels, subject_to=hard)
        controller = hqp.Controller(stack, FORMULATIONS[formulation](), deadline=math.inf, price=price)
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
    """Run every cell of hqp and write the table."""
    rows = []
    for name in sorted(t.__all__):
        others = ELSEWHERE.get(name, ("",) * len(LIBRARIES))
        rows.append((f"`{name}`", *("yes" if works(name, f) else "–" for f in FORMULATIONS), *others))
    return report.table(("element", *FORMULATIONS, *LIBRARIES), rows)


def in_files() -> str:
    """Every element as TOML, in ``subject_to`` or in a level as it stands in the table's stacks."""
    parts = []
    for name in sorted(t.__all__):
        element = EXAMPLES[name]()[-1]
        hard = name in (*HELD, *CONTACTS)
        text = serial.dumps(Stack(Level(t.Posture()), subject_to=[element]) if hard else Stack(Level(element)))
        kept = text[text.index("[[subject_to]]") :] if hard else text
        lines = "\n".join(map(_wrapped, kept.strip().splitlines()))
        parts.append(f"## {name}\n\n```toml\n{lines}\n```\n")
    return "\n".join(parts)


def _wrapped(line: str) -> str:
    """Wrap a long array of arrays, one to a line."""
    return line if len(line) <= 88 else line.replace("[[", "[\n  [").replace("], [", "],\n  [").replace("]]", "],\n]")


def main() -> None:
    """Write the pages."""
    report.into_page(FILES, MARK, in_files())
    report.into_page(PAGE, MARK, table())


if __name__ == "__main__":
    main()
