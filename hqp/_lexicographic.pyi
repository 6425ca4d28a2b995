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
        """Return a capsule of the solver for ``_session``."""

    def price(self, hierarchy: object) -> bool:
        """Take a hierarchy with its prices."""

    def begin(self) -> tuple[int, int, int, int] | None:
        """Resume stages from the levels above the one unmet in the last solve, and return counts; None: all stages are
        due."""

    def follow(self, x: _Vec) -> bool:
        """Run stages from the first level that x, the exact answer, does not settle; return false if it settles all."""

    def unpriced_met(self, x: _Vec) -> bool:
        """Return true if the levels without a price above the last priced one are met."""

    @property
    def prefix(self) -> int:
        """Level above which all levels are settled, for the next solve; 0 if unknown."""

    def elapsed(self) -> float:
        """Time since the latest solve began [s]."""

    def without_multipliers(self) -> None:
        """Mark the latest answer as found elsewhere: ``exact_multipliers`` has no multipliers for it."""

    def effort(self) -> tuple[int, bool, bool, bool, bool]:
        """Steps of the latest stages; true if all reached their optima, if one met uncertain directions, if the answer
        depends on such directions, if this or an end is in doubt."""

    def describe(self, x: _Vec, slack: _Vec, marks: NDArray[np.int8]) -> bool: ...
    def accounts(self, hierarchy: object, owner: NDArray[np.int32], elements: int, near: float) -> bool: ...
    def account(self, w: _Vec, x: _Vec, multipliers: _Vec, out: _Vec) -> None: ...
    def points(self) -> _Vec: ...
    def end(self) -> _Vec: ...
    def limit(self, seconds: float) -> None:
        """Set the time limit of the exact kernel [s]."""

    def limit_stages(self, seconds: float) -> None:
        """Set the time limit of everything else [s]."""

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
    def exact_multipliers(self) -> _Vec | None:
        """Multipliers of the latest answer, live; if stages gave it, those above the stages, or an empty array."""

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
