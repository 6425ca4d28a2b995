"""Data of a session for the viewer's process: plain data, so that no class of the user has to be found there."""

from __future__ import annotations

import pickle
from dataclasses import dataclass, field
from math import prod
from typing import Any

import numpy as np

from hqp.explanation.account import unit_of
from hqp.loop.line import Line
from hqp.programs.formulation import Formulation


@dataclass(frozen=True)
class Member:
    """One element: place of its rows, and its titles on the page."""

    name: str
    kind: str
    level: int
    part: slice
    declared: str
    weight: float
    equality: bool
    contact: bool
    frame: str
    rows: tuple[str, ...]
    unit: str = ""


@dataclass(frozen=True)
class Target:
    """A task whose reference can be moved in the page.

    kind: of hqp/viewer/places.py.  shape: shape of its value.  axes: in which a point is moved.  angles: components of
    roll, pitch and yaw in the value.  axis: axis of the frame to be pointed.
    """

    name: str
    kind: str
    shape: tuple[int, ...]
    axes: str = "xyz"
    frame: str = ""
    relative_to: str | None = None
    heading: bool = False
    offset: tuple[float, float, float] = (0.0, 0.0, 0.0)
    subtree: str | None = None
    angles: tuple[int, ...] = ()
    axis: tuple[float, float, float] = (1.0, 0.0, 0.0)

    @property
    def size(self) -> int:
        """Numbers of its value."""
        return prod(self.shape)


@dataclass(frozen=True)
class StackDescription:
    """A compiled stack: sizes of a tick's vectors, levels, members and targets.

    sizes: sizes of q, v, command, x and of each level's residual.
    """

    version: int
    text: str
    formulation: str
    sizes: tuple[int, ...]
    constraints: int
    levels: tuple[str, ...]
    members: tuple[Member, ...]
    targets: tuple[Target, ...]

    def of_level(self, level: int) -> tuple[Member, ...]:
        """Members with rows in that level of the hierarchy."""
        return tuple(m for m in self.members if m.level == level)


@dataclass(frozen=True)
class RobotDescription:
    """A robot for drawing: its model, names and limits, and the shapes of its bodies."""

    name: str
    model: bytes
    joint_names: tuple[str, ...]
    actuated: tuple[int, ...]
    limits: tuple[Any, Any, Any]
    home: Any
    shapes: tuple[Any, ...] = field(repr=False, default=())


def describe_robot(robot: Any) -> RobotDescription:
    """A robot as the viewer draws it."""
    from hqp.robots.shapes import shapes

    return RobotDescription(
        robot.name,
        pickle.dumps(robot.model),
        tuple(robot.joint_names),
        tuple(int(c) for c in robot.actuated),
        (np.array(robot.lower), np.array(robot.upper), np.array(robot.velocity_limit)),
        np.array(robot.home),
        shapes(robot),
    )


def describe_stack(line: Line, formulation: Formulation, version: int, room: int | None = None) -> StackDescription:
    """A stack at work as the viewer shows it, with at most ``room`` targets."""
    robot, program, problem = line.robot, line.program, line.program.problem
    members = tuple(
        Member(
            name,
            type(place.element).__name__,
            place.level,
            place.part,
            place.declared,
            float(place.element.weight),
            bool(place.element.equality),
            bool(place.element.is_contact),
            frame_of(place.element),
            _row_names(robot, place.element),
            unit_of(place.element, program.kind),
        )
        for name, place in program.places.items()
    )
    # contacts that torque control turns into reactions have no rows in the problem
    missing = [e for e in line.stack if e.name not in program.places]
    members += tuple(
        Member(e.name, type(e).__name__, -1, slice(0, 0), "subject_to", 1.0, True, bool(e.is_contact), frame_of(e), ())
        for e in missing
    )
    names = dict.fromkeys(range(len(problem.levels)), "")
    for member in members:
        names[member.level] = member.declared
    sizes = (robot.nq, robot.nv, len(robot.joint_names), problem.n, *(rows.m for rows in problem.levels))
    return StackDescription(
        version,
        str(line.stack),
        type(formulation).__name__,
        sizes,
        problem.constraints,
        tuple(names[k] for k in range(len(problem.levels))),
        members,
        tuple(t for t in map(_target, line.stack) if t is not None)[:room],
    )


def frame_of(element: Any) -> str:
    """Frame of an element, an empty string without one."""
    frame = getattr(element, "frame", "")
    return frame if isinstance(frame, str) else ""


def _row_names(robot: Any, element: Any) -> tuple[str, ...]:
    named = tuple(element.row_names(robot))
    if named or element.equality or (picks := element.selection(robot)) is None:
        return named
    if element.quantity == "effort":
        return tuple(robot.joint_names[c] for c in picks)
    return tuple(robot.joint_name(int(c)) for c in picks)


def _target(element: Any) -> Target | None:
    """The target of a task that has one in the scene."""
    from hqp import tasks
    from hqp.tasks.orientation import ANGLES

    name, frame, relative = element.name, frame_of(element), getattr(element, "relative_to", None)
    match element:
        case tasks.Position(axes=axes, heading=heading, offset=offset):
            return Target(name, "point", (len(axes),), axes, frame, relative, heading, offset)
        case tasks.Com(axes=axes, heading=heading, subtree=subtree):
            return Target(name, "com", (len(axes),), axes, frame, relative, heading, subtree=subtree)
        case tasks.Pose():
            return Target(name, "pose", (4, 4), "xyz", frame, relative)
        case tasks.Orientation(axes=None):
            return Target(name, "rotation", (3, 3), "xyz", frame, relative)
        case tasks.Orientation(axes=axes):
            angles = tuple(ANGLES.index(angle) for angle in ([axes] if isinstance(axes, str) else axes or ()))
            return Target(name, "angles", (len(angles),), "xyz", frame, relative, angles=angles)
        case tasks.LookAt(axis=axis) | tasks.AlignAxis(axis=axis):
            kind = "gaze" if isinstance(element, tasks.LookAt) else "direction"
            return Target(name, kind, (3,), frame=frame, axis=axis)
        case _:
            return None
