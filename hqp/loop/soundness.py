"""Checks before the loop: can a controller run on a model? Finds invalid numbers, and rows that are never usable."""

from __future__ import annotations

from collections.abc import Iterator
from contextlib import contextmanager
from threading import Lock
from weakref import WeakKeyDictionary, WeakSet

import numpy as np

from hqp.declare.price import Price
from hqp.declare.robot import Robot
from hqp.declare.stack import Stack
from hqp.errors import DynamicsFailed, HqpError, ModelError
from hqp.programs.assembly import OWN
from hqp.programs.formulation import Formulation

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
