"""Levels of a hierarchy: physics first, one quantity per level, contacts before tasks."""

from __future__ import annotations

import itertools
import math
from dataclasses import dataclass

import numpy as np

import hqp
import hqp.robots
from hqp import Level, P, Stack
from hqp.arrays import Mat
from hqp.declare.element import Element, Inequality
from hqp.declare.robot import Robot, State
from hqp.programs.layout import lay_out
from hqp.tasks import (
    CenterOfPressure,
    Com,
    ContactForce,
    FixedContact,
    FrictionCone,
    JointLimits,
    JointTorque,
    Position,
    Posture,
    TorqueLimits,
    UnilateralContact,
)

ROBOT = hqp.robots.load("cbi")
FEET = FixedContact(frame="l_sole"), FixedContact(frame="r_sole")


@dataclass(frozen=True, kw_only=True)
class _Ceiling(Inequality):
    """User inequality with one dense row."""

    def rows(self, robot: Robot) -> int:
        return 1

    def jacobian(self, state: State) -> Mat:
        return state.com_jacobian()[2]

    def bounds(self, state: State) -> tuple[float, float]:
        return -np.inf, 2.0 - state.com()[2]


MEMBERS: tuple[Element, ...] = (
    Position(frame="r_palm"),
    _Ceiling(name="ceiling"),
    JointLimits(),
    CenterOfPressure(contact="l_sole", rectangle=(-0.1, 0.1, -0.05, 0.05)),
    *FEET,
    JointTorque(joints="l_arm"),
    FrictionCone(contact="l_sole", mu=0.6),
    UnilateralContact(contact="r_sole"),
    TorqueLimits(),
    ContactForce(contact="r_sole"),
)


def names(stack: Stack, **options: bool) -> list[set[str]]:
    held = FEET if options.get("torque") else ()
    return [{e.name for e in group.elements} for group in lay_out(stack, ROBOT, held=held, **options)]


def test_order_of_subject_to_at_torque_level() -> None:
    """Physics comes first in any written order; forces and motions never share a level."""
    expected = [
        {"torque_limits"},
        {"l_sole_cop", "l_sole_friction", "r_sole_unilateral"},
        {"joint_limits"},
        {"ceiling"},
        {"r_sole_force"},
        {"joint_torque"},
        {"r_palm"},
        {"posture"},
    ]
    for members in (MEMBERS, MEMBERS[::-1], MEMBERS[5:] + MEMBERS[:5]):
        stack = Stack(Level(Posture(law=None)), subject_to=members)
        assert names(stack, torque=True) == expected
        groups = lay_out(stack, ROBOT, held=FEET, torque=True)
        assert [g.constraint for g in groups] == [True] * 7 + [False]
        assert [g.tasks for g in groups] == [False] * 4 + [True] * 4
        assert [g.selection for g in groups] == [True, False, False, False, False, True, False, False]
        assert all(len({e.quantity for e in g.elements}) == 1 for g in groups)


def test_order_of_subject_to_at_velocity_level() -> None:
    members = [e for e in MEMBERS if e.quantity == "motion"]
    for order in itertools.islice(itertools.permutations(members), 0, None, 7):
        stack = Stack(Level(Posture(law=P(1.0))), subject_to=order)
        assert names(stack) == [{"joint_limits"}, {"l_sole", "r_sole"}, {"ceiling"}, {"r_palm"}, {"posture"}]


def test_contacts_of_a_level_first() -> None:
    com = Com(axes="xy")
    stack = Stack(Level(*FEET, com, name="balance"), Level(*FEET[:0], Posture()), subject_to=[JointLimits()])
    assert names(stack) == [{"joint_limits"}, {"l_sole", "r_sole", "com"}, {"posture"}]
    groups = lay_out(stack, ROBOT, contacts_first=True)
    assert [g.name for g in groups] == ["subject_to", "balance: contacts", "balance", "posture"]
    assert [g.tasks for g in groups] == [False, False, True, True]
    only = Stack(Level(*FEET), Level(com))
    assert [g.name for g in lay_out(only, ROBOT, contacts_first=True)] == ["l_sole + r_sole", "com"]


def test_physics_does_not_give_way_to_a_joint_limit() -> None:
    """Knees beyond their speed limit need a pull on the ground: feet still only push, and the limit gets the note."""
    robot = hqp.robots.load("talos")
    feet = [FixedContact(frame=frame) for frame in robot.landmarks["soles"]]
    forces: list[Element] = [UnilateralContact(contact=foot.name, minimum=20.0) for foot in feet]
    forces += [FrictionCone(contact=foot.name, mu=0.3) for foot in feet]
    stack = Stack(
        Level(Com()), Level(Posture()), subject_to=[JointLimits(acceleration=None, braking=None), *feet, *forces]
    )
    session = hqp.Controller(stack, hqp.Torque(), deadline=math.inf).session(robot, dt=0.002)
    state = robot.state()
    J = np.vstack([state.jacobian(foot.frame) for foot in feet] + [np.eye(robot.nv)[2:3]])
    v = np.linalg.pinv(J) @ np.append(np.zeros(12), 4.0)  # upwards, knees faster than they may: only a pull could help
    tick = session.step(robot.state(robot.home, v))
    assert tick.solution is not None
    by_name = {name: tick.solution.residuals[p.level][p.part] for name, p in session.program.places.items()}
    for force in forces:  # torques that no level determines exceed them by 1e-5 of the torques' length at most
        assert abs(by_name[force.name]).max() < 1e-5
    assert abs(by_name["joint_limits"]).max() > 1.0
    assert tick.status is hqp.Status.CONSTRAINTS_VIOLATED


def test_levels_of_one_name_have_numbers() -> None:
    """Rows of ``subject_to`` form several levels; contacts of a level take its name."""
    stack = Stack(Level(FEET[0], Position(frame="r_palm"), name="stand"), Level(Posture()), subject_to=MEMBERS[1:3])
    program = hqp.Velocity().compile(stack, ROBOT, 0.002, hqp.Price(0.0))
    priced = hqp.Velocity().compile(stack, ROBOT, 0.002)
    assert program.level_names == ("subject_to 1", "subject_to 2", "stand", "posture")
    assert priced.level_names == ("subject_to 1", "subject_to 2", "stand: contacts", "stand", "posture")
