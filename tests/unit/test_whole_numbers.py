"""Whole numbers of declarations: calls take any storage, and refuse other values by field and bounds."""

from collections.abc import Callable
from typing import Any

import numpy as np
import pytest

import hqp
from hqp import Batch, Level, Stack
from hqp.errors import DeclarationError
from hqp.numbers import whole
from hqp.tasks import CollisionAvoidance, FrictionCone, Position, Posture

ROBOT = hqp.robots.load("ur5")
CONTROLLER = hqp.Controller(Stack(Level(Position(frame="tool0", name="hand")), Level(Posture())))
SESSION = CONTROLLER.session(ROBOT, 0.002)
SESSION.step(ROBOT.state())
PROBLEM = SESSION.problem.copy()


def reach(**given: Any) -> Any:
    hand = Position(frame="tool0", name="hand")
    return hqp.reach(Stack(Level(hand)), ROBOT, hand.at(ROBOT.state().position("tool0")), **given)


PLACES: dict[str, Callable[[Any], Any]] = {
    "count": lambda n: Batch(CONTROLLER, ROBOT, n, 0.002).count,
    "threads": lambda n: Batch(CONTROLLER, ROBOT, 2, 0.002, threads=n).threads,
    "solve_many": lambda n: hqp.solve_many([PROBLEM, PROBLEM], threads=n).solved.all(),
    "edges": lambda n: FrictionCone(contact="sole", mu=0.5, edges=n),
    "slots": lambda n: CollisionAvoidance(slots=n),
    "restarts": lambda n: reach(restarts=n).success,
    "steps": lambda n: reach(steps=n).success,
}
STORAGES = [np.int64, np.uint8, np.array, float, np.float32]


@pytest.mark.parametrize("place", PLACES)
@pytest.mark.parametrize("storage", STORAGES, ids=lambda s: s.__name__)
def test_storage_does_not_matter(place: str, storage: Callable[[int], Any]) -> None:
    assert PLACES[place](storage(4)) == PLACES[place](4)


@pytest.mark.parametrize("place", PLACES)
@pytest.mark.parametrize("bad", [-1, 2.5, True, float("nan"), float("inf"), "4", None, np.array([4, 4])], ids=repr)
def test_other_values_are_refused(place: str, bad: Any) -> None:
    if place == "solve_many" and bad is None:
        pytest.skip("None is every core")
    with pytest.raises(DeclarationError, match=r"a whole number from [0-3] up"):
        PLACES[place](bad)


@pytest.mark.parametrize("value", [3, np.int8(3), 3.0])
def test_bounds_are_named(value: Any) -> None:
    assert type(whole("gait", "steps", value, 1, 3)) is int
    with pytest.raises(DeclarationError, match=r"gait: bad steps \(given .*\); allowed: a whole number from 4 to 9"):
        whole("gait", "steps", value, 4, 9)
