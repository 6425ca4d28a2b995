"""Checks of a stack on a robot before the loop: soundness, support of the base, conflicting constraints."""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from contextlib import contextmanager
from threading import Lock
from typing import Any
from weakref import WeakKeyDictionary, WeakSet

import numpy as np

from hqp.arrays import Index, Mask, Mat, Vec, rank
from hqp.declare.price import Price
from hqp.declare.robot import Robot, State
from hqp.declare.stack import Stack
from hqp.errors import DynamicsFailed, HqpError, ModelError
from hqp.programs.assembly import OWN
from hqp.programs.formulation import Formulation, Program
from hqp.tasks import Ball, Hinge, Weld


def turning(robot: Robot) -> Mask:
    """Mask ``(nv,)`` of the coordinates that turn; the others slide."""
    with twin_of(robot) as twin:
        twin.state(twin.home).kinematics()
        found: Mask = (twin.joint_twists[3:] != 0.0).any(axis=0)
    return found


def units_of(program: Program, robot: Robot) -> dict[str, list[str]]:
    """Unit of each row's joint, by the name of elements with rows that limit joints."""
    found: dict[str, list[str]] = {}
    turns = turning(robot)
    for name, place in program.places.items():
        element = place.element
        picked = None if element.equality else element.selection(robot)
        if picked is not None and len(element.row_names(robot)) == place.part.stop - place.part.start:
            found[name] = ["rad" if turn else "m" for turn in turns[picked].tolist()]
    return found


POSES = 3
"""Poses of the rehearsal: home, and some around it, for an element may be singular at one."""

_SOUND: WeakSet[Robot] = WeakSet()
"""Robots with checked numbers."""

_TWINS: WeakKeyDictionary[Robot, Robot] = WeakKeyDictionary()
"""Copies of robots for the rehearsal of stacks: elements compute data of a robot once for all of them."""

_TURN = Lock()
"""Lock on the use of twins."""


def require_sound(robot: Robot) -> None:
    """Raise ModelError, naming the joint, for limits, masses or placements that are no numbers, or negative masses."""
    if robot in _SOUND:
        return
    for what, values in (
        ("lower limit", robot.lower),
        ("upper limit", robot.upper),
        ("velocity limit", robot.velocity_limit),
        ("effort limit", robot.effort_limit),
    ):
        wrong = np.isnan(values)
        if wrong.any():
            raise ModelError(f"{robot.name}, joint {robot.joint_name(int(wrong.argmax()))}: its {what} is NaN")
    if not np.isfinite(robot.home).all():
        raise ModelError(f"{robot.name}: the home configuration is not finite, given {robot.home}")
    twin = robot.copy()
    twin.state(twin.home).kinematics()
    for _, first, count, mass, centre, (position, rotation) in twin.bodies:
        if not count:
            continue
        name = f"{robot.name}, joint {robot.joint_name(first)}"
        if not 0.0 <= mass < np.inf or not np.isfinite(centre).all():
            raise ModelError(
                f"{name}: its body has mass {mass:g} kg and centre of mass {centre} m; allowed: finite, mass 0 or above"
            )
        if not (np.isfinite(position).all() and np.isfinite(rotation).all()):
            raise ModelError(f"{name}: its placement at home is not finite")
    _SOUND.add(robot)


def rehearse(formulation: Formulation, stack: Stack, robot: Robot, dt: float) -> None:
    """Fill the rows of a stack at home and around it on a copy of the robot.

    Raises ModelError where some of the library's own elements have no usable rows at any of these poses (the centre of
    mass of links without mass), or the dynamics fail at all of them.
    """
    with twin_of(robot) as twin:
        _rehearse(formulation, stack, twin, dt)


@contextmanager
def twin_of(robot: Robot) -> Iterator[Robot]:
    """A copy of the robot to move, for one thread at a time; another one once the robot stands elsewhere at home."""
    with _TURN:
        twin = _TWINS.get(robot)
        if twin is None or not np.array_equal(twin.home, robot.home):
            twin = _TWINS[robot] = robot.copy()
        yield twin


def _rehearse(formulation: Formulation, stack: Stack, twin: Robot, dt: float) -> None:
    fault = ""
    foreign = [element.name for element in stack if not type(element).__module__.startswith(OWN)]
    try:
        stack = stack.without(*foreign) if foreign else stack
        program = formulation.compile(stack, twin, dt, Price(0.0))
    except HqpError:  # nothing is left without them
        return
    for k in range(POSES):
        q = twin.home
        if k:  # numpy.random is imported where home will not do
            q = twin.integrate(q, np.random.default_rng(k).uniform(-0.3, 0.3, twin.nv), 1.0)
        state = twin.state(q)
        try:
            program.prepare(state)
            program.fill(state, {element.name: element.hold(state) for element in stack}, ())
        except (DynamicsFailed, np.linalg.LinAlgError) as error:
            fault = str(error)
            continue
        faults = [f"{name}: {program.reason(name)}" for name in program.unusable()]
        if not faults:
            return
        fault = "; ".join(faults)
    raise ModelError(f"{twin.name} cannot run this stack: {fault}, at home and near it; check the masses of its model")


AWAY = 0.3
"""Displacement of the joints from home for the check of rows: at home itself a joint may have no effect [m, rad]."""

BASE_STEP = 1e-3
"""Displacement of the base to find the errors that depend on it [m, rad]."""

ROUNDING = 1e-9
"""Entries of a Jacobian below this, relative to its largest, are rounding."""


def adrift(stack: Stack, robot: Robot) -> str:
    """Return a warning if tasks pull a floating base that nothing holds, else ``""``.

    A contact holds it, or an equality of ``subject_to`` with the base's motion in its rows, or a task on the base
    itself: its error changes with the base, and no joint moves it.
    """
    if not robot.floating or any(element.is_contact for element in stack):
        return ""
    here, there = robot.copy(), robot.copy()
    q = here.integrate(here.home, np.random.default_rng(0).uniform(-AWAY, AWAY, robot.nv), 1.0)
    here.state(q)
    there.state(there.integrate(q, np.where(np.arange(robot.nv) < 6, BASE_STEP, 0.0), 1.0))
    pulled = []
    for element in stack:
        if not element.equality or element.quantity != "motion":
            continue
        try:
            base, joints, noticed = _entries(element, here, there)
        except Exception:  # a user's faulty element: the tick reports it
            return ""
        if (base and element in stack.subject_to) or (noticed and not joints):
            return ""
        if noticed:
            pulled.append(element.name)
    if not pulled:
        return ""
    name = robot.name or "the robot"
    return (
        f"no contact and no task holds the floating base of {name}: {_listed(pulled)} will move it through the air. "
        "Declare contacts in subject_to or a task on the base, or load the robot with a fixed base "
        "(floating=False, --fixed)"
    )


def _entries(element: Any, here: Robot, there: Robot) -> tuple[bool, bool, bool]:
    """Return true if the base is in the rows, if a joint is, and if the error changes with the base."""
    now, then = here.current, there.current
    hold = element.hold(now).value
    J = np.abs(np.atleast_2d(element.jacobian(now, hold) if element.steered else element.jacobian(now)))
    largest = float(J.max(initial=0.0))
    entered = ROUNDING * largest < J
    base = bool(entered[:, :6].any())
    change = np.abs(np.asarray(element.error(then, hold)) - np.asarray(element.error(now, hold))) if base else 0.0
    return base, bool(entered[:, 6:].any()), bool(np.any(change > ROUNDING))


def _listed(names: list[str], most: int = 3) -> str:
    return ", ".join(names[:most]) + (f" and {len(names) - most} more" if len(names) > most else "")


STEP = 0.05
"""Displacement of the largest coordinate from home, along the free directions there [m, rad]."""

STEPS = 12
"""Iterations of Newton's method; near a double root each halves the remaining distance."""

LOST = 1e-4
"""Threshold of a zero singular value, relative to the largest."""

PART = 0.1
"""Share of the dependent combinations of rows from which on an element is named."""

STILL = 1e-6
"""Share of a unit motion of all joints: joints of a loop that move less are locked."""


def overconstrained(stack: Stack, robot: Robot) -> str:
    """A warning if rows of ``subject_to`` are dependent at all poses near home that meet them, or lock a loop; else "".

    At nearby poses that do not meet them they are independent.  So they leave a direction free that violates them to
    second order, as two flat feet on legs of five joints do: the robot cannot move that way, and the sign of the error
    of a contact decides which way commands go.  A closure locks a loop if its joints have no motion in the null space
    of all rows.
    """
    out = stack.out_of(None)
    held = [e for e in stack.subject_to if e.equality and e.quantity == "motion" and e.name not in out]
    if not held:
        return ""
    try:
        with twin_of(robot) as twin:
            return _locked(held, twin) or _message(held, twin)
    except Exception:  # a user's faulty element: the tick reports it
        return ""


def _message(held: Sequence[Any], twin: Robot) -> str:
    home = twin.state(twin.home)
    holds = [element.hold(home).value for element in held]
    J = _rows(held, home, holds)[0]
    independent = rank(J, LOST)
    if independent in J.shape:  # full row or column rank
        return ""
    for k in (1, 2):
        q = _beside(J, twin, k)
        apart, met = _rows(held, twin.state(q), holds)[0], _rows(held, _met(held, twin, holds, q), holds)[0]
        if rank(apart, LOST) <= rank(met, LOST):
            return ""
    lost = np.linalg.svd(met)[0][:, rank(met, LOST) :]
    ends = np.cumsum([element.rows(twin) for element in held])[:-1]
    shares = [float(np.linalg.norm(part)) for part in np.split(lost, ends)]
    named = [element for element, share in zip(held, shares, strict=True) if share > PART]
    cure = "Remove a contact, or replace one by an EdgeContact or a PointContact"
    if looser := [_looser(held, twin, element) for element in named if isinstance(element, Weld | Hinge)]:
        cure = ". ".join(filter(None, looser)) or "Remove a closure"
    return (
        f"{', '.join(element.name for element in named)}: overconstrained. Only {independent} of {J.shape[0]} rows are "
        "independent near home; motion that satisfies these soon violates the others, so that commands alternate. "
        f"{cure}"
    )


def _locked(held: Sequence[Any], twin: Robot) -> str:
    """Name the Weld or Hinge whose loop of two joints or more has no motion left at poses that meet all rows."""
    closures = [element for element in held if isinstance(element, Weld | Hinge)]
    if not closures:
        return ""
    home = twin.state(twin.home)
    holds = [element.hold(home).value for element in held]
    start = _rows(held, home, holds)[0]
    found = dict.fromkeys(element.name for element in closures)
    for k in (1, 2):
        state = _met(held, twin, holds, _beside(start, twin, k))
        J = _rows(held, state, holds)[0]
        free = np.linalg.svd(J)[2][rank(J, LOST) :]
        still = [
            e.name for e in closures if len(_loop(e, state)) > 1 and np.all(abs(free[:, _columns(e, state)]) < STILL)
        ]
        found = {name: None for name in found if name in still}
    notes = []
    for element in (e for e in closures if e.name in found):
        if looser := _looser(held, twin, element):
            joints = ", ".join(_loop(element, twin.state(twin.home)))
            notes.append(f"{element.name}: holds all motion of {joints}. {looser}")
    return ". ".join(notes)


def _looser(held: Sequence[Any], twin: Robot, element: Any) -> str:
    """A sentence on closures with fewer rows that let the loop of an element move, "" if none does."""
    home = twin.state(twin.home)
    loose = [_ball(e) if isinstance(e, Weld | Hinge) else e for e in held]
    holds, whole = [e.hold(home).value for e in loose], Weld(frame=element.frame, relative_to=element.relative_to)
    start = _rows(loose, home, holds)[0]
    axes: list[Vec] = []
    for k in (1, 2):
        state = _met(loose, twin, holds, _beside(start, twin, k))
        J = _rows(loose, state, holds)[0]
        free = np.linalg.svd(J)[2][rank(J, LOST) :]
        columns = _columns(element, state)
        motions = rank(free[:, columns] * (abs(free[:, columns]) > STILL), LOST)
        if not motions:
            return ""
        turns = whole.jacobian(state)[3:] @ free.T
        if rank(turns, LOST) == 1:
            axes.append(np.linalg.svd(turns)[0][:, 0])
    ends = f"frame={element.frame!r}, relative_to={element.relative_to!r}"
    ways = [f"Ball({ends})"]
    if isinstance(element, Weld) and len(axes) == 2 and abs(axes[0] @ axes[1]) > 1.0 - STILL:
        axis = axes[0] * np.sign(axes[0][np.argmax(abs(axes[0]))])
        ways.insert(0, f"Hinge({ends}, axis=({', '.join(f'{x + 0.0:.6g}' for x in axis.round(9))}))")
    return (
        f"If the loop closes in a bearing, declare {' or '.join(ways)}, with both frames at the bearing (in an MJCF: "
        f"connect), instead of the {type(element).__name__}: the loop then has {motions} motion{'s' * (motions > 1)}"
    )


def _ball(element: Weld | Hinge) -> Ball:
    """The point of a closure alone."""
    assert element.relative_to is not None
    return Ball(frame=element.frame, relative_to=element.relative_to, closed=element.closed, name=element.name)


def _columns(element: Any, state: State) -> Index:
    """Tangent coordinates that move the frames of a closure against each other."""
    whole = Weld(frame=element.frame, relative_to=element.relative_to).jacobian(state)
    return np.flatnonzero(abs(whole).max(axis=0) > STILL)


def _loop(element: Any, state: State) -> list[str]:
    """Joints that move the frames of a closure against each other."""
    columns = set(_columns(element, state).tolist())
    robot = state.robot
    return [robot.joint_name(first) for _, first, count, *_ in robot.bodies if columns & {*range(first, first + count)}]


def _beside(J: Mat, twin: Robot, k: int) -> Vec:
    """A configuration near home, along a free direction of the rows; home without one."""
    free = np.linalg.svd(J)[2][rank(J, LOST) :]
    if not len(free):
        return twin.home
    direction = _scattered(free.shape[0], k) @ free
    return twin.integrate(twin.home, STEP * direction / np.abs(direction).max(), 1.0)


def _scattered(n: int, k: int) -> Vec:
    """A reproducible sequence of n irregular numbers from -1 to 1."""
    return np.asarray(np.cos(k * np.arange(1.0, n + 1.0) ** 2))


def _met(held: Sequence[Any], twin: Robot, holds: Sequence[Any], q: Vec) -> State:
    """The state at a pose near q that meets the rows."""
    for _ in range(STEPS):
        J, e = _rows(held, twin.state(q), holds)
        step = np.linalg.pinv(J, rcond=1e-9) @ e
        q = twin.integrate(q, -step * min(1.0, STEP / max(float(np.abs(step).max()), 1e-300)), 1.0)
    return twin.state(q)


def _rows(held: Sequence[Any], state: State, holds: Sequence[Any]) -> tuple[Mat, Vec]:
    blocks = [e.jacobian(state, hold) if e.steered else e.jacobian(state) for e, hold in zip(held, holds, strict=True)]
    errors = [np.asarray(e.error(state, hold)) for e, hold in zip(held, holds, strict=True)]
    return np.vstack(blocks), np.concatenate(errors)
