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
        rows: list[int],
        metric: bool,
        rank_tolerance: float,
        multiplier_tolerance: float,
        feasibility_tolerance: float,
        time_limit: float,
        max_iterations: int,
        exchanges: int,
        multipliers: bool,
    ) -> None: ...
    def take(self, hierarchy: object) -> bool: ...
    def solve(self) -> tuple[int, int, int, int]: ...
    def call(self) -> object: ...
    def limit(self, seconds: float) -> None: ...
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
    def tell(self) -> bool: ...
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
        rows: list[int],
        metric: bool,
        rank_tolerance: float,
        multiplier_tolerance: float,
        feasibility_tolerance: float,
        max_iterations: int,
        exchanges: int,
        priced: list[bool],
        met: float,
        flat: float,
        accurate: float,
        resting: float,
        rounded: float,
        activity: float,
        violation: float,
    ) -> None: ...
    def read(self, hierarchies: list[Hierarchy]) -> int: ...
    def stack(self, count: int, levels: list[tuple[object, ...]], constraints: int, like: Hierarchy | None) -> None: ...
    def solve(
        self, threads: int, x: _Vec, slack: _Vec, active: NDArray[np.int8], effort: NDArray[np.int32], points: _Vec
    ) -> None: ...
