"""The kernel alone: no allocation, threads, invalid arguments of the binding."""

from __future__ import annotations

import contextlib
import shutil
import subprocess
import sys
import threading
from pathlib import Path
from types import SimpleNamespace
from typing import Any

import numpy as np
import pytest

from hqp import Hierarchy, Rows
from hqp.problem import Selection
from hqp.solvers import lexicographic
from hqp.solvers.lexicographic import Lexicographic
from tests.scenes import problems
from tests.solvers.native.dump import dump

if lexicographic.kernel() == "":
    pytest.skip("built without the native kernel", allow_module_level=True)

import hqp._lexicographic as native
from hqp.solvers.stages import stage_tolerances

SOURCE = Path(__file__).parent / "native" / "drive.cpp"
HEADERS = Path(lexicographic.__file__).parents[1] / "cpp" / "solver"
COMPILER = shutil.which("g++") or shutil.which("clang++") or shutil.which("c++")


def made(n: int, rows: list[int], metric: bool = False) -> native.Workspace:
    options = Lexicographic(max_failed_exchanges=5).options
    return native.Workspace(n, rows, metric, options, True, [False] * len(rows), stage_tolerances())


def hierarchy(n: int, *levels: tuple[Any, Any, Any], metric: object = None, origin: object = None) -> SimpleNamespace:
    """Attributes that the kernel reads from a Hierarchy, unchecked."""
    rows = tuple(SimpleNamespace(A=A, lower=lower, upper=upper) for A, lower, upper in levels)
    return SimpleNamespace(n=n, levels=rows, constraints=0, metric=metric, origin=origin)


@pytest.mark.long
@pytest.mark.skipif(COMPILER is None, reason="needs a C++ compiler")
def test_the_parts_of_the_kernel_alone(tmp_path: Path) -> None:
    """Null space, factorisation, updates, least squares, verdict, searches, row space, secular equation, a stage."""
    program = tmp_path / "parts"
    subprocess.run(
        [str(COMPILER), "-std=c++17", "-O0", "-Wno-psabi", f"-I{HEADERS}", "-DHQP_ISA=generic",
         str(SOURCE.with_name("parts.cpp")), "-o", str(program)],
        check=True,
    )  # fmt: skip
    done = subprocess.run([str(program)], capture_output=True, text=True, check=False)
    assert done.returncode == 0, done.stdout


def test_what_rounding_leaves_of_a_met_level_is_no_doubt() -> None:
    """Coordinates fixed by levels above, as in the first part of a posture, need no certificate."""
    solver = Lexicographic()
    for seed in range(300):
        rng = np.random.default_rng(seed)
        A, x, ones = np.zeros((7, 20)), rng.standard_normal(20), np.ones(10)
        A[:, :7] = rng.standard_normal((7, 7))
        determined = np.append(np.linalg.solve(A[:, :7], A @ x), x[7:10])
        levels = (
            Rows(A, A @ x, A @ x),
            Rows(Selection(np.arange(10), ones), determined, determined),
            Rows(rng.standard_normal((3, 20)), -ones[:3], ones[:3]),
        )
        problem = Hierarchy(n=20, levels=levels, constraints=0)
        bound = solver.workspace(problem.shape).kernel(problem)  # type: ignore[attr-defined]
        outcome, _, _, judged = bound[0]()
        assert (outcome, judged) == (0, 0), seed


@pytest.mark.slow
@pytest.mark.skipif(COMPILER is None or not sys.platform.startswith("linux"), reason="needs a C++ compiler and glibc")
def test_solve_allocates_nothing(tmp_path: Path) -> None:
    program = tmp_path / "drive"
    subprocess.run(
        [str(COMPILER), "-std=c++17", "-O1", "-Wno-psabi", f"-I{HEADERS}", "-DHQP_ISA=generic", "-DCOUNT_ALLOCATIONS",
         str(SOURCE), "-o", str(program)],
        check=True,
    )  # fmt: skip
    for name in ("a38", "b15_38", "c38", "d38", "f62", "rand12", "randint10"):
        data = dump(problems.load(name, 8), tmp_path / name)
        done = subprocess.run([str(program), str(data)], check=True, capture_output=True, text=True).stdout.split()
        assert int(done[done.index("solves") + 1]) > 0
        assert int(done[done.index("allocations") + 1]) == 0, name


def test_workspaces_run_side_by_side_without_the_interpreter_lock() -> None:
    sets = [problems.load("d38", 6), problems.load("c38", 6)]
    alone = [[Lexicographic().solve(problem).x for problem in problem_set] for problem_set in sets]
    found: list[list[np.ndarray]] = [[], []]

    def work(which: int) -> None:
        for _ in range(50):
            found[which] = [Lexicographic().solve(problem).x for problem in sets[which]]

    threads = [threading.Thread(target=work, args=(i,)) for i in range(2)]
    for thread in threads:
        thread.start()
    for thread in threads:
        thread.join()
    for expected, got in zip(alone, found, strict=True):
        for a, b in zip(expected, got, strict=True):
            assert a.tobytes() == b.tobytes()


def test_the_interpreter_goes_on_while_the_kernel_solves() -> None:
    rng = np.random.default_rng(0)
    n, m = 400, 600
    A, b = rng.normal(size=(m, n)), rng.normal(size=m)
    workspace = made(n, [m])
    assert workspace.take(hierarchy(n, (A, b, b.copy())))
    busy, done = threading.Event(), threading.Event()
    refused = ticks = 0

    def solve() -> None:
        busy.set()
        while not done.is_set():
            with contextlib.suppress(RuntimeError):  # a reset may be under way as it starts
                workspace.solve()
                done.set()

    thread = threading.Thread(target=solve)
    thread.start()
    busy.wait()
    while not done.is_set():
        ticks += 1
        try:
            workspace.reset()
        except RuntimeError:  # it is solving in the other thread
            refused += 1
    thread.join()
    assert refused > 10, (refused, ticks)


def _nonsense(rng: np.random.Generator) -> Any:
    choices: list[object] = [
        None, 3, -1, "x", 1.5, float("nan"), [], (), np.zeros(3), np.zeros((3, 3)), np.zeros((2, 5)),
        np.zeros(3, dtype=np.int64), np.full(3, 7, dtype=np.int64), np.full(3, np.nan), np.zeros((0, 3)),
        np.zeros((3, 6))[:, ::2], np.zeros(3, dtype=np.float32), np.full((3, 3), 1e308), np.full(3, -5, dtype=np.int64),
    ]  # fmt: skip
    return choices[rng.integers(len(choices))]


def test_binding_survives_nonsense() -> None:
    rng = np.random.default_rng(1)
    accepted = refused = 0
    for _ in range(4000):
        good: list[Any] = [np.eye(3), np.zeros(3), np.ones(3)]
        for _ in range(int(rng.integers(0, 3))):
            good[rng.integers(3)] = _nonsense(rng)
        if rng.random() < 0.2:
            good[0] = SimpleNamespace(index=_nonsense(rng), scale=_nonsense(rng))
        workspace = made(3, [3], bool(rng.integers(2)))
        extras = [_nonsense(rng) if rng.random() < 0.2 else None for _ in range(2)]
        if not workspace.take(hierarchy(3, tuple(good), metric=extras[0], origin=extras[1])):
            refused += 1
            continue
        outcome = workspace.solve()[0]
        assert 0 <= outcome <= 6
        accepted += 1
        if outcome <= 2:
            assert np.isfinite(workspace.values()).all()
    assert accepted > 300
    assert refused > 300


@pytest.mark.parametrize(
    "arguments",
    [(0, [1], False), (-1, [1], False), (10**9, [1], False), (3, [-1], False), (3, [10**9], False)],
)
def test_workspace_of_impossible_size(arguments: tuple[int, list[int], bool]) -> None:
    with pytest.raises(ValueError, match="lie in"):
        made(*arguments)


def test_workspace_before_and_after_binding() -> None:
    workspace = made(2, [0, 1])
    with pytest.raises(ValueError, match="take a problem"):
        workspace.solve()
    assert not workspace.take(hierarchy(2))
    assert not workspace.take("a string")
    with pytest.raises(TypeError, match="None"):
        workspace.take(None)
    empty, one = np.zeros(0), np.ones(1)
    assert workspace.take(hierarchy(2, (np.zeros((0, 2)), empty, empty), (np.ones((1, 2)), one, one)))
    assert workspace.solve()[0] == 0
    np.testing.assert_allclose(workspace.values()[:2], [0.5, 0.5])


def test_bound_arrays_outlive_their_names() -> None:
    workspace = made(50, [50])
    for value in range(200):
        assert workspace.take(hierarchy(50, (np.eye(50), np.full(50, float(value)), np.full(50, float(value)))))
        np.zeros(2500)  # may reuse the memory of the dropped arrays
        workspace.solve()
        np.testing.assert_array_equal(workspace.values()[:50], float(value))
