"""Native kernel of the lexicographic solver."""

from collections.abc import Sequence
from typing import TypeAlias

import numpy as np
from numpy.typing import NDArray

from hqp.problem import Hierarchy, Solution, Status

_Vec: TypeAlias = NDArray[np.float64]

instruction_set: str

class Workspace:
    def __init__(
        self,
        n: int,
        rows: Sequence[int],
        metric: bool,
        options: dict[str, float],
        multipliers: bool,
        priced: Sequence[bool],
        tolerances: dict[str, float],
    ) -> None: ...
    def take(self, hierarchy: object) -> bool: ...
    def solve(self) -> tuple[int, int, int, int]: ...
    def call(self) -> object: ...
    def core(self) -> object:
        """A capsule of the solver itself, for ``_session``."""

    def price(self, hierarchy: object) -> bool:
        """As ``take``, with the prices."""

    def begin(self) -> tuple[int, int, int, int] | None:
        """Counts where stages went on from the levels above the one that was not met a solve ago; None: all are due."""

    def follow(self, x: _Vec) -> bool:
        """Stages from the first level that x, the exact answer, does not settle; whether there is one."""

    def unpriced_met(self, x: _Vec) -> bool:
        """Whether the levels without a price above the last with one are met."""

    @property
    def head(self) -> int:
        """The level above which all are settled, for the next solve; 0 for none known."""

    def elapsed(self) -> float:
        """Since the latest solve began [s]."""

    def untold(self) -> None:
        """The latest answer is one that was not found here: ``tell`` has nothing to tell of it."""

    def effort(self) -> tuple[int, bool, bool, bool, bool]:
        """Steps of the latest stages, whether all reached their optima, whether one met uncertain directions, whether
        the answer depends on such, whether that or an end is in doubt."""

    def describe(self, x: _Vec, slack: _Vec, marks: NDArray[np.int8]) -> bool: ...
    def accounts(self, hierarchy: object, owner: NDArray[np.int32], elements: int, near: float) -> bool: ...
    def account(self, w: _Vec, x: _Vec, multipliers: _Vec, out: _Vec) -> None: ...
    def points(self) -> _Vec: ...
    def end(self) -> _Vec: ...
    def limit(self, seconds: float) -> None:
        """Of the exact kernel."""

    def limit_stages(self, seconds: float) -> None:
        """Of all else."""

    def report_as(
        self,
        solution: type[Solution],
        statuses: tuple[Status, ...],
        slack: tuple[slice, ...],
        active: tuple[slice, ...],
        multipliers: tuple[slice, ...],
        stopped: str,
        unsure: str,
    ) -> None: ...
    def solution(
        self, hierarchy: object, build_seconds: float, numbers: _Vec, multipliers: _Vec
    ) -> Solution | None: ...
    def tell(self) -> _Vec | None:
        """Multipliers of the latest answer, live; those above the stages, or empty, where these gave it."""

    def reset(self, plain: bool = False) -> None: ...
    def turn(self, out: Sequence[bool]) -> None: ...
    def values(self) -> _Vec: ...
    def numbers(self) -> _Vec: ...
    def active(self) -> NDArray[np.int8]: ...
    def multipliers(self) -> _Vec: ...

class Batch:
    def __init__(
        self,
        n: int,
        rows: Sequence[int],
        metric: bool,
        options: dict[str, float],
        priced: Sequence[bool],
        tolerances: dict[str, float],
    ) -> None: ...
    def read(self, hierarchies: list[Hierarchy]) -> int: ...
    def stack(self, count: int, levels: list[tuple[object, ...]], constraints: int, like: Hierarchy | None) -> None: ...
    def solve(
        self, threads: int, x: _Vec, slack: _Vec, active: NDArray[np.int8], effort: NDArray[np.int32], points: _Vec
    ) -> None: ...
