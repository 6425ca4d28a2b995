"""Closed loops that provoke restless commands, and goals that the controller must still reach.

Targets out of reach, at the edge, blocked, contradictory, nearly lost: exact and priced levels side by side.
"""

from __future__ import annotations

import argparse
import json
import re
from pathlib import Path

from benchmarks.calm.parts import PARTS
from benchmarks.reports import report
from tests.scenes.calm.robots import ROBOTS
from tests.scenes.calm.scenes import FORMULATIONS
from tests.scenes.calm.variants import VARIANTS

QUICK = ("scenes", "continuity", "straight")
"""Parts of a quick run."""

PAGE = Path(__file__).parents[2] / "docs" / "results" / "calm.md"
HEAD = (
    "# Calm: results\n\nWritten by `python -m benchmarks calm --page`; [calm](../calm.md) defines the measures and "
    "their reasons.\n"
)


def add_arguments(parser: argparse.ArgumentParser) -> None:
    """Options of this part."""
    parser.add_argument("--parts", nargs="+", choices=tuple(PARTS), metavar="PART", help=f"of {', '.join(PARTS)}")
    parser.add_argument("--robots", nargs="+", choices=(*ROBOTS, "xarm7", "kinova"), metavar="ROBOT")
    parser.add_argument("--formulations", nargs="+", choices=tuple(FORMULATIONS), default=list(FORMULATIONS))
    parser.add_argument("--scenes", nargs="+", metavar="SCENE", help="names of scenes, all by default")
    parser.add_argument("--variants", nargs="+", choices=tuple(VARIANTS), default=["exact", "priced"])
    parser.add_argument("--solver", default="", help="of priced levels: a name, or module:Class(option=number)")
    parser.add_argument("--ticks", type=int, default=1500, metavar="N", help="of 2 ms, judged over the second half")
    parser.add_argument("--count", type=int, default=1000, metavar="N", help="pairs of a family; goals of all robots")
    parser.add_argument("--drawn", type=int, default=40, metavar="N", help="loops drawn at random of each formulation")
    parser.add_argument("--seed", type=int, default=0, metavar="K", help="of the first of them")
    parser.add_argument("--page", action="store_true", help=f"write these parts into docs/results/{PAGE.name}, too")


def run(arguments: argparse.Namespace) -> int:
    """Run, show, write; returns 1 if priced levels break a promise; missed goals of calm are reported."""
    sections: dict[str, str] = {}
    records, missed, broken = {}, list[str](), list[str]()
    for name in arguments.parts or (QUICK if arguments.quick else PARTS):
        part = PARTS[name]
        outcome = part.measure(arguments)
        told = "".join(f"\n- {line}" for line in (*outcome.broken, *outcome.missed)) or " none."
        sections[name] = f"## {part.title}\n\n{part.introduction}\n\n{outcome.text}\nMissed:{told}\n"
        report.console.print(sections[name], markup=False)
        records[name] = outcome.records
        missed += outcome.missed
        broken += outcome.broken
        if arguments.page:  # part by part: the last ones take long
            _write(sections)
        if arguments.json is not None:
            arguments.json.write_text(json.dumps(records, indent=1))
    report.section(arguments.output, "calm", "\n".join(sections.values()))
    return report.conclude(arguments.output, "calm", [f"{report.MISSED}{line}" for line in missed], broken)


def _write(sections: dict[str, str]) -> None:
    """The page with these parts in place of its old ones."""
    text = PAGE.read_text() if PAGE.exists() else HEAD
    found = dict(re.findall(r"<!-- part: (\w+) -->\n\n(.*?)(?=\n<!-- part: |\Z)", text, re.DOTALL)) | sections
    written = [f"\n<!-- part: {name} -->\n\n{found[name].rstrip()}\n" for name in PARTS if name in found]
    PAGE.write_text(HEAD + "".join(written))
