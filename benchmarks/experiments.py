"""Both papers' experiments in simulation: CBi balances and draws, Dreamer is pulled up a slope.

Without a name: short versions, without distributions over runs; a name, or --full, selects the full versions.
"""

from __future__ import annotations

import argparse
import ctypes.util
import dataclasses
import importlib
import importlib.metadata
import importlib.util
import json
import os
import sys
import time
from concurrent.futures import ProcessPoolExecutor
from functools import partial
from pathlib import Path
from typing import Any

NAMES = {
    "cbi-cog": "mistry2008.experiments.cog",
    "cbi-figure8": "mistry2008.experiments.figure8",
    "cbi-switch": "mistry2008.experiments.switch",
    "cbi-dynamics": "mistry2008.experiments.dynamics",
    "cbi-statistics": "mistry2008.experiments.statistics",
    "dreamer-slope": "sentis2012.experiments.slope",
    "dreamer-robustness": "sentis2012.experiments.robustness",
    "dreamer-limits": "sentis2012.experiments.pairs",
    "dreamer-statistics": "sentis2012.experiments.statistics",
    "walking": "walking.statistics",
    "standing-pushes": "walking.pushes",
    "stops": "stops",
}
BY_NAME = ("cbi-statistics", "dreamer-statistics", "walking", "standing-pushes", "stops")
"""Omitted in the short versions: distributions and a search, which need many runs."""

SHORT = tuple(name for name in NAMES if name not in BY_NAME)


def add_arguments(parser: argparse.ArgumentParser) -> None:
    """Options of this part."""
    listed = ", ".join(NAMES)
    parser.add_argument("names", nargs="*", metavar="EXPERIMENT", help=f"{listed}; all of them by default")
    parser.add_argument("--solver", default=None, help="any solver of the library; lexicographic where it is native")
    parser.add_argument("--full", action="store_true", help="long runs, sweeps and seeds; implied by a name")
    parser.add_argument("--view", action="store_true", help="watch in MuJoCo's viewer; needs a screen")
    parser.add_argument(
        "--video", action="store_true", help="write an mp4 of each scene; needs imageio-ffmpeg or ffmpeg"
    )
    parser.add_argument("--no-pictures", action="store_true", help="render nothing")
    parser.add_argument("--jobs", type=int, default=os.cpu_count() or 1, metavar="N", help="processes for sweeps")
    group = parser.add_argument_group("dreamer-statistics and walking, which by themselves are whole tables")
    about = "nominal, nominal-imu, nominal-tilt, promised, all, or names of the table of robustness"
    group.add_argument("--cells", nargs="+", metavar="NAME", default=["nominal", "nominal-imu"], help=about)
    group.add_argument(
        "--runs", type=int, default=None, metavar="N", help="a cell; default 300 of promised cells, else 30"
    )
    group.add_argument("--seed", type=int, default=0, metavar="S", help="of the variations between runs, default 0")
    group.add_argument("--kept", type=Path, default=None, metavar="DIR", help="folder of the runs, to resume from")
    group.add_argument("--code", default="", metavar="TEXT", help="version of the code; default: a hash of the sources")
    group.add_argument("--show", action="store_true", help="run nothing: show the table of the runs in --kept")
    group.add_argument(
        "--vouch", nargs="+", default=[], metavar="TEXT", help="other versions whose runs count as well: same behaviour"
    )


def run(arguments: argparse.Namespace) -> int:
    """Run, show, write; returns 1 if a figure misses its limit, 2 for an unknown name."""
    from benchmarks.reports import report

    unknown = [name for name in arguments.names if name not in NAMES]
    if unknown:
        print(f"benchmarks experiments: no {', '.join(unknown)}; there are {', '.join(NAMES)}", file=sys.stderr)
        return 2
    if importlib.util.find_spec("mujoco") is None:
        report.console.print("experiments need MuJoCo: pip install 'hqp\\[mujoco]'", style="bold red")
        return 1
    if (
        arguments.view
        and sys.platform == "linux"
        and not (os.environ.get("DISPLAY") or os.environ.get("WAYLAND_DISPLAY"))
    ):
        print(
            "benchmarks experiments: --view needs a screen, and there is none; --video writes a film", file=sys.stderr
        )
        return 2
    rendering = choose_renderer()
    if arguments.names == ["dreamer-statistics"]:
        from benchmarks.sentis2012.experiments import statistics

        return statistics.command(arguments)
    if arguments.names == ["walking"]:
        from benchmarks.walking import statistics as walks

        return walks.command(arguments)
    full = (arguments.full or bool(arguments.names)) and not arguments.quick
    outcomes = []
    with report.bar() as bar, ProcessPoolExecutor(max(1, arguments.jobs)) as pool:
        setting = _setting(arguments, full)
        if not full and setting.jobs > 1:  # short ones beside one another; in full each has sweeps of its own
            task = bar.add_task("experiments", total=None)
            for outcome in pool.map(partial(_short, arguments, rendering), arguments.names or SHORT):
                outcomes.append(outcome)
                bar.advance(task)
        else:
            for name in arguments.names or (NAMES if full else SHORT):
                task = bar.add_task(name, total=None)
                setting = dataclasses.replace(setting, advance=lambda task=task: bar.advance(task))
                outcomes.append(_one(name, setting, rendering))
                bar.remove_task(task)
    for outcome in outcomes:
        _show(outcome)
    _write(arguments, outcomes, full)
    failed = [f"{o.name}: {f.what}: {f.shown}, asked {f.asked}" for o in outcomes for f in o.missed]
    for text in failed:
        report.console.print(f"{report.MISSED}{text}", style="bold red", markup=False)
    judged = [figure for o in outcomes for figure in o.figures]
    slow = [f"{report.MISSED}{f.what}: {f.shown}, asked {f.asked}" for f in judged if not (f.binding or f.passed)]
    lines = [f"{len(judged)} figures of {len(outcomes)} experiments, {len(failed)} beyond their limits", *slow]
    return report.conclude(arguments.output, "experiments", lines, failed)


def choose_renderer() -> str:
    """Select MuJoCo's renderer without a screen before its import: EGL, else OSMesa.  Returns the name."""
    if "MUJOCO_GL" not in os.environ and sys.platform == "linux" and not os.environ.get("DISPLAY"):
        libraries = {"egl": "EGL", "osmesa": "OSMesa"}
        found = next((name for name, library in libraries.items() if ctypes.util.find_library(library)), "disable")
        os.environ["MUJOCO_GL"] = found
    return os.environ.get("MUJOCO_GL", "")


def _setting(arguments: argparse.Namespace, full: bool) -> Any:
    from benchmarks.lab.setting import Setting
    from hqp import native

    solver = arguments.solver or ("nullspace" if native.missing() else "lexicographic")
    viewer = None
    if arguments.view:
        from benchmarks.lab.viewer import Viewer

        viewer = Viewer()
    return Setting(
        solver=solver,
        full=full,
        output=arguments.output,
        pictures=not arguments.no_pictures,
        video=arguments.video,
        show=viewer,
        jobs=1 if arguments.view else max(1, arguments.jobs),
    )


def _short(arguments: argparse.Namespace, rendering: str, name: str) -> Any:
    """One of the short versions, in a process of its own."""
    return _one(name, dataclasses.replace(_setting(arguments, False), jobs=1), rendering)


def _one(name: str, setting: Any, rendering: str) -> Any:
    from hqp.commands.manifest import commit

    began = time.perf_counter()
    photographer = None
    if setting.pictures and setting.output is not None and rendering != "disable" and setting.show is None:
        from benchmarks.lab.pictures import Photographer

        photographer = Photographer(name, setting)
        setting = dataclasses.replace(setting, show=photographer)
    outcome = importlib.import_module(f"benchmarks.{NAMES[name]}").experiment(setting)
    if photographer is not None:
        photographer.finish(outcome)
    elif rendering == "disable":
        outcome.notes.append("No pictures: neither EGL nor OSMesa here (on Debian: apt install libegl1 or libosmesa6).")
    outcome.parameters |= {
        "solver": str(setting.solver),
        "version": "full" if setting.full else "short",
        "commit": commit(),
        "versions": {p: importlib.metadata.version(p) for p in ("mujoco", "pin", "numpy")},
        "wall time [s]": round(time.perf_counter() - began, 1),
    }
    return outcome


def _show(outcome: Any) -> None:
    from benchmarks.lab.outcome import HEADER
    from benchmarks.reports import report

    console = report.console
    console.print(f"\n[bold]{outcome.name}[/bold]")
    rows = [figure.cells() for figure in outcome.figures]
    widths = [max(len(row[i]) for row in (HEADER, *rows)) for i in range(len(HEADER))]
    for row in (HEADER, *rows):
        text = "  ".join(cell.ljust(width) for cell, width in zip(row, widths, strict=True)).rstrip()
        console.print(text, style="bold red" if row[0] == "FAIL" else None, markup=False, soft_wrap=True)
    for table in outcome.tables:
        console.print(f"\n{table.title}", markup=False)
        widths = [max(len(row[i]) for row in (table.header, *table.rows)) for i in range(len(table.header))]
        for row in (table.header, *table.rows):
            text = "  ".join(cell.ljust(width) for cell, width in zip(row, widths, strict=True)).rstrip()
            console.print(text, style="bold red" if "FAIL" in row else None, markup=False, soft_wrap=True)
    for note in outcome.notes:
        console.print(note, markup=False)


def _write(arguments: argparse.Namespace, outcomes: list[Any], full: bool) -> None:
    from benchmarks.lab.outcome import HEADER, parameter_rows
    from benchmarks.reports import report

    paragraphs = [] if full else ["Short versions; `make experiments` runs the long ones."]
    for outcome in outcomes:
        paragraphs += [f"### {outcome.name}", report.table(HEADER, (figure.cells() for figure in outcome.figures))]
        for table in outcome.tables:
            paragraphs += [f"**{table.title}**", report.table(table.header, table.rows)]
        paragraphs += [f"![{text}]({path.name})" for text, path in outcome.files if path.suffix == ".png"]
        paragraphs += outcome.notes
        paragraphs.append(report.table(("parameter", "value"), parameter_rows(outcome.parameters)))
    report.section(Path(arguments.output), "experiments", *paragraphs)
    if arguments.json is not None:
        arguments.json.parent.mkdir(parents=True, exist_ok=True)
        plain = [outcome.plain() for outcome in outcomes]
        arguments.json.write_text(json.dumps(plain, indent=1, ensure_ascii=False, default=str) + "\n")
