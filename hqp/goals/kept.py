"""Things that are made once for a robot and a stack: the latest few are kept."""

from __future__ import annotations

from collections import OrderedDict
from collections.abc import Callable, Hashable
from typing import Generic, TypeVar

T = TypeVar("T")


class Kept(Generic[T]):
    """At most ``size`` values by key, those not used for longest go first."""

    def __init__(self, size: int) -> None:
        self._size = size
        self._values: OrderedDict[Hashable, T] = OrderedDict()

    def get(self, key: Hashable, make: Callable[[], T]) -> T:
        """The value of a key, made where there is none; made each time for a key that has no hash."""
        try:
            value = self._values.pop(key, None)
        except TypeError:  # an element of the user's own with a field that has no hash
            return make()
        value = make() if value is None else value
        self._values[key] = value  # the latest last
        if len(self._values) > self._size:
            self._values.popitem(last=False)
        return value

    def drop(self, key: Hashable) -> None:
        """Forget the value of a key."""
        try:
            self._values.pop(key, None)
        except TypeError:
            return
