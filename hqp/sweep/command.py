"""The command `hqp sweep`."""

from __future__ import annotations

import argparse
from pathlib import Path

DESCRIPTION = """Call one function at many cases and keep what it returns, one row a case, in Parquet files.
Run the command again to compute missing cases. CASES.toml is a program: its function is imported and called.
Functions of hqp and of modules in the file's folder run as they are, any other only with --trust."""


def add_arguments(parser: argparse.ArgumentParser) -> None:
    """Options of the command."""
    parser.add_argument(
        "cases", metavar="CASES.toml", type=Path, help="function, fixed arguments, grid; see docs/sweeps.md"
    )
    where = "serial, local (Ray on this machine), auto (the Ray cluster that runs here), or ray://host:10001"
    parser.add_argument("--on", default="local", metavar="WHERE", help=f"{where}; default: local")
    parser.add_argument("--out", required=True, metavar="DIR", type=Path, help="folder of the results")
    parser.add_argument("--resume", action="store_true", help="continue in a folder with results")
    parser.add_argument("--retry", action="store_true", help="rerun cases that ended in an exception")
    parser.add_argument(
        "--jobs", type=int, default=None, metavar="N", help="workers at a time; default: all processors"
    )
    parser.add_argument(
        "--code", default="", metavar="TEXT", help="version of the code; default: a hash of the sources"
    )
    parser.add_argument("--trust", action="store_true", help="allow functions of any package")
    parser.add_argument("--quiet", action="store_true", help="no progress bar")


def execute(arguments: argparse.Namespace) -> int:
    """Run it; returns 1 if a case of this run ended in an exception."""
    import dataclasses

    from hqp.sweep import load, run

    sweep = load(arguments.cases, trust=arguments.trust)
    if arguments.code:
        sweep = dataclasses.replace(sweep, code=arguments.code)
    done = run(
        sweep,
        arguments.out,
        on=arguments.on,
        jobs=arguments.jobs,
        resume=arguments.resume,
        retry=arguments.retry,
        show=not arguments.quiet,
    )
    print(f"{done.cases} cases: {done.found} found in {arguments.out}, {done.ran} run, {done.failed} with an exception")
    return int(done.failed > 0)
