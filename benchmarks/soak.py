"""Random closed loops with faults: NaN, kicks, changes of stack, conflicts, targets out of reach.

`python -m benchmarks soak --ticks 100000` counts statuses and prints the worst tick and the worst jump.  An exception,
a number that is not finite, a changed upper level or a violated rate limit ends the run.  Every tenth tick solves
the upper levels again without those below and compares.
"""

from __future__ import annotations

import argparse
import gc
import resource

import numpy as np

from tests.scenes.soak import LEVELS, RATES, ROBOTS, Record, load, soak


def add_arguments(parser: argparse.ArgumentParser) -> None:
    """Options of this part."""
    parser.add_argument("--ticks", type=int, default=100_000, help="ticks in all (100000)")
    parser.add_argument("--seed", type=int, default=0, help="of events and targets (0)")


def run(arguments: argparse.Namespace) -> int:
    """Soak every robot at every level in turns of 500 ticks up to the number of ticks; print the record."""
    ticks = 5000 if arguments.quick else int(arguments.ticks)
    rng, record, turn, sizes = np.random.default_rng(arguments.seed), Record(), 0, []
    while record.ticks < ticks:
        robot = load(ROBOTS[turn % len(ROBOTS)])
        level = LEVELS[(turn // len(ROBOTS)) % len(LEVELS)]
        soak(robot, level, min(500, ticks - record.ticks), rng, record, RATES if turn % 2 else None)
        turn += 1
        if turn % (len(ROBOTS) * len(LEVELS)) == 0:
            gc.collect()
            if turn % (10 * len(ROBOTS) * len(LEVELS)) == 0 and not arguments.quick:
                print(record, flush=True)
            sizes.append(resource.getrusage(resource.RUSAGE_SELF).ru_maxrss / 1024)
    print(record)
    print(
        f"peak memory after each round [MB]: {', '.join(f'{size:.0f}' for size in sizes[:: max(1, len(sizes) // 10)])}"
    )
    return 0
