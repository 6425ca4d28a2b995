from collections.abc import Sequence
from typing import Any

from hqp.arrays import Mat, Signs, Vec

class Stages:
    def __init__(
        self,
        n: int,
        rows: list[int],
        priced: list[int],
        met: float,
        flat: float,
        accurate: float,
        resting: float,
        rounded: float,
        activity: float,
        violation: float,
    ) -> None: ...
    def bind(
        self,
        levels: list[tuple[Any, ...]],
        prices: Vec,
        turning: Vec | None,
        eta: float,
        F: Mat | Vec | None,
        f: Vec | None,
        metric: Mat | None,
        origin: Vec | None,
    ) -> None: ...
    def solve(self, x: Vec, stages: Mat, last: Vec, head: int = 0, seconds: float = 0.0) -> int: ...
    def after(self, exact: object, x: Vec, stages: Mat, last: Vec) -> object:
        """The solve whose capsule is given, and ``solve`` of x which it wrote: a capsule for other native modules."""

    def above(self, head: int, solve: object, x: Vec) -> None:
        """For that capsule: the solve of the levels above one, and the x that it writes."""

    def answers(self, constraints: int) -> None:
        """For that capsule: it answers itself where the stages reach their optima; the rest as for ``describe``."""

    @property
    def head(self) -> int:
        """The level above which all are settled, for the next solve; 0 for none known."""

    @head.setter
    def head(self, head: int) -> None: ...
    def limit(self, seconds: float) -> None:
        """Time for solves by way of that capsule [s], none for 0."""

    def latest(self) -> tuple[bool, bool, int, float]:
        """Whether the latest run of the capsule settled all levels, whether it answered itself, the level above which
        it solved exactly, 0 for all, the time since it began [s]."""

    def unasked(self) -> None:
        """The latest answer came without the stages: ``latest`` is to tell nothing of those before."""

    def accounts(self, stages: Mat, owner: Any, elements: int, near: float) -> None: ...
    def account(self, w: Vec, x: Vec, multipliers: Vec | None, out: Vec) -> None: ...
    def describe(self, x: Vec, constraints: int, slack: Vec, marks: Signs) -> bool: ...
    def effort(self) -> tuple[int, bool, bool, bool, bool]:
        """Steps of the latest stages, whether all reached their optima, whether one met uncertain directions, whether
        the answer depends on such, whether that or an end is in doubt."""

    def reset(self) -> None: ...
    def turn(self, out: Sequence[bool]) -> None: ...
