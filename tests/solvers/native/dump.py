"""Hierarchies as a flat binary file for the C++ driver."""

from __future__ import annotations

import struct
import sys
from collections.abc import Iterable
from pathlib import Path

import numpy as np

from hqp import Hierarchy, Selection


def dump(problems: Iterable[Hierarchy], path: Path) -> Path:
    """count, then per problem n, levels, and per level m, 1 for a selection, A or (index, scale), bounds."""
    problems = list(problems)
    with path.open("wb") as file:
        file.write(struct.pack("i", len(problems)))
        for problem in problems:
            file.write(struct.pack("ii", problem.n, len(problem.levels)))
            for rows in problem.levels:
                file.write(struct.pack("ii", rows.m, isinstance(rows.A, Selection)))
                if isinstance(rows.A, Selection):
                    file.write(rows.A.index.astype(np.int64).tobytes() + rows.A.scale.tobytes())
                else:
                    file.write(np.ascontiguousarray(rows.A).tobytes())
                file.write(rows.lower.tobytes() + rows.upper.tobytes())
    return path


if __name__ == "__main__":  # every stored set and some hard random problems into a folder
    from tests.scenes import problems as stored
    from tests.scenes import random_hierarchies

    folder = Path(sys.argv[1])
    for name in stored.names():
        print(dump(stored.load(name), folder / f"{name}.bin"))
    print(dump((random_hierarchies.hierarchy(seed) for seed in range(400)), folder / "random_hierarchies.bin"))
