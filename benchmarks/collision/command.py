"""Collision avoidance: blocked hands, exactly integrated and in MuJoCo, and the CPU time of pairs."""

from __future__ import annotations

import argparse
import importlib.util
import json
import math
from collections.abc import Iterable
from dataclasses import asdict
from pathlib import Path
from typing import Any

from benchmarks.collision import timing
from benchmarks.reports import report
from tests.scenes.calm.goals import misses
from tests.scenes.calm.scenes import FORMULATIONS
from tests.scenes.collision import scenes, table

ROBOTS = ("talos", "g1", "panda")
MARGIN = -5e-4
"""Least distance less clearance that a scene may have [m]."""

MARK = "<!-- tables: python -m benchmarks collision --page docs/results/collision.md -->"
"""Mark in the page before the generated tables."""

Record = dict[str, Any]


def add_arguments(parser: argparse.ArgumentParser) -> None:
    """Options of this part."""
    parser.add_argument("--robots", nargs="+", choices=ROBOTS, default=list(ROBOTS), metavar="ROBOT")
    parser.add_argument("--formulations", nargs="+", choices=tuple(FORMULATIONS), default=list(FORMULATIONS))
    parser.add_argument("--page", type=Path, metavar="FILE", help="write the tables there as a page of the docs too")


def run(arguments: argparse.Namespace) -> int:
    """Run, show, write; returns 1 if a pair comes nearer than it may or a table is touched."""
    records = []
    for name in arguments.robots[:1] if arguments.quick else arguments.robots:
        for formulation in arguments.formulations[:1] if arguments.quick else arguments.formulations:
            for title, make in scenes.scenes(name, formulation).items():
                figures: Record = {"robot": name, "formulation": formulation, "scene": title}
                figures |= scenes.run(make(), coal_every=10).figures()
                figures["misses"] = list(misses(formulation, figures))
                records.append(figures)
                report.console.print(f"{name}, {formulation}: {title}")
    failed = [r for r in records if r["scene"] != "inside" and min(r["margin"], r["surface"]) < MARGIN]
    sections = [f"## Blocked\n\n{_scenes(records)}"]
    if importlib.util.find_spec("mujoco") is not None:
        around = {name: table.around(name) for name in table.AHEAD}
        failed += [a for a in around.values() if a.touched]
        sections.append(f"## Around a table in MuJoCo\n\n{_around(around)}")
    times = timing.measure(500 if arguments.quick else 2000)
    sections.append(f"## Time\n\n{_times(times)}")
    text = "\n".join(sections)
    report.section(arguments.output, "collision", text)
    if arguments.page is not None:
        report.into_page(arguments.page, MARK, text)
    if arguments.json is not None:
        arguments.json.write_text(json.dumps([*records, *map(asdict, times)], indent=1))
    return 1 if failed else 0


def _scenes(records: Iterable[Record]) -> str:
    header = (
        "robot", "formulation", "scene", "least distance - clearance [mm]", "of the shapes [mm]", "way out [m/s]",
        "largest change a tick",
        "reversals/s", "acceleration p50 / p99", "levels above", "feet, CoM [mm]", "not OPTIMAL",
    )  # fmt: skip
    rows = []
    for r in records:

        def cell(name: str, text: str, r: Record = r) -> str:
            return f"**{text}**" if name in r["misses"] else text

        acceleration = " / ".join(cell(f"acceleration_{p}", f"{r[f'acceleration_{p}']:.3g}") for p in ("p50", "p99"))
        rows.append((
            r["robot"], r["formulation"], r["scene"], f"{1e3 * r['margin']:.2f}",
            "" if math.isinf(r["surface"]) else f"{1e3 * r['surface']:.2f}",
            f"{r['way_out']:.3f}" if r["margin"] < MARGIN else "", cell("jump", f"{r['jump']:.3g}"),
            cell("reversals", f"{r['reversals']:.0f}"), acceleration, cell("above", f"{r['above']:.1e}"),
            f"{1e3 * r['contact']:.2g}, {1e3 * r['com']:.2g}",
            ", ".join(part for part in r["statuses"].split(", ") if not part.startswith("OPTIMAL")),
        ))  # fmt: skip
    return report.table(header, rows)


def _around(runs: dict[str, table.Around]) -> str:
    header = ("robot", "touched", "nearest [mm]", "hand's error at the end [mm]", "CoM [mm]")
    return report.table(header, [
        (name, ", ".join(map(" - ".join, sorted(a.touched))) or "nothing", f"{1e3 * a.nearest:.1f}",
         f"{1e3 * a.error:.2f}", f"{1e3 * a.com:.2f}" if a.com else "") for name, a in runs.items()
    ])  # fmt: skip


def _times(runs: Iterable[timing.Added]) -> str:
    header = ("pairs", "rows", "near at once", "tick p10 / p50 [us]", "added p10 / p50 [us]")
    return report.table(header, [
        (str(r.pairs), str(r.rows), str(r.near), f"{r.p10:.1f} / {r.p50:.1f}",
         f"{r.added_p10:.1f} / {r.added_p50:.1f}" if r.pairs else "") for r in runs
    ])  # fmt: skip
