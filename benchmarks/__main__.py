"""The command ``python -m benchmarks``: one part by name, or the main job with its report."""

from __future__ import annotations

import argparse
import importlib
import importlib.util
import os
import subprocess
import sys
import time
from collections.abc import Sequence
from concurrent.futures import ThreadPoolExecutor
from pathlib import Path
from types import ModuleType

RESULTS = Path(__file__).parent / "results"

PARTS = {
    "papers": "every equation of the papers at its tolerance, negative controls, the closed loop",
    "compare": "the paper's stack through every solver: agreement, strictness, certificates",
    "timing": "ticks of 500 Hz through every solver against 2 ms and the bare Pinocchio calls",
    "torque": "torque ticks of 1 kHz on Dreamer and Talos through every solver, split",
    "solvers": "solvers on problem sets, without a robot",
    "calm": "closed loops out of reach, at the edge, blocked: exact beside priced levels",
    "experiments": "experiments in simulation",
}
"""Parts of the main job in order; a missing module omits its part.  A module has ``add_arguments`` and ``run``."""

EXTRA = {
    "changes": "changes of stack in a closed loop: jumps of the command, time of a tick",
    "deadline": "torque ticks with violated constraints: time and quality with the default deadline and without",
    "batches": "many worlds at once on G1 and UR5: ticks a second, memory",
    "loops": "recorded loops of five robots in C++: same bits, allocations, times of ticks",
    "soak": "long random closed loops with faults of every kind",
    "rounding": "torque problems of closed loops with noise, on other kernels, from other starts",
    "collision": "blocked hands, a table in MuJoCo, and the cost of pairs",
    "pairs": "automatic collision pairs of six robots",
    "surfaces": "capsules around the surfaces of all shipped and of generated robots",
    "pages": "tables of the experiments' pages from the committed runs",
    "arms": "arms above the legs of a public walking policy, beside pink",
    "talos": "arms above the walker of Talos, whose session is its own",
    "filter": "times of a filter behind a policy, and hostile commands",
    "reach": "inverse kinematics to 1000 random poses, beside roboplan",
}
"""Parts that the main job leaves out."""

ROOMS = {
    "batches": "speed.batches",
    "loops": "speed.loops",
    "timing": "speed.timing",
    "torque": "speed.torque",
    "solvers": "speed.solvers",
    "calm": "calm.command",
    "collision": "collision.command",
    "pairs": "collision.pairs",
    "surfaces": "collision.surfaces",
    "arms": "policies.arms",
    "talos": "policies.talos",
    "filter": "policies.filter",
    "reach": "reach.command",
}
"""Modules whose names differ from their parts'."""

SMALLER = {
    "papers": ("--states", "25"),
    "compare": ("--states", "15"),
    "timing": ("--ticks", "500"),
    "torque": ("--ticks", "200"),
    "solvers": ("--repeat", "3", "--others", "4", "--random", "200"),
    "calm": ("--quick",),
}
"""Shorter options of parts in the main job, except with ``--full``: the job ends within five minutes."""

PYTHON = (sys.executable, "-m", "benchmarks")

TOGETHER = ("experiments", "calm", "papers")
"""Parts whose times are CPU time or none, the longest first: they run beside one another, before the others."""


def main(argv: Sequence[str] | None = None) -> int:
    """Run a part or, without a name, the main job; returns 1 if a check fails."""
    given = list(sys.argv[1:] if argv is None else argv)
    if given and given[0] in (*PARTS, *EXTRA):
        return _part(given[0], given[1:])
    listed = "\n".join(
        f"  {name:12} {text}{'' if present(name) else ' (not here)'}" for name, text in (PARTS | EXTRA).items()
    )
    parser = argparse.ArgumentParser(
        prog="python -m benchmarks",
        description="Without a part: the main job, all of them in turn, with a report in Markdown.",
        epilog=f"parts, each with its own --help:\n{listed}",
        formatter_class=argparse.RawDescriptionHelpFormatter,
    )
    _common(parser)
    parser.add_argument("--full", action="store_true", help="each part as it is by itself: over half an hour")
    parser.add_argument("part", nargs="?", metavar="PART", choices=(*PARTS, *EXTRA), help="one of the parts below")
    arguments = parser.parse_args(given)
    if arguments.part is not None:  # options before the part's name
        given.remove(arguments.part)
        return _part(arguments.part, given)
    return _main_job(arguments)


def present(part: str) -> bool:
    """Return true if the part has a module; a folder without ``__init__`` does not count."""
    spec = importlib.util.find_spec(_module(part))
    return spec is not None and spec.origin is not None


def _module(part: str) -> str:
    return f"benchmarks.{ROOMS.get(part, part)}"


def _common(parser: argparse.ArgumentParser) -> None:
    parser.add_argument("--json", type=Path, metavar="FILE", help="write the numbers there")
    parser.add_argument("--quick", action="store_true", help="fewer states and ticks: a look, not a measurement")
    parser.add_argument("--output", type=Path, default=RESULTS, metavar="DIR", help=f"report and figures ({RESULTS})")


def _parser(part: str) -> tuple[argparse.ArgumentParser, ModuleType]:
    module = importlib.import_module(_module(part))
    parser = argparse.ArgumentParser(
        prog=f"python -m benchmarks {part}", description=module.__doc__, conflict_handler="resolve"
    )
    _common(parser)
    module.add_arguments(parser)
    return parser, module


def _part(part: str, argv: Sequence[str]) -> int:
    if not present(part):
        print(f"benchmarks: the part {part!r} is not in this checkout", file=sys.stderr)
        return 2
    parser, module = _parser(part)
    arguments = parser.parse_args(argv)
    arguments.output.mkdir(parents=True, exist_ok=True)
    return int(module.run(arguments))


def _main_job(arguments: argparse.Namespace) -> int:
    """Run all parts and show a line each as they end; list failures, figures and the report's path at the end."""
    importlib.import_module("benchmarks.experiments").choose_renderer()  # before any part imports MuJoCo
    from benchmarks.reports import page, report

    start = time.perf_counter()
    output: Path = arguments.output
    output.mkdir(parents=True, exist_ok=True)
    names = [name for name in PARTS if present(name)]
    for name in PARTS:  # an old section must not pass for a new one
        for kind in ("md", "json", "summary.json", "log"):
            (output / f"{name}.{kind}").unlink(missing_ok=True)
    before = _drawn(output)
    done: dict[str, report.Outcome] = {}
    with page.Page(len(names)) as shown:

        def one(name: str) -> None:
            with shown.part(name):
                began = time.perf_counter()
                status = _child(name, arguments)
                done[name] = report.outcome(output, name, PARTS[name], status, time.perf_counter() - began)
            shown.show(done[name])

        with ThreadPoolExecutor(os.cpu_count()) as pool:
            list(pool.map(one, [name for name in TOGETHER if name in names]))
        if "timing" in names:
            shown.say(page.glance())
        for name in names:
            if name not in done:
                one(name)
    outcomes = [done[name] for name in names]
    path = report.write(output, outcomes, arguments.quick)
    if arguments.json is not None:
        report.gather(output, outcomes, arguments.json)
    made = [figure for figure, age in _drawn(output).items() if age != before.get(figure)]
    shown.finish(outcomes, made, path, time.perf_counter() - start)
    return max((outcome.status for outcome in outcomes), default=0)


def _child(name: str, arguments: argparse.Namespace) -> int:
    """Run a part in its own process, print into its log, return its exit status."""
    output: Path = arguments.output
    smaller = () if arguments.full else SMALLER.get(name, ())
    options = ["--output", str(output), "--json", str(output / f"{name}.json"), *smaller]
    command = [*PYTHON, name, *options, *(["--quick"] if arguments.quick else [])]
    with (output / f"{name}.log").open("w", encoding="utf-8") as log:
        environment = {**os.environ, "COLUMNS": "240"}
        return subprocess.run(command, stdout=log, stderr=log, env=environment, check=False).returncode


def _drawn(output: Path) -> dict[Path, int]:
    return {path: path.stat().st_mtime_ns for kind in ("png", "mp4", "html") for path in output.glob(f"*.{kind}")}


if __name__ == "__main__":
    sys.exit(main())
