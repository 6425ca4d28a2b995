"""The parts of a session: robot, guards, elements, rows and solver, as one tree."""

from __future__ import annotations

from collections.abc import Mapping
from typing import TYPE_CHECKING, Any, Protocol

import numpy as np

from hqp.arrays import Vec
from hqp.declare.element import Constraint, Element, Inequality, has
from hqp.declare.fingerprint import fingerprint
from hqp.declare.plans import Constant
from hqp.declare.reference import Reference
from hqp.declare.robot import Robot, State
from hqp.declare.safety import Braking, StateBounds
from hqp.declare.stack import Stack
from hqp.errors import DeclarationError
from hqp.loop.checks import twin_of
from hqp.loop.guards import state_bounds
from hqp.loop.presence import phase_law_parts
from hqp.loop.way import way_parts
from hqp.problem import Status
from hqp.programs.assembly import LARGEST
from hqp.sequence import Stepped
from hqp.solvers.lexicographic import levels
from hqp.solvers.second_opinion import STUCK
from hqp.solvers.stages import law_parts
from hqp.tolerances import VIOLATION_TOLERANCE

if TYPE_CHECKING:
    from hqp.declare.law import Law
    from hqp.loop.compiled import Compiled, Compiler
    from hqp.loop.way import Waypoint
    from hqp.sequence import Sequence


SENTENCES = [status.value for status in Status]
"""Text of each status, for solvers in Python."""


def guards(
    robot: Robot, bounds: StateBounds, braking: Braking, dt: float, deadline: float, max_age: float | None
) -> dict[str, Any]:
    """Limits on states and commands, shared by all stacks of a session."""
    return {
        "dt": dt,
        "deadline": deadline,
        "largest": LARGEST,
        "violation": VIOLATION_TOLERANCE,
        "statuses": [STUCK if status is Status.NOT_CERTIFIED else status.value for status in Status],
        "state": state_bounds(robot, bounds, max_age),
        "braking": braking,
    }


def live_tree(compiled: Compiled, home: State) -> dict[str, Any]:
    """The tree of a session over the arrays of a program, which it shares.  home: state of a twin."""
    program = compiled.program
    return {
        **_tree(compiled, home, program.parts()),
        **_phases(compiled, {}),
        "guards": compiled.guards if compiled.native_solver else {**compiled.guards, "statuses": SENTENCES},
        "solver": {
            **levels(program.problem),
            "stages": law_parts(program.problem) if any(program.problem.priced) else None,
        },
        "live": {
            "kinematics": compiled.moving,
            "assembly": program.assembly.native_rows,
            "torque": None if program.kind != "torque" else program.dynamics.native,  # type: ignore[attr-defined]
            "solver": compiled.workspace.native if compiled.native_solver else None,  # type: ignore[attr-defined]
        },
    }


def session_tree(compiled: Compiled, callbacks: object) -> dict[str, Any]:
    """Parts of a native session over the arrays of a program, with all elements in."""
    program = compiled.program
    program.go_without(frozenset())
    with twin_of(compiled.robot) as twin:
        home = twin.state(twin.home)
        if compiled.tree is None:
            compiled.tree = live_tree(compiled, home)
        program.begin_direct(home, {element.name: Reference(element.name) for element in compiled.stack})
    return {**compiled.tree, "callbacks": callbacks}


class Exported(Stepped[Any], Protocol):
    """Interface of a session for a file."""

    robot: Robot
    deadline: float

    @property
    def declared(self) -> Stack: ...
    def compiler(self, robot: Robot) -> Compiler: ...


class Writer:
    """Compiles the stacks of a session for a file, each on a robot of its own."""

    def __init__(self, session: Exported, sequence: Sequence | None) -> None:
        self._session, self._laws = session, {} if sequence is None else sequence.laws()

    def another(self, stack: Stack) -> tuple[Compiled, dict[str, Any], list[Vec]]:
        """A stack, its tree, and the arrays whose numbers do not matter.

        Raises DeclarationError for an element or a solver that is not native, by its name.
        """
        robot = self._session.robot.copy()
        compiled = self._session.compiler(robot).compile(stack)
        program = compiled.program
        _require_native(compiled, robot)
        state = robot.state(robot.home)
        program.begin_direct(state, {element.name: element.hold(state) for element in compiled.stack})
        parts = program.parts()
        none = np.zeros(0)
        parts["slots"] = [*parts["slots"]] + [
            {"name": name, "target": target, "shape": target.shape, "normal": None, "rate": none, "feedforward": none,
             "plain": 0, "operation": None}
            for name, target in program.targets_in_file.items()
        ]  # fmt: skip
        moving = {"joints": robot.tree_joints, "frames": robot.placed_frames, "twists": robot.joint_twists}
        laws = {
            phase: {name: law for name, law in of.items() if name in compiled.stack} for phase, of in self._laws.items()
        }
        tree = {
            **_tree(compiled, state, {**parts, **moving, "bodies": robot.bodies}),
            **_phases(compiled, laws),
            "guards": {**compiled.guards, "deadline": self._session.deadline},
            "solver": compiled.workspace.parts(program.problem),  # type: ignore[attr-defined]
        }
        placements = [body[-1] for body in robot.bodies] + [frame[-1] for frame in robot.placed_frames]
        placements += [joint[-1][-1] for joint in robot.tree_joints or ()]
        scratch = [robot.joint_twists, *(array for placement in placements for array in placement)]
        return compiled, tree, scratch

    def way(self, before: Compiled, after: Stack) -> list[Waypoint]:
        """The stacks on the way of a transition."""
        return self._session.compiler(before.robot).way(before, after)

    def declared(self, compiled: Compiled) -> Stack:
        """The stack at work as it was declared, if it is that of the controller."""
        declared = self._session.declared
        same = self._session.compiler(compiled.robot).completed(declared) == compiled.stack
        return declared if same else compiled.stack


def document(
    session: Exported, sequence: Sequence | None, stacks: Mapping[str, Stack] | None = None
) -> tuple[dict[str, Any], list[Vec]]:
    """The tree of a session whose stacks are compiled anew, and the arrays whose numbers do not matter.

    Raises DeclarationError for an element or a solver that is not native, by its name, or a sequence that does not
    fit.
    """
    if sequence is not None:
        sequence.require(session)
    writer = Writer(session, sequence)
    compiled, tree, scratch = writer.another(session.stack)
    if stacks:
        others, more = several(writer, compiled, stacks)
        return {**tree, **others}, scratch + more
    return tree, scratch


def _tree(compiled: Compiled, home: State, motion: dict[str, Any]) -> dict[str, Any]:
    return {
        "robot": _robot(compiled.robot),
        "elements": [_element(e, compiled, home) for e in compiled.stack],
        "motion": motion,
    }


def _phases(compiled: Compiled, laws: Mapping[str, Mapping[str, Law]]) -> dict[str, Any]:
    """Absent elements and laws of each phase."""
    found = compiled.presence.parts
    usual, known = found["phases"][0]["out"], [phase["name"] for phase in found["phases"]]
    found["phases"] += [{"name": name, "out": usual} for name in laws if name not in known]
    names = [phase["name"] for phase in found["phases"]]
    return {**found, "laws": phase_law_parts(compiled.program.assembly, laws, names)}


def _robot(robot: Robot) -> dict[str, Any]:
    return {
        "name": robot.name,
        "fingerprint": fingerprint(robot),
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


def _owner(robot: Robot, kind: int, place: int) -> str:
    """Name of the joint of a number of q (kind 0) or of v (kind 1)."""
    first = [((joint[1], joint[2])[kind], joint[2]) for joint in robot.tree_joints or ()]
    column = max((pair for pair in first if pair[0] <= place), default=(0, 0))[1]
    return robot.joint_name(column).removesuffix("[0]")


def _require_native(compiled: Compiled, robot: Robot) -> None:
    """Raise DeclarationError for parts without native code."""
    if (found := compiled.program.in_python()) is not None:
        raise _refused(*found)
    if robot.tree_joints is None:
        raise _refused(robot.name, "a joint has a type that native kinematics do not support")
    if not hasattr(compiled.workspace, "parts"):
        raise _refused("solver", "only 'lexicographic' has native code")


def _refused(name: str, why: str) -> DeclarationError:
    return DeclarationError(name, f"cannot be exported: {why}", allowed="elements and solvers with native code")


def _element(element: Element, compiled: Compiled, home: State) -> dict[str, Any]:
    """Places of an element's rows, and their treatment if unusable."""
    program, name, robot = compiled.program, element.name, compiled.robot
    held = None
    targets = {**program.live_targets, **program.targets_in_file}
    if name in targets and (value := element.hold(home).value) is not None:
        held = [float(x) for x in value.ravel()]
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
        "units": compiled.units.get(name, []),
        "constant": constant,
        "hold": held,
    }


def assumed(element: Element) -> bool:
    """True if every tick assumes the contact."""
    return isinstance(element, Constraint) and element.equality and element.quantity == "motion"


def several(writer: Writer, first: Compiled, stacks: Mapping[str, Stack]) -> tuple[dict[str, Any], list[Vec]]:
    """The trees of these stacks and of those on the way between them, beside the first one, and their scratch arrays.

    Raises DeclarationError for a name that is not a text, and the errors of ``Session.change``.
    """
    if wrong := [name for name in stacks if not isinstance(name, str) or not name]:
        raise DeclarationError("export", "bad name of a stack", value=wrong[0], allowed='texts but ""')
    named: dict[str, Stack] = {"": writer.declared(first), **stacks}
    known: list[tuple[Stack, Compiled]] = [(named[""], first)]
    trees: list[dict[str, Any]] = []
    scratch: list[Vec] = []

    def place(stack: Stack, name: str = "") -> int:
        for k, (each, _) in enumerate(known):
            if each == stack and not name:
                return k
        compiled, tree, more = writer.another(stack)
        known.append((stack, compiled))
        trees.append({**tree, "name": name})
        scratch.extend(more)
        return len(known) - 1

    places = [0, *(place(stack, name) for name, stack in stacks.items())]
    ways = []
    for i, start in enumerate(places):
        for j, end in enumerate(places):
            before, after = known[start][1], known[end]
            points = writer.way(before, after[0])
            through = [start, *(place(point.stack) for point in points[1:-1]), end]
            compiled = [known[k][1] for k in through]
            ways.append({"from": i, "to": j, "through": through, **way_parts(points, compiled, before.robot)})
    return {"stacks": trees, "ways": ways}, scratch
