"""Every stored problem set as Parquet and for qpbenchmark: python -m benchmarks.speed.publish FOLDER"""

from __future__ import annotations

import sys
from pathlib import Path

from hqp.lab import problem_sets
from tests.scenes import problems

DIFFICULT = ("d38", "d57", "rand12", "rand20", "randint10")
"""Sets with singular, conflicting or rank-deficient levels."""


def publish(folder: Path) -> list[Path]:
    """Write all sets into a folder, and return the files."""
    folder.mkdir(parents=True, exist_ok=True)
    hard = sorted(f"hard/{path.stem}" for path in (problems.FOLDER / "hard").glob("*.npz"))
    written = []
    for name in (*problems.names(), *hard):
        difficulty = "hard" if name in hard else "difficult" if name in DIFFICULT else "ordinary"
        target = folder / f"{name.replace('/', '_')}.parquet"
        text = "hierarchical least-squares problems, see tests/scenes/data/problems/README.md"
        problem_sets.write(target, problems.load(name), name=name, description=text, difficulty=difficulty)
        written += [target, problem_sets.to_qpbenchmark(target, target.with_suffix(".qp.parquet"))]
    return written


if __name__ == "__main__":
    for path in publish(Path(sys.argv[1])):
        print(path)
