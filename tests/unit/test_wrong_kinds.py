"""Values of a wrong kind for a public call end in an error of ours that names the field and the value."""

from collections.abc import Callable
from typing import Any

import numpy as np
import pytest

import hqp
from hqp import Level, Stack
from hqp.errors import HqpError
from hqp.tasks import Posture

ROBOT = hqp.robots.load("ur5")
STACK = Stack(Level(Posture(), name="posture"))
CONTROLLER = hqp.Controller(STACK)
SESSION = CONTROLLER.session(ROBOT, 0.002)

CALLS: dict[str, Callable[[Any], Any]] = {
    "stack": lambda x: hqp.Controller(x),
    "formulation": lambda x: hqp.Controller(STACK, x),
    "solver": lambda x: hqp.Controller(STACK, solver=x),
    "price": lambda x: hqp.Controller(STACK, price=x),
    "bounds": lambda x: hqp.Controller(STACK, bounds=x),
    "braking": lambda x: hqp.Controller(STACK, braking=x),
    "robot": lambda x: CONTROLLER.session(x, 0.002),
    "dt": lambda x: CONTROLLER.session(ROBOT, x),
    "load solver": lambda x: hqp.solvers.load(x),
    "load robot": lambda x: hqp.robots.load(x),
    "solvers of compare": lambda x: hqp.compare(STACK, ROBOT, solvers=x),
    "repeats": lambda x: hqp.compare(STACK, ROBOT, solvers="lexicographic", repeats=x),
    "solvers of bench": lambda x: hqp.bench(STACK, ROBOT, solvers=x),
    "seconds": lambda x: hqp.bench(STACK, ROBOT, seconds=x),
    "certify_every": lambda x: hqp.bench(STACK, ROBOT, seconds=0.01, certify_every=x),
    "members": lambda x: Level(x),
    "levels": lambda x: Stack(x),
    "find": lambda x: STACK.find(x),
    "without": lambda x: STACK.without(x),
    "with_laws": lambda x: STACK.with_laws({x if isinstance(x, str) else "posture": x}),
    "home": lambda x: ROBOT.copy().set_home(x),
    "joints": lambda x: ROBOT.joints(x),
    "frame": lambda x: ROBOT.frame(x),
    "capsules": lambda x: ROBOT.with_capsules(x),
    "laws of a session": lambda x: SESSION.obey(x),
    "stack of a change": lambda x: SESSION.change(x),
    "prepared stack": lambda x: SESSION.prepare(x),
    "duration of a change": lambda x: SESSION.change(STACK, x),
}
VALUES = [-4, -2.5, "no such name", b"bytes", True, ("a",), {"a": 1}, object(), int, np.nan, np.ones((2, 3)), print]


@pytest.mark.parametrize("call", CALLS)
@pytest.mark.parametrize("value", VALUES, ids=lambda value: type(value).__name__)
def test_they_are_refused(call: str, value: Any) -> None:
    with pytest.raises(HqpError) as error:
        CALLS[call](value)
    assert len(str(error.value)) > 10
