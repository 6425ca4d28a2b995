"""Values of a wrong kind for a call of walking or estimation end in an error of ours that names the value's place."""

import contextlib
import math
import tempfile
from collections.abc import Callable
from dataclasses import fields, is_dataclass
from pathlib import Path
from typing import Any

import numpy as np
import pytest

import hqp
from hqp.errors import HqpError
from hqp.estimation import FeetEstimator, MomentumObserver, RateObserver
from hqp.robots.soles import feet
from hqp.walking import (
    LEFT,
    RIGHT,
    Command,
    DcmPlan,
    Foothold,
    Footsteps,
    Gait,
    Landing,
    Laws,
    Piece,
    Reach,
    Swing,
    Walker,
    Walkers,
    adjust,
    largest_push,
    natural_frequency,
)
from tests.scenes.bipeds import biped

ROBOT, SOLES = feet(hqp.robots.load(biped(Path(tempfile.mkdtemp()), bend=0.5)))
WALKER = Walker(ROBOT, soles=SOLES)
WALKERS = Walkers(WALKER, 2)
STATE = ROBOT.state(WALKER.start)
TICK = WALKER.step(STATE)
REACH = Reach(forward=0.3, least=0.1, most=0.3)
STEPS = Footsteps(period=0.7, width=0.2, reach=REACH)
FOOT, OTHER, ZERO = Foothold(LEFT, 0.1, 0.1), Foothold(RIGHT, 0.0, -0.1), np.zeros(2)
GOAL = np.array([0.2, 0.0, 0.0, 0.0])
LANDING = Landing(stance=OTHER, foothold=FOOT, offset=ZERO, left=0.3)
ESTIMATOR = FeetEstimator(ROBOT, SOLES, 0.002, WALKER.start)
OBSERVER = MomentumObserver(ROBOT, SOLES[0], WALKER.feet[0].leg, 0.002)
RATES = RateObserver(ROBOT, 0.002)
PUSH = ([(-0.1, -0.1), (0.1, -0.1), (0.0, 0.1)], [0.0, 0.0], [1.0, 0.0], 0.1, 3.0)
MOTION = (WALKER.start, np.zeros(ROBOT.nv), np.array([0.0, 0.0, 9.8]), np.ones(2))
BATCH = (np.tile(WALKER.start, (2, 1)), np.zeros((2, ROBOT.nv)), np.ones((2, 2)))

WRONG = [
    "no such name",
    b"bytes",
    True,
    ("a",),
    {"a": 1},
    object(),
    int,
    np.ones((2, 3)),
    print,
    1j,
    10**400,
    (1, 2, 3),
]
ODD = [-4, -2.5, 0, None, math.nan, math.inf, [], np.array([math.nan] * 4)]
"""Values that some calls take."""

Call = Callable[[Any], Any]


def parts(name: str, call: Callable[..., Any], *given: Any, **named: Any) -> dict[str, Call]:
    """Calls with a value in place of each argument."""

    def placed(k: int) -> Call:
        return lambda x: call(*given[:k], x, *given[k + 1 :], **named)

    found = {f"{name} {k}": placed(k) for k in range(len(given))}
    return found | {f"{name} {field}": lambda x, field=field: call(*given, **named | {field: x}) for field in named}


def values(made: Any) -> dict[str, Call]:
    """Calls with a value in place of each field of a declaration."""
    assert is_dataclass(made)
    known = {field.name: getattr(made, field.name) for field in fields(made)}
    return parts(type(made).__name__, lambda **given: type(made)(**given), **known)


def ended(x: Any) -> Any:
    """None for no footholds at all, which end a walk."""
    return None if isinstance(x, list) else x


OPTIONS = ("gait", "dt", "reach", "laws", "soles", "friction", "limits", "price", "bandwidth", "deadline", "max_age")
CALLS: dict[str, Call] = {
    **{f"Walker {k}": lambda x, k=k: Walker(ROBOT, **{"soles": SOLES, k: x}) for k in OPTIONS},
    **parts("Walker", Walker, ROBOT),
    **values(Gait()),
    **values(REACH),
    **values(STEPS),
    **values(Command()),
    **values(Laws()),
    **values(LANDING),
    **values(WALKER.ability),
    **values(Piece(1.0, ZERO, ZERO)),
    **{
        f"Foothold {k}": lambda x, k=k: WALKER.follow([Foothold(**{"side": 0, "x": 0.0, "y": 0.1, k: x})])
        for k in "xyz"
    },
    "Foothold side": lambda x: WALKER.follow([Foothold(x, 0.0, 0.1)]),
    "follow": lambda x: WALKER.follow(ended(x)),
    "foothold": lambda x: WALKER.follow([x]),
    **parts("go", WALKER.go, forward=0.0, left=0.0, turn=0.0),
    **parts("step", WALKER.step, STATE, np.ones(2), now=0.0),
    **parts("plan", WALKER.plan, 0.01, 50.0),
    **parts("positions", WALKER.positions, TICK, np.ones(len(ROBOT.joint_names)), 0.0),
    **parts("weigh", WALKER.session.weigh, 1.0),
    "export": lambda x: WALKER.export(x if not isinstance(x, str) else None),
    "key": lambda x: WALKER.export(Path(tempfile.mkdtemp()) / "w.hqp", key=ended(x) if not isinstance(x, bytes) else 4),
    **parts("quicker", Gait().quicker, 0.5),
    **parts("next", STEPS.next, OTHER, Command()),
    **parts("within", STEPS.within, FOOT, OTHER),
    **parts("Walkers", Walkers, WALKER, 2, threads=1),
    "load": lambda x: Walkers.load(x if not isinstance(x, str) else None, 2),
    "follow of Walkers": lambda x: WALKERS.follow(ended(x)),
    **parts("go of Walkers", WALKERS.go, forward=0.0, left=0.0, turn=0.0),
    **{f"{name} of Walkers": lambda x, name=name: getattr(WALKERS, name)(x) for name in ("stop", "halt", "resume")},
    **parts("why of Walkers", WALKERS.why, 0),
    **parts("step of Walkers", WALKERS.step, *BATCH),
    **parts("allowed", WALKER.ability.allowed, Command()),
    **parts("paces", WALKER.ability.paces, Command(), Command(0.2), 24),
    **parts("haste", WALKER.ability.haste, Command()),
    **parts("Swing", Swing, np.zeros(4), GOAL, 0.5, 0.05, search=0.1, depth=0.06),
    **parts("step of Swing", Swing(np.zeros(4), GOAL, 0.5, 0.05).step, 0.002),
    **parts("retarget", Swing(np.zeros(4), GOAL, 0.5, 0.05).retarget, GOAL, 1.0, 0.002),
    **parts("clear", Swing(np.zeros(4), GOAL, 0.5, 0.05).clear, 0.01),
    **parts("DcmPlan", DcmPlan, [Piece(1.0, ZERO, ZERO)], 3.0),
    **parts("at", DcmPlan([Piece(1.0, ZERO, ZERO)], 3.0).at, 0.1),
    **parts("natural_frequency", natural_frequency, 0.6, 9.81),
    **parts(
        "adjust",
        adjust,
        LANDING,
        STEPS,
        ZERO,
        ZERO,
        3.0,
        now=ZERO,
        soonest=0.1,
        latest=0.6,
        usual=0.3,
        speed=1.0,
        least=0.0,
    ),
    **parts("largest_push", largest_push, *PUSH),
    **parts("FeetEstimator", FeetEstimator, ROBOT, SOLES, 0.002, WALKER.start, least_load=30.0, tilt=0.1, bias=1.0),
    **parts("update", ESTIMATOR.update, *MOTION),
    **parts(
        "MomentumObserver", MomentumObserver, ROBOT, SOLES[0], WALKER.feet[0].leg, 0.002, coupled=None, damping=None
    ),
    **parts("update of MomentumObserver", OBSERVER.update, STATE, np.zeros(len(ROBOT.joint_names))),
    **parts("RateObserver", RateObserver, ROBOT, 0.002, bandwidth=100.0, most=0.12),
    **parts("correct", RATES.correct, np.zeros(ROBOT.nv)),
    **parts("load of robots", lambda x: hqp.robots.load("g1", rotors=x), 0.01),
}
TAKEN: dict[str, tuple[int, ...]] = {"update 2": (11,), "load of robots 0": (2,), "step now": (2,)}
"""Values of WRONG, by place, that are right there."""


@pytest.mark.parametrize("name", CALLS)
def test_they_are_refused(name: str) -> None:
    for k, value in enumerate(WRONG):
        if k in TAKEN.get(name, ()):
            CALLS[name](value)
            continue
        with pytest.raises(HqpError) as error:
            CALLS[name](value)
        assert len(str(error.value)) > 20, error.value
        assert any(word in str(error.value) for word in ("allowed", "closest")), error.value


@pytest.mark.parametrize("name", CALLS)
def test_odd_ones_are_taken_or_refused(name: str) -> None:
    for value in ODD:
        with contextlib.suppress(HqpError):
            CALLS[name](value)
