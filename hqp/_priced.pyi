from typing import Any

from hqp.arrays import Mat, Vec

class Stages:
    def __init__(self, n: int, rows: list[int], priced: list[int]) -> None: ...
    def bind(
        self,
        levels: list[tuple[Any, ...]],
        handed: list[tuple[Mat, Vec, Vec] | None],
        prices: Vec,
        shares: Vec,
        F: Mat | Vec | None,
        f: Vec | None,
        guard: bool,
    ) -> None: ...
    def solve(self, x: Vec, stages: Mat, last: Vec) -> int: ...
    def effort(self) -> tuple[int, bool]: ...
    def reset(self) -> None: ...
