"""Things that are made once for a robot and a stack: the latest few of a robot are kept, as long as the robot is."""

from __future__ import annotations

from collections import OrderedDict
from collections.abc import Callable, Hashable
from typing import Generic, TypeVar
from weakref import WeakKeyDictionary

from hqp.declare.robot import Robot

T = TypeVar("T")


class Kept(Generic[T]):
    """Keep at most ``size`` values of each robot by key: the least recently used go first, all of them with the robot.

    A value is made of a copy of the robot: a reference to the robot itself would keep it alive.  ``home``, which may
    change, is part of the key.
    """

    def __init__(self, size: int) -> None:
        self._size = size
        self._values: WeakKeyDictionary[Robot, OrderedDict[Hashable, T]] = WeakKeyDictionary()

    def get(self, robot: Robot, key: Hashable, make: Callable[[Robot], T]) -> T:
        """Return the value of a key, made from a copy at first use; made each time for a key without a hash."""
        values, key = self._values.setdefault(robot, OrderedDict()), (key, robot.home.tobytes())
        try:
            value = values.pop(key, None)
        except TypeError:  # an element of the user's own with a field that has no hash
            return make(robot.copy())
        value = make(robot.copy()) if value is None else value
        values[key] = value  # the latest last
        if len(values) > self._size:
            values.popitem(last=False)
        return value

    def drop(self, robot: Robot, key: Hashable) -> None:
        """Forget the value of a key."""
        try:
            self._values.get(robot, OrderedDict()).pop((key, robot.home.tobytes()), None)
        except TypeError:
            return
