"""Sweeps on Ray: rows as in one process, also if a worker is killed.

Starts a Ray cluster of two workers on this machine, some ten seconds each, and one of two nodes: `make test-sweeps`.
"""

from __future__ import annotations

import os
import secrets
import shutil
import socket
import subprocess
import sys
import tempfile
import time
from collections.abc import Iterator
from pathlib import Path

import pytest

from hqp import sweep

if "HQP_TEST_CLUSTER" not in os.environ:
    pytest.skip("starts Ray: `make test-sweeps`", allow_module_level=True)
pytest.importorskip("ray")

HERE = str(Path(__file__).parent)


@pytest.fixture(autouse=True)
def _beside() -> Iterator[None]:
    sys.path.insert(0, HERE)
    yield
    sys.path.remove(HERE)


def cases(**fixed: object) -> sweep.Sweep:
    return sweep.Sweep("toy_function:square", [{"x": x, **fixed} for x in range(40)], folder=HERE)


def test_the_same_as_in_one_process(tmp_path: Path) -> None:
    here = sweep.run(cases(), tmp_path / "serial", on="serial", show=False)
    there = sweep.run(cases(), tmp_path / "ray", on="local", jobs=2, show=False)
    assert here == there == sweep.Summary(cases=40, found=0, ran=40, failed=1)
    kept = ("key", "ok", "result.square")
    first, second = (
        sorted(([r[k] for k in kept] for r in sweep.read(tmp_path / name).to_pylist()), key=str)
        for name in ("serial", "ray")
    )
    assert first == second


def test_a_killed_worker_s_cases_run_again(tmp_path: Path) -> None:
    marks = tmp_path / "marks"
    marks.mkdir()
    done = sweep.run(cases(folder=str(marks), kill_at=20), tmp_path / "out", on="local", jobs=2, show=False)
    assert done == sweep.Summary(cases=40, found=0, ran=40, failed=1)  # the failed case raised at 7
    assert len((marks / "call-20").read_text()) == 2  # killed once, done in the second attempt
    rows = {r["case.x"]: r for r in sweep.read(tmp_path / "out").to_pylist()}
    assert rows[20]["result.square"] == 400.0


def test_a_case_that_kills_every_worker_is_a_row(tmp_path: Path) -> None:
    marks = tmp_path / "marks"
    marks.mkdir()
    poison = cases(folder=str(marks), kill_at=20, once=False)
    done = sweep.run(poison, tmp_path / "out", on="local", jobs=2, show=False)
    assert done.ran == 40
    assert done.failed == 2
    rows = {r["case.x"]: r for r in sweep.read(tmp_path / "out").to_pylist()}
    assert "its worker died" in rows[20]["error"]
    assert sum(r["ok"] for r in rows.values()) == 38


@pytest.fixture
def two_nodes(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> Iterator[str]:
    """Address of a cluster of two nodes on this machine with a processor each, by the page's two commands."""
    monkeypatch.setenv("RAY_AUTH_MODE", "token")
    monkeypatch.setenv("RAY_AUTH_TOKEN", secrets.token_hex(24))
    ray = str(Path(sys.executable).with_name("ray"))
    address = f"{socket.gethostbyname(socket.gethostname())}:{free_port()}"
    folder = tempfile.mkdtemp(prefix="ray")  # a socket's path has room for a hundred characters
    head = ["--head", f"--port={address.rpartition(':')[2]}", "--include-dashboard=false", f"--temp-dir={folder}"]
    nodes = []
    try:
        for join in (head, [f"--address={address}"]):
            options = ["--num-cpus=1", "--disable-usage-stats", "--block"]
            nodes.append(subprocess.Popen([ray, "start", *join, *options], stdout=subprocess.DEVNULL))
            time.sleep(8.0)
        yield address
    finally:
        for node in reversed(nodes):
            node.terminate()
            node.wait(30)
        shutil.rmtree(folder, ignore_errors=True)


def free_port() -> int:
    with socket.socket() as found:
        found.bind(("", 0))
        return int(found.getsockname()[1])


CASES = """
function = "toy_function:square"
[fixed]
folder = "{folder}"
kill_at = 20
seconds = 0.1
[grid]
x = {{stop = 40}}
"""


def test_a_cluster_of_two_nodes(two_nodes: str, tmp_path: Path) -> None:
    marks = tmp_path / "marks"
    marks.mkdir()
    shutil.copy(Path(HERE) / "toy_function.py", tmp_path)
    (tmp_path / "cases.toml").write_text(CASES.format(folder=marks))
    hqp = str(Path(sys.executable).with_name("hqp"))
    command = [hqp, "sweep", "cases.toml", "--out", "out", "--on", "auto", "--quiet"]
    done = subprocess.run(command, cwd=tmp_path, env={**os.environ, "RAY_ADDRESS": two_nodes}, timeout=120)
    assert done.returncode == 1  # a case raised
    rows = sweep.read(tmp_path / "out").to_pylist()
    assert sorted(row["case.x"] for row in rows) == list(range(40))
    assert [row["case.x"] for row in rows if not row["ok"]] == [7]
    assert len((marks / "call-20").read_text()) >= 2  # its batch runs again, possibly more than once
    assert len({row["host"] for row in rows}) == 2  # both nodes worked
