"""Read damaged files and print unexpected exceptions: python -m tests.damage KIND COUNT SEED.

Runs in a process of its own: a crash in a library is a failure too, and the memory of a file is bounded.
"""

from __future__ import annotations

import json
import random
import resource
import sys
import tempfile
import traceback
import warnings
from collections.abc import Callable
from pathlib import Path

MEMORY = 4 * 2**30
"""Limit on the address space [bytes]."""


def main(kind: str, count: int, seed: int) -> int:
    from tests.damage import kinds

    resource.setrlimit(resource.RLIMIT_AS, (MEMORY, MEMORY))
    warnings.simplefilter("ignore")
    samples, damage, read, suffix = kinds.of(kind)
    raised: dict[str, str] = {}
    refused = 0
    with tempfile.TemporaryDirectory() as folder:
        path = Path(folder) / f"damaged{suffix}"
        for k in range(count):
            rng = random.Random(seed * 1_000_003 + k)
            data = damage(rng.choice(samples), rng)
            print(k, file=sys.stderr, flush=True)  # the last one has caused a crash
            path.write_bytes(data)
            refused += _tried(read, path, k, raised)
    print(json.dumps({"read": count, "refused": refused, "raised": raised}))
    return int(bool(raised))


def _tried(read: Callable[[Path], bool], path: Path, k: int, raised: dict[str, str]) -> int:
    """Return 1 if the file was refused with the right error."""
    try:
        return int(read(path))
    except BaseException as error:
        where = traceback.extract_tb(error.__traceback__)[-1]
        told = f"{type(error).__name__} at {Path(where.filename).name}:{where.lineno}: {str(error)[:200]}"
        raised[f"{k}"] = told
        return 0


if __name__ == "__main__":
    sys.exit(main(sys.argv[1], int(sys.argv[2]), int(sys.argv[3])))
