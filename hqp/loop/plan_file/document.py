"""What a session from a file is made of: robot, guards, elements, rows and solver, as one tree."""

from __future__ import annotations

from typing import TYPE_CHECKING, Any

from hqp.arrays import Vec
from hqp.declare.element import Element, Inequality, has
from hqp.declare.plans import Constant
from hqp.declare.robot import Robot
from hqp.errors import DeclarationError
from hqp.loop import phase_laws
from hqp.loop.compiled import Compiled, Compiler
from hqp.loop.contact_watch import assumed
from hqp.loop.outgoing import largest_change
from hqp.loop.presence import Presence
from hqp.problem import Status
from hqp.programs.assembly import LARGEST
from hqp.solvers.second_opinion import STUCK
from hqp.tolerances import VIOLATION_TOLERANCE

if TYPE_CHECKING:
    from hqp.loop.session import Session
    from hqp.sequence import Sequence


def document(session: Session, sequence: Sequence | None) -> tuple[dict[str, Any], list[Vec]]:
    """The tree of a session whose stack is compiled anew, and the arrays whose numbers do not matter.

    Raises DeclarationError for an element or a solver that is not native, by its name, or a sequence that does not
    fit.
    """
    if sequence is not None:
        sequence.require(session)
    controller, robot = session.controller, session.robot.copy()
    deadline = session.line.budget.deadline
    compiled = Compiler(controller, robot, session.dt, deadline).compile(session.stack)
    program = compiled.program
    _require_native(compiled, robot)
    state = robot.state(robot.home)
    program.begin_direct(state, {element.name: element.hold(state) for element in compiled.stack})
    motion = program.parts()
    moving = {"joints": robot.tree_joints, "frames": robot.placed_frames, "twists": robot.joint_twists}
    tree = {
        "robot": _robot(robot),
        "guards": {
            "dt": session.dt,
            "deadline": deadline,
            "largest": LARGEST,
            "violation": VIOLATION_TOLERANCE,
            "gradual": largest_change(program.kind, session.dt),
            "statuses": [STUCK if status is Status.NOT_CERTIFIED else status.value for status in Status],
            "state": session.line.check.parts,
            "rates": None if session.line.limiter is None else list(session.line.limiter.inverse),
            "braking": controller.braking,
        },
        **_phases(compiled, sequence),
        "elements": [_element(e, compiled, robot) for e in compiled.stack],
        "motion": {**motion, **moving, "bodies": robot.bodies},
        "solver": compiled.workspace.parts(program.problem),  # type: ignore[attr-defined]
    }
    placements = [body[-1] for body in robot.bodies] + [frame[-1] for frame in robot.placed_frames]
    placements += [joint[-1][-1] for joint in robot.tree_joints or ()]
    scratch = [robot.joint_twists, *(array for placement in placements for array in placement)]
    return tree, scratch


def _phases(compiled: Compiled, sequence: Sequence | None) -> dict[str, Any]:
    """Who is out in which phase, and the laws there."""
    found, laws = Presence(compiled.stack, compiled.program).parts, {} if sequence is None else sequence.laws()
    usual, known = found["phases"][0]["out"], [phase["name"] for phase in found["phases"]]
    found["phases"] += [{"name": name, "out": usual} for name in laws if name not in known]
    names = [phase["name"] for phase in found["phases"]]
    return {**found, "laws": phase_laws.parts(compiled.program.assembly, laws, names)}


def _robot(robot: Robot) -> dict[str, Any]:
    return {
        "name": robot.name,
        "nq": robot.nq,
        "nv": robot.nv,
        "floating": robot.floating,
        "joint_names": robot.joint_names,
        "coordinates": [robot.joint_name(i) for i in range(robot.nv)],
        "places": [_owner(robot, 0, i) for i in range(robot.nq)],
        "speeds": [_owner(robot, 1, i) for i in range(robot.nv)],
        "actuated": robot.actuated.tolist(),
        "lower": robot.lower.tolist(),
        "upper": robot.upper.tolist(),
        "effort_limit": robot.effort_limit.tolist(),
        "home": robot.home.tolist(),
    }


def _owner(robot: Robot, what: int, place: int) -> str:
    """The joint that a number of q (what: 0) or of v (1) belongs to."""
    first = [((joint[1], joint[2])[what], joint[2]) for joint in robot.tree_joints or ()]
    column = max((pair for pair in first if pair[0] <= place), default=(0, 0))[1]
    return robot.joint_name(column).removesuffix("[0]")


def _require_native(compiled: Compiled, robot: Robot) -> None:
    """Raise DeclarationError for what a file cannot hold."""
    if (found := compiled.program.in_python()) is not None:
        raise _refused(*found)
    if robot.tree_joints is None:
        raise _refused(robot.name, "a joint has a type that native kinematics do not support")
    if not hasattr(compiled.workspace, "parts"):
        raise _refused("solver", "only 'lexicographic' has native code")


def _refused(name: str, why: str) -> DeclarationError:
    return DeclarationError(name, f"cannot be exported: {why}", allowed="elements and solvers with native code")


def _element(element: Element, compiled: Compiled, robot: Robot) -> dict[str, Any]:
    """Where the rows of an element are, and what to do where they are not usable."""
    program, name = compiled.program, element.name
    value = element.hold(robot.state(robot.home)).value
    held = None if value is None else [float(x) for x in value.ravel()]
    place, member = program.places.get(name), program.assembly.members.get(name)
    constant = None
    plan = getattr(element, "plan", None)
    if element.quantity == "effort" and plan is not None and isinstance(found := plan(robot), Constant):
        constant = [found.lower.tolist(), found.upper.tolist()]
    return {
        "name": name,
        "hard": name in compiled.hard,
        "contact": assumed(element),
        "equality": element.equality,
        "own_bounds": isinstance(element, Inequality) and has(element, "step_bounds"),
        "level": -1 if place is None else place.level,
        "place": [0, 0] if place is None else [place.part.start, place.part.stop],
        "rows": [0, 0] if member is None else [member.part.start, member.part.stop],
        "row_names": [] if place is None else list(element.row_names(robot)),
        "units": compiled.watched.units(element) if element in compiled.watched.elements else [],
        "constant": constant,
        "hold": held,
    }
