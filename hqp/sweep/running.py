"""A sweep from beginning to end: missing cases are run, kept and shown."""

from __future__ import annotations

import datetime
import importlib.metadata
import os
import platform
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from dataclasses import dataclass
from pathlib import Path

from hqp.errors import DeclarationError
from hqp.sweep.cases import Case, Sweep
from hqp.sweep.engines import Cluster, Result, has_ray, serial
from hqp.sweep.store import Store

Advance = Callable[[int, int], None]


@dataclass(frozen=True)
class Summary:
    """Result of a run: cases of the sweep, those found done, those run now, and of these the ones with an error."""

    cases: int
    found: int
    ran: int
    failed: int


def run(
    sweep: Sweep,
    out: str | Path,
    *,
    on: str = "local",
    jobs: int | None = None,
    resume: bool = True,
    retry: bool = False,
    show: bool = True,
) -> Summary:
    """Run the cases of a sweep that ``out`` does not hold yet.

    on: ``serial``, this process; ``local``, Ray on this machine, or serial without Ray; ``auto``, the Ray cluster that
    runs here; ``ray://host:10001``.  jobs: workers at a time.  resume: keep the present results; without it a folder
    with results is refused.  retry: run cases again that ended in an exception.  show: a bar of progress.  Raises
    DeclarationError for another engine, a folder in use without ``resume``, or a missing package.
    """
    with Store(out) as store:
        known = store.done(failed=not retry)
        if not resume and store.done():
            raise DeclarationError("sweep", f"{out} already has results", allowed="resume, or an empty folder")
        missing = list({c.key(sweep.code): c for c in sweep if c.key(sweep.code) not in known}.values())
        store.manifest(_manifest(sweep, on))
        failed = 0
        with _progress(len(sweep), len(sweep) - len(missing), show) as advance:
            for rows in _results(missing, sweep, on, jobs):
                store.add(rows)
                failed += sum(not row["ok"] for row in rows)
                advance(len(rows), failed)
    return Summary(len(sweep), len(sweep) - len(missing), len(missing), failed)


def _results(missing: list[Case], sweep: Sweep, on: str, jobs: int | None) -> Iterator[list[Result]]:
    from hqp.sweep.cases import code_version

    declared = sweep.code != code_version(sweep.function)
    if not missing:
        return
    if on not in ("serial", "local", "auto") and not on.startswith("ray://"):
        raise DeclarationError("sweep", "unknown engine", value=on, allowed="serial, local, auto or ray://host:port")
    if on == "serial" or (on == "local" and (jobs == 1 or not has_ray())):
        yield from serial(missing, sweep.code, declared)
        return
    cluster = Cluster(on, jobs, sweep.folder)
    try:
        yield from cluster.run(missing, sweep.code, declared)
    finally:
        cluster.close()


def _manifest(sweep: Sweep, on: str) -> dict[str, object]:
    packages = ("hqp", "numpy", "pin", "mujoco", "ray", "pyarrow")
    installed = {d.metadata["Name"].lower() for d in importlib.metadata.distributions() if d.metadata["Name"]}
    return {
        "function": sweep.function,
        "code": sweep.code,
        "cases": len(sweep),
        "on": on,
        "machine": f"{platform.machine()}, {os.cpu_count()} processors, {platform.system()} {platform.release()}",
        "python": platform.python_version(),
        "versions": {name: importlib.metadata.version(name) for name in packages if name in installed},
        "started": datetime.datetime.now(datetime.timezone.utc).isoformat(timespec="seconds"),
    }


@contextmanager
def _progress(total: int, found: int, show: bool) -> Iterator[Advance]:
    from rich.progress import (
        BarColumn,
        MofNCompleteColumn,
        Progress,
        TextColumn,
        TimeElapsedColumn,
        TimeRemainingColumn,
    )

    columns = (TextColumn("{task.description}"), BarColumn(), MofNCompleteColumn(), TimeElapsedColumn())
    with Progress(*columns, TimeRemainingColumn(), TextColumn("{task.fields[failed]}"), disable=not show) as bar:
        task = bar.add_task("sweep", total=total, completed=found, failed="")

        def advance(count: int, failed: int) -> None:
            bar.update(task, advance=count, failed=f"{failed} with errors" if failed else "")

        yield advance
