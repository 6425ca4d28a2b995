"""The tables of the experiments' pages from committed runs: ``docs/data`` holds the runs, this writes their tables.

A table stands in a page between ``<!-- table: NAME -->`` and ``<!-- end -->``; all else in a page is written by hand.
"""

from __future__ import annotations

import argparse
import json
import math
import re
import sys
from collections.abc import Mapping, Sequence
from pathlib import Path
from typing import Any

from benchmarks.lab.outcome import HEADER, Figure, Table, table
from benchmarks.reports.checks import finite
from hqp.markdown import table as markdown

DOCS = Path(__file__).parents[1] / "docs"
PAGES = ("results/dreamer.md", "results/cbi.md", "results/walking.md", "results/stops.md")
DATA = DOCS / "data"

MARKED = re.compile(r"(?<=<!-- table: )(?P<name>[^>]+?)(?P<open> -->\n)(?P<body>.*?)(?P<close><!-- end -->)", re.DOTALL)

BY_TILT = {
    "0 deg": "slope, 0 deg, rollers, IMU only",
    "3 deg": "slope, 3 deg, rollers, IMU only",
    "5 deg": "slope, 5 deg, rollers, IMU only",
    "7 deg": "nominal-tilt",
    "8 deg": "slope, 8 deg, rollers, IMU only",
}
"""Cells whose controller knows only the tilt of the ground, by slope."""

TOLD_BY_TILT = ("CoM error, way up", "CoM error, way back", "travel", "pull, max", "hand error under pull")


def add_arguments(parser: argparse.ArgumentParser) -> None:
    """Options of this part."""
    parser.add_argument("--check", action="store_true", help="write nothing; 1 if a page is not that of the runs")


def run(arguments: argparse.Namespace) -> int:
    """Write the tables of all pages; 1 with ``--check`` if one would change."""
    stale = []
    for path, found in files().items():
        if found != path.read_text():
            stale.append(path.name)
            if not arguments.check:
                path.write_text(found)
    if stale:
        print(f"{'not that of the runs' if arguments.check else 'written'}: {', '.join(stale)}", file=sys.stderr)
    return int(bool(stale) and arguments.check)


def files() -> dict[Path, str]:
    """Generate the text of every page and of the file of Dreamer's percentiles."""
    made = tables()
    found = {DOCS / name: renewed((DOCS / name).read_text(), made) for name in PAGES}
    return {**found, DATA / "dreamer-statistics.json": json.dumps(_percentiles(), indent=1) + "\n"}


def renewed(page: str, made: Mapping[str, str]) -> str:
    """Replace the tables of a page.  Raises KeyError for a table without a generator."""

    def filled(found: re.Match[str]) -> str:
        return f"{found['name']}{found['open']}\n{made[found['name']]}\n\n{found['close']}"

    return MARKED.sub(filled, page)


def tables() -> dict[str, str]:
    """All tables by name, as Markdown."""
    made = {**_dreamer(), **_cbi(), **_walking()}
    for path in sorted((DATA / "experiments").glob("*.json")):
        (outcome,) = json.loads(path.read_text())
        made |= _experiment(outcome)
    return made


def _text(made: Table) -> str:
    return markdown(made.header, made.rows)


def _experiment(outcome: Mapping[str, Any]) -> dict[str, str]:
    """Figures of an experiment by its name, tables by ``NAME: TITLE``, command and versions by ``NAME: made``."""
    name, parameters = outcome["experiment"], outcome["parameters"]
    figures = [_figure(figure) for figure in outcome["figures"]]
    found = {name: _of_today(HEADER, [figure.cells() for figure in figures])}
    for made in outcome["tables"]:
        found[f"{name}: {made['title']}"] = _of_today(made["header"], made["rows"])
    versions = parameters["versions"]
    found[f"{name}: made"] = (
        f"`python -m benchmarks experiments {name}`, {parameters['version']} version, solver "
        f"`{parameters['solver']}`, MuJoCo {versions['mujoco']}, Pinocchio {versions['pin']}, "
        f"NumPy {versions['numpy']}."
    )
    return found


def _of_today(header: Sequence[str], rows: Sequence[Sequence[str]]) -> str:
    """Table without the columns of earlier studies."""
    kept = [k for k, title in enumerate(header) if "earlier" not in title]
    return markdown([header[k] for k in kept], [[row[k] for k in kept] for row in rows])


def _figure(plain: Mapping[str, Any]) -> Figure:
    known = {name: plain[name] for name in ("what", "measured", "unit", "before", "binding")}
    low, high = (plain["low"], plain["high"])
    return Figure(**known, low=-math.inf if low is None else low, high=math.inf if high is None else high)


def _runs() -> list[Mapping[str, Any]]:
    """Dreamer's runs, the latest of every case."""
    from benchmarks.lab import sweeps
    from hqp import sweep

    rows = sweep.read(DATA / "dreamer-statistics").to_pylist()
    return list(sweeps.by_case(rows, {row["code"] for row in rows}).values())


def _percentiles() -> Any:
    from benchmarks.sentis2012.experiments import statistics

    made = statistics.runs_of(_runs(), list(statistics.registry()))
    return finite([statistics.summary(name, own) for name, own in made.items()])


def _walking() -> dict[str, str]:
    """Tables of walks and of the robots that walked."""
    from benchmarks.walking import robots, statistics

    made = {}
    for name, lines in (("bipeds", robots.lines), ("walks", statistics.lines)):
        found = lines(json.loads((DATA / f"{name}.json").read_text()))
        made[name] = markdown(found.header, found.rows)
    return made


def _dreamer() -> dict[str, str]:
    from benchmarks.sentis2012.experiments import statistics
    from benchmarks.sentis2012.experiments.promised import compared

    latest = _runs()
    made = statistics.runs_of(latest, list(statistics.registry()))
    lines = {name: statistics.summary(name, own) for name, own in made.items()}
    nominal = [name for name in made if statistics.registry()[name].group == "nominal"]
    one = [name for name in made if statistics.registry()[name].group == "one controller"]
    promised = [name for name in statistics.PROMISED if name in made]
    observed = [name for name in made if name not in (*promised, *nominal, *one)]
    by_tilt = compared({slope: made[name] for slope, name in BY_TILT.items() if name in made})
    by_tilt = table("", by_tilt.header, [row for row in by_tilt.rows if row[0].startswith(TOLD_BY_TILT)])

    def shown(names: Sequence[str], of: Sequence[str] = ("median", "worst")) -> str:
        return _text(statistics.shown([lines[name] for name in names], of))

    return {
        "promised": shown(promised, tuple(statistics.SPREAD)),
        "observed": shown(observed),
        "one controller": shown(one).replace("| one controller, ", "| "),
        "nominal figures": _text(compared({name: made[name] for name in nominal})),
        "by tilt": _text(by_tilt),
    }


def _cbi() -> dict[str, str]:
    from benchmarks.mistry2008.experiments import statistics
    from hqp import sweep

    rows = [row for row in sweep.read(DATA / "cbi-statistics").to_pylist() if row["ok"]]
    plain = [{name.partition(".")[2]: value for name, value in row.items() if "." in name} for row in rows]
    return {"cbi runs": _text(statistics.shown(plain))}
