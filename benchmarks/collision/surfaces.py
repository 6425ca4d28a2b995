"""Capsules around the links of every robot that ships with some, and of generated robots: containment, distance."""

from __future__ import annotations

import argparse
import json
import tempfile
import warnings
from collections.abc import Iterator
from dataclasses import asdict
from pathlib import Path

import hqp
from benchmarks.reports import report
from hqp.robots import capsule_files, capsules
from tests.scenes.collision.surfaces import SHAPES, Around, arm, around

OUTSIDE = 1e-6
"""Points of a surface that may lie outside its capsules by this [m]."""
MARK, END = "<!-- tables: python -m benchmarks surfaces --page docs/results/collision.md -->", "<!-- end -->"
"""Marks in the page around the generated table."""


def add_arguments(parser: argparse.ArgumentParser) -> None:
    """Options of this part."""
    parser.add_argument(
        "--all", action="store_true", help="fit robots without shipped capsules too: a quarter of an hour"
    )
    parser.add_argument("--page", type=Path, metavar="FILE", help="write the table there, in a page of the docs, too")


def run(arguments: argparse.Namespace) -> int:
    """Measure, show, write; returns 1 if a surface leaves its capsules or capsules stand too far off."""
    found = dict(_measured(1000 if arguments.quick else 10_000, arguments.all))
    text = _table(found)
    report.section(arguments.output, "surfaces", text)
    if arguments.page is not None:
        report.into_page(arguments.page, MARK, text, END)
    if arguments.json is not None:
        arguments.json.write_text(
            json.dumps({name: list(map(asdict, links)) for name, links in found.items()}, indent=1)
        )
    return int(any(link.outside > OUTSIDE or link.away > link.allowed for links in found.values() for link in links))


def _measured(count: int, every: bool) -> Iterator[tuple[str, list[Around]]]:
    """Links of each robot by its name, points a shape given."""
    shipped = {path.stem for path in capsule_files.FOLDER.glob("*.toml")}
    for name in hqp.robots.names():
        if not every and name not in shipped:
            continue
        with warnings.catch_warnings():
            warnings.simplefilter("ignore")
            robot = hqp.robots.load(name)
            links = around(robot, robot.capsules, count)
        if links:
            yield name, links
            report.console.print(name)
    with tempfile.TemporaryDirectory() as folder:
        for kind, shape in SHAPES.items():
            robot = arm(Path(folder), shape)
            yield f"generated: {kind}", around(robot, capsules.fitted(robot), count)


def _table(found: dict[str, list[Around]]) -> str:
    header = (
        "robot",
        "links",
        "capsules",
        "outside [mm]",
        "off the hull, mean [mm]",
        "farthest link",
        "its mean, allowed [mm]",
    )
    rows = []
    for name, links in found.items():
        worst = max(links, key=lambda link: link.away / link.allowed)
        least = max(link.outside for link in links)
        rows.append((
            name, str(len(links)), str(sum(link.capsules for link in links)),
            "none" if least <= OUTSIDE else f"**{1e3 * least:.3f}**",
            f"{1e3 * sum(link.away for link in links) / len(links):.1f}", worst.link,
            f"{1e3 * worst.away:.1f}, {1e3 * worst.allowed:.1f}",
        ))  # fmt: skip
    return report.table(header, rows)
