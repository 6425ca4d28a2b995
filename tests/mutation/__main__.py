"""Mutation test: put single faults into the code and count those that the tests detect.

`python -m tests.mutation --count 40 --seed 0` draws single faults in Python and C++, builds each in a copy of the tree
(build/mutation) and runs tests there: fast ones whose words are nearest to the words about the fault, slow ones of the
nearest two files, all other fast ones.  A fault counts as killed if a test fails or does not end twice with it, and
passes without it.  Each verdict is written at once: a second call continues from there.
"""

from __future__ import annotations

import argparse
import json
import math
import re
from collections import Counter
from functools import cache
from hashlib import sha256
from itertools import zip_longest

from .operators import Fault, changes, faults
from .tree import LEFT_OUT, ROOT, Tree

FOLDER = ROOT / "build" / "mutation"
NEAR = 12
"""Lines before and after a fault whose words count as about it."""

FIRST, FITTING = 8, "fitting tests"
"""Number of test files that run before all others: collecting all takes longer than most faults live."""


def sources() -> list[str]:
    """Every file for faults; no test runs the workers of rivals."""
    found = (path for part in ("hqp", "tasks", "robots") for path in (ROOT / part).rglob("*.[pch]*"))
    paths = {p.resolve().relative_to(ROOT).as_posix() for p in found if p.suffix in (".py", ".hpp", ".cpp")}
    return sorted(path for path in paths if "rivals/workers" not in path)


def words(text: str) -> Counter[str]:
    """Words of names and of prose, in lower case."""
    return Counter(word.lower() for word in re.findall(r"[A-Z]?[a-z]{2,}", text))


@cache
def files_of_tests() -> dict[str, Counter[str]]:
    """Words of every test file, and of the C++ that it names."""
    native = {path.name: path.read_text("utf-8") for path in (ROOT / "tests").rglob("*.cpp")}
    found = {}
    for path in sorted((ROOT / "tests").rglob("test_*.py")):
        name, text = path.relative_to(ROOT).as_posix(), path.read_text("utf-8")
        if not name.startswith(LEFT_OUT):
            found[name] = words("\n".join([name, text, *(told for cpp, told in native.items() if cpp in text)]))
    return found


def nearest(path: str, text: str, line: int) -> list[str]:
    """Test files, sorted by shared words with a place of a source: its lines, its file, its name.

    A word that occurs in n of N files counts log(N / n); a file's sum is divided by the root of its number of words.
    """
    about = Counter(dict.fromkeys(words(text), 1.0))
    about.update(dict.fromkeys(words("\n".join(text.splitlines()[max(0, line - NEAR) : line + NEAR])), 2.0))
    about.update(dict.fromkeys(words(path), 4.0))
    known = Counter(word for found in files_of_tests().values() for word in found)
    rare = {word: math.log(len(files_of_tests()) / count) for word, count in known.items()}

    def score(test: str) -> float:
        found = files_of_tests()[test]
        shared = (about[w] * (1.0 + math.log(found[w])) * rare[w] for w in about if found[w])
        return sum(shared) / math.sqrt(len(found))

    return sorted(files_of_tests(), key=score, reverse=True)


def drawn(count: int, seed: int, only: str) -> list[Fault]:
    """Draw ``count`` faults, in Python and in C++ in turns, or fewer if there are no more.

    The order is a hash of each fault and its surroundings: a change elsewhere does not alter the draw.
    """
    texts = {path: (ROOT / path).read_text("utf-8") for path in sources() if path.startswith(only)}

    def place(fault: Fault) -> bytes:
        around = texts[fault.path][max(0, fault.start - 60) : fault.stop + 60]
        return sha256(f"{seed} {fault.path} {fault.operator} {fault.new} {around}".encode()).digest()

    kinds = []
    for python in (True, False):
        found = [f for path, text in texts.items() if path.endswith(".py") is python for f in faults(path, text)]
        kinds.append([fault for fault in sorted(found, key=place)[: 2 * count] if changes(fault, texts[fault.path])])
    both = zip_longest(*kinds)
    return [fault for pair in both for fault in pair if fault][:count]


def judged(fault: Fault, copy: Tree, seconds: float, fitting: bool, left_out: set[str]) -> str:
    """Verdict on a fault: killed by a named test, survived, or not compiled.

    fitting: run only the nearest tests.  left_out: tests that fail at times, or without a fault as well; grows.
    """
    text = (copy.folder / fault.path).read_text("utf-8")
    order = nearest(fault.path, text, text.count("\n", 0, fault.start))
    stages = (order[:FIRST], "not slow"), (order[:2], "slow"), (order[FIRST:], "not slow")
    run = "all"
    for files, marked in stages[:2] if fitting else stages:
        while True:
            with copy.fault(fault.path, fault.put_into(text)) as built:
                if not built:
                    return "does not compile"
                test, how = copy.failed(files, seconds, marked, left_out)
                again = test and copy.failed([test], min(seconds, 60.0), marked)[1]
            if not how:
                break
            if how == "out of time" and not again:
                run = f"{seconds:.0f} s of"
                break
            if again and not copy.failed([test], 2 * seconds, marked)[1]:
                return f"killed by {test}, {how}"
            left_out.add(test)
    return f"SURVIVED {run} {FITTING if fitting else 'tests'}"


def main() -> int:
    """Draw faults, judge each, print a table as it grows; return 0."""
    parser = argparse.ArgumentParser(prog="python -m tests.mutation", description=__doc__)
    parser.add_argument("--count", type=int, default=40, help="faults (40)")
    parser.add_argument("--seed", type=int, default=0, help="of the draw (0)")
    parser.add_argument("--only", default="", help="files whose path begins so, as hqp/cpp/rows (all)")
    parser.add_argument("--seconds", type=float, default=300.0, help="CPU time of each of these three, at most (300)")
    parser.add_argument("--fitting", action="store_true", help="only the tests that fit, not all of them after these")
    parser.add_argument("--again", action="store_true", help="judge again what survived")
    parser.add_argument("--list", action="store_true", help="print the faults and what is known of them, judge none")
    given = parser.parse_args()
    kept = FOLDER / "verdicts.json"
    known: dict[str, str] = json.loads(kept.read_text("utf-8")) if kept.exists() else {}
    again = "SURVIVED" if given.again else None if given.fitting else FITTING
    known = {line: verdict for line, verdict in known.items() if again is None or again not in verdict}
    copy, left_out, verdicts = None, set[str](), []
    print("| fault | what | verdict |\n| --- | --- | --- |", flush=True)
    chosen = drawn(given.count, given.seed, given.only)
    told = [fault.described((ROOT / fault.path).read_text("utf-8")) for fault in chosen]
    for number, (fault, line) in enumerate(zip(chosen, told, strict=True), 1):
        name = re.sub(r":\d+ ", " ", line, count=1)  # independent of changes elsewhere
        if name not in known and not given.list:
            copy = copy or Tree(FOLDER / "tree")
            known[name] = judged(fault, copy, given.seconds, given.fitting, left_out)
            kept.write_text(json.dumps(known, indent=1), "utf-8")
        verdicts.append(known.get(name, ""))
        print(f"| {number} | {line.replace('|', chr(92) + '|')} | {verdicts[-1]} |", flush=True)
    killed, survived = (sum(verdict.startswith(word) for verdict in verdicts) for word in ("killed", "SURVIVED"))
    print(f"{killed} of {killed + survived} killed; {len(verdicts) - killed - survived} without a verdict")
    return 0


if __name__ == "__main__":
    raise SystemExit(main())
