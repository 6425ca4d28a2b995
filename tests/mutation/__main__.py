"""Faults put into the code one at a time: which do the tests see?

`python -m tests.mutation --count 40 --seed 0` draws single faults in Python and C++, builds each in a copy of the tree,
runs the tests that fit its file and, where these pass, all of them.  A fault counts as killed where a test fails twice
with it and passes without it, or the run crashes, or does not end where it ends in time without it.  The copy alone
takes minutes to build; the whole takes hours: no part of the suite.
"""

from __future__ import annotations

import argparse
import random
import sys
import tempfile
from collections.abc import Sequence
from itertools import islice
from pathlib import Path

from .operators import Fault, changes, faults
from .tree import LONGER, ROOT, Tree, failed

TESTED_IN = {"rows": "tasks", "priced": "solvers", "solver": "solvers", "common": "solvers"}
"""Folders of tests of folders that have another name; of the rest those of the same name, else the units."""


def sources() -> list[str]:
    """Every file that faults are put into."""
    found = (path for part in ("hqp", "tasks", "robots") for path in (ROOT / part).rglob("*.[pch]*"))
    return sorted({p.resolve().relative_to(ROOT).as_posix() for p in found if p.suffix in (".py", ".hpp", ".cpp")})


def files_of_tests() -> list[str]:
    """Every file of tests."""
    return sorted(path.relative_to(ROOT).as_posix() for path in (ROOT / "tests").rglob("test_*.py"))


def fitting(path: str, every: Sequence[str]) -> list[list[str]]:
    """Tests by how near they are to a file: those with its name in theirs, then those of its folder."""
    *folders, name = Path(path).with_suffix("").parts
    named = [test for test in every if f"_{name.strip('_')}" in Path(test).stem]
    known = [TESTED_IN.get(folder, folder) for folder in reversed(folders)]
    own = next((f"tests/{folder}" for folder in known if (ROOT / "tests" / folder).is_dir()), "tests/unit")
    return [named, [own]] if named else [[own]]


def drawn(count: int, seed: int, only: str) -> list[Fault]:
    """So many faults, half of them in Python and half in C++, fewer where a file has no more."""
    texts = {path: (ROOT / path).read_text("utf-8") for path in sources() if path.startswith(only)}
    generator, chosen = random.Random(seed), []
    for python, most in ((True, count // 2), (False, count)):
        found = [f for path, text in texts.items() if path.endswith(".py") is python for f in faults(path, text)]
        generator.shuffle(found)
        real = (fault for fault in found if changes(fault, texts[fault.path]))
        chosen += islice(real, most - len(chosen))
    return chosen


def judged(fault: Fault, stages: Sequence[Sequence[str]], copy: Tree, seconds: float) -> str:
    """What became of a fault: killed by which test, survived, or not compiled."""
    there = seconds, copy.folder, copy.python
    with copy.fault(fault.path, fault.put_into((ROOT / fault.path).read_text("utf-8"))) as built:
        if not built:
            return "does not compile"
        for stage in stages:
            left_out: list[str] = []
            while first := failed([*stage, *(f"--deselect={test}" for test in left_out)], *there):
                if "::" not in first:
                    ends = not first.startswith(LONGER) or not failed(stage, seconds).startswith(LONGER)
                    return f"{'killed' if ends else 'no verdict'}: {first}"
                if failed([first], *there) and not failed([first], seconds):  # the latter in the work tree
                    return f"killed by {first}"
                left_out.append(first)  # fails now and then, or without the fault as well
    return "SURVIVED"


def main() -> int:
    """Draw faults, judge each, print a table as it grows; 0."""
    parser = argparse.ArgumentParser(prog="python -m tests.mutation", description=__doc__)
    parser.add_argument("--count", type=int, default=40, help="faults (40)")
    parser.add_argument("--seed", type=int, default=0, help="of the draw (0)")
    parser.add_argument("--only", default="", help="files whose path begins so, as hqp/cpp/rows (all)")
    parser.add_argument("--seconds", type=float, default=1800.0, help="longest run of tests (1800)")
    parser.add_argument("--fitting", action="store_true", help="only the tests that fit, not all of them after these")
    parser.add_argument("--list", action="store_true", help="print the faults, and judge none")
    given = parser.parse_args()
    chosen, every, verdicts = drawn(given.count, given.seed, given.only), files_of_tests(), []
    told = [fault.described((ROOT / fault.path).read_text("utf-8")) for fault in chosen]
    if given.list:
        print("\n".join(told))
        return 0
    with tempfile.TemporaryDirectory() as temporary:
        print("building a copy", file=sys.stderr, flush=True)
        copy = Tree(Path(temporary) / "hqp")
        print("| fault | what | verdict |\n| --- | --- | --- |", flush=True)
        for number, (fault, line) in enumerate(zip(chosen, told, strict=True), 1):
            stages = fitting(fault.path, every) + ([] if given.fitting else [["tests"]])
            verdicts.append(judged(fault, stages, copy, given.seconds))
            print(f"| {number} | {line.replace('|', chr(92) + '|')} | {verdicts[-1]} |", flush=True)
    killed, survived = (sum(verdict.startswith(word) for verdict in verdicts) for word in ("killed", "SURVIVED"))
    print(f"{killed} of {killed + survived} killed; {len(verdicts) - killed - survived} without a verdict")
    return 0


if __name__ == "__main__":
    raise SystemExit(main())
