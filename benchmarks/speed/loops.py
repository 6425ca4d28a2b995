"""Replay of recorded loops of five robots in C++, from plan files: equal bits, allocations, times of ticks."""

from __future__ import annotations

import argparse
import subprocess
import sys
from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path

import hqp
from benchmarks.reports import machine, report

ROOT = Path(__file__).parents[2]
ROBOTS = ("ur5", "cbi", "talos", "g1", "dreamer")
FORMULATIONS = ("velocity", "acceleration", "torque")
PAGE = "--page docs/results/batches.md -->"
COMMAND = "<!-- table: python -m benchmarks loops --formulations velocity"
ALONE = (
    f"{COMMAND} --ticks 100000 {PAGE}",
    "<!-- end of loops -->",
)
"""Marks before and after the table in its page."""
BESIDE = (
    f"{COMMAND} --ticks 20000 --busy 4 {PAGE}",
    "<!-- end of loops beside others -->",
)
"""Marks of the table beside busy processes."""


def add_arguments(parser: argparse.ArgumentParser) -> None:
    """Options of this part."""
    parser.add_argument("--robots", nargs="+", choices=ROBOTS, default=list(ROBOTS), metavar="ROBOT")
    parser.add_argument("--formulations", nargs="+", choices=FORMULATIONS, default=list(FORMULATIONS), metavar="NAME")
    parser.add_argument("--ticks", type=int, default=10_000, metavar="N", help="of each loop in C++ (10000)")
    parser.add_argument(
        "--recorded", type=int, default=100_000, metavar="N", help="of these, in Python (100000 at most)"
    )
    parser.add_argument("--folder", type=Path, default=ROOT / "build/loops", help="for recordings, which are large")
    parser.add_argument("--busy", type=int, default=0, metavar="N", help="processes that compute beside them (0)")
    parser.add_argument("--page", type=Path, metavar="FILE", help="write the table into this page")


def run(arguments: argparse.Namespace) -> int:
    """Record, build, run, show, write; returns 1 if a number, a status or an allocation differs."""
    ticks = 1000 if arguments.quick else arguments.ticks
    recorded = min(arguments.recorded, ticks)
    arguments.folder.mkdir(parents=True, exist_ok=True)
    replay = build(arguments.folder / "replay")
    head, failed = "", 0
    rows: list[str] = []
    for robot in arguments.robots:
        for formulation in arguments.formulations:
            plan = record(robot, formulation, recorded, arguments.folder)
            command = [str(replay), "0", "--rounds", str(max(1, ticks // recorded)), str(plan)]
            with beside(arguments.busy):
                found = subprocess.run(command, capture_output=True, text=True, check=False)
            plan.with_suffix(".ticks").unlink()
            *head_lines, row = found.stdout.splitlines() or [f"| {plan.name} | {found.stderr.strip()} |"]
            head, failed = "\n".join(head_lines) or head, failed + found.returncode
            rows.append(row)
            print(row, flush=True)
    text = "\n".join((head, *rows)) + f"\n\n{machine.line()}\n"
    report.section(arguments.output, "loops", text)
    if arguments.page is not None:
        mark, end = BESIDE if arguments.busy else ALONE
        report.into_page(arguments.page, mark, text, end)
    return int(failed > 0)


@contextmanager
def beside(count: int) -> Iterator[None]:
    """Run ``count`` processes that compute without pause."""
    others = [subprocess.Popen([sys.executable, "-c", "while True: pass"]) for _ in range(count)]
    try:
        yield
    finally:
        for other in others:
            other.kill()
            other.wait()


def record(robot: str, formulation: str, ticks: int, folder: Path) -> Path:
    """Write the plan of a loop and its ticks."""
    module = "tests.export.native.record"
    command = [sys.executable, "-m", module, robot, "--formulations", formulation, "--ticks", str(ticks)]
    subprocess.run([*command, "--folder", str(folder.resolve())], check=True, stdout=sys.stderr, cwd=ROOT)
    return folder / f"{robot}-{formulation}.hqp"


def build(folder: Path) -> Path:
    """Build the program that replays recordings, with CMake."""
    source = ROOT / "tests/export/native"
    cmake = Path(hqp.__file__).parent / "cmake"
    for command in (
        ["cmake", "-S", str(source), "-B", str(folder), f"-Dhqp_DIR={cmake}"],
        ["cmake", "--build", str(folder), "--target", "replay"],
    ):
        subprocess.run(command, check=True, stdout=sys.stderr)
    return folder / "replay"
