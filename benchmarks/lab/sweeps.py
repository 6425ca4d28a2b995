"""Tables over many runs: make the missing ones by a sweep that can be resumed, read, show and write them."""

from __future__ import annotations

from collections.abc import Container, Iterable, Mapping, Sequence
from pathlib import Path
from typing import Any

from benchmarks.reports import report
from benchmarks.reports.checks import write_json
from hqp import sweep

from .outcome import Table


def rows(
    cases: sweep.Sweep,
    kept: Path,
    *,
    jobs: int | None,
    only_read: bool = False,
    vouch: Sequence[str] = (),
    show: bool = True,
) -> list[Mapping[str, Any]]:
    """The latest row without an exception of each case that has one, in order.

    kept: folder of the runs.  only_read: make none, and take rows of every version of the code.  vouch: versions whose
    rows count as those of this one.  show: progress.
    """
    codes = {cases.code, *vouch}
    if only_read:
        codes |= {row["code"] for row in sweep.read(kept).to_pylist()}
    else:
        done = by_case(sweep.read(kept).to_pylist(), codes)
        missing = [case.arguments for case in cases if case.text not in done]
        on = "serial" if jobs == 1 else "local"
        sweep.run(sweep.Sweep(cases.function, missing, cases.code), kept, on=on, jobs=jobs, show=show)
    found = by_case(sweep.read(kept).to_pylist(), codes)
    return [found[case.text] for case in cases if case.text in found]


def by_case(rows: Sequence[Mapping[str, Any]], codes: Container[str]) -> dict[str, Mapping[str, Any]]:
    """The latest row without an exception of every case, of those made by one of the versions ``codes``."""
    found = sorted((row for row in rows if row["ok"] and row["code"] in codes), key=lambda row: row["finished"])
    return {row["case"]: row for row in found}


def plain(row: Mapping[str, Any]) -> dict[str, Any]:
    """Arguments and figures of a row by name."""
    return {key.partition(".")[2]: value for key, value in row.items() if "." in key}


def show(tables: Iterable[Table], data: object, path: Path | None) -> None:
    """Print tables and write their data as JSON, infinity as null."""
    for made in tables:
        report.console.print(report.table(made.header, made.rows), markup=False, soft_wrap=True)
    if path is not None:
        write_json(path, data)
