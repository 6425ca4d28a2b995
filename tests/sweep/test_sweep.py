"""Sweeps in one process: cases, keys, resuming, exceptions as rows, parts that are whole or missing."""

from __future__ import annotations

import sys
from collections.abc import Iterator
from pathlib import Path

import pytest

from hqp import sweep
from hqp.__main__ import main
from hqp.errors import DeclarationError

pytest.importorskip("pyarrow")

CASES = """
function = "toy_function:square"
[fixed]
folder = "{folder}"
[grid]
x = {{stop = 9}}
"""


@pytest.fixture(autouse=True)
def _beside() -> Iterator[None]:
    folder = str(Path(__file__).parent)
    sys.path.insert(0, folder)
    yield
    sys.path.remove(folder)


def toml(folder: Path, text: str = CASES) -> Path:
    path = folder / "cases.toml"
    path.write_text(text.format(folder=folder))
    return path


def calls(folder: Path) -> list[int]:
    return [len((folder / f"call-{x}").read_text()) for x in range(9)]


def run(path: Path, **options: object) -> sweep.Summary:
    return sweep.run(sweep.load(path, trust=True), path.parent / "out", on="serial", show=False, **options)  # type: ignore[arg-type]


def test_every_case_is_a_row_and_an_exception_too(tmp_path: Path) -> None:
    assert run(toml(tmp_path)) == sweep.Summary(cases=9, found=0, ran=9, failed=1)
    rows = sweep.read(tmp_path / "out").to_pylist()
    assert [r["result.square"] for r in rows] == [x * x if x != 7 else None for x in range(9)]
    assert rows[3]["result.list"] == [3.0, 6.0]
    assert [rows[x]["result.mixed"] for x in (3, 4)] == ["3", "even"]  # a column of numbers and text is text
    assert [r["ok"] for r in rows] == [x != 7 for x in range(9)]
    assert rows[7]["error"].startswith("ValueError: seven")
    assert rows[2]["case"] == f'{{"folder":"{tmp_path}","x":2}}'


@pytest.mark.long
def test_the_same_call_again_does_only_what_is_missing(tmp_path: Path) -> None:
    path = toml(tmp_path)
    some = sweep.load(path, trust=True)
    half = sweep.Sweep(some.function, some.arguments[:4])
    sweep.run(half, tmp_path / "out", on="serial", show=False)
    assert run(path) == sweep.Summary(cases=9, found=4, ran=5, failed=1)
    assert run(path) == sweep.Summary(cases=9, found=9, ran=0, failed=0)
    assert calls(tmp_path) == [1] * 9
    assert run(path, retry=True) == sweep.Summary(cases=9, found=8, ran=1, failed=1)
    assert sweep.read(tmp_path / "out").num_rows == 9
    with pytest.raises(DeclarationError, match="already has results"):
        run(path, resume=False)


def test_other_code_and_other_arguments_are_other_results(tmp_path: Path) -> None:
    case = next(iter(sweep.load(toml(tmp_path), trust=True)))
    same = sweep.Case(case.function, dict(reversed(list(case.arguments.items()))))
    assert case.key("a") == same.key("a") != case.key("b")
    assert case.key("a") != sweep.Case(case.function, {**case.arguments, "x": 100}).key("a")
    assert len(sweep.load(toml(tmp_path), trust=True).code) == 16


def test_an_interrupted_run_keeps_whole_parts_only(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    from hqp.sweep import store

    monkeypatch.setattr(store, "EVERY_ROWS", 3)
    path = toml(tmp_path)
    kept = store.Store(tmp_path / "out")
    kept.add([{"key": f"k{i}", "ok": True, "result.a": i} for i in range(4)])  # killed before the rest
    (tmp_path / "out" / ".part-1-x.parquet.99").write_bytes(b"half of a par")  # left by a crash while writing
    assert sweep.read(tmp_path / "out").num_rows == 4
    assert run(path).ran == 9


def test_many_parts_are_merged(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    from hqp.sweep import store

    monkeypatch.setattr(store, "EVERY_ROWS", 1)
    monkeypatch.setattr(store, "MANY_PARTS", 4)
    run(toml(tmp_path))
    assert len(list((tmp_path / "out").glob("part-*"))) == 1
    rows = sweep.read(tmp_path / "out").to_pylist()
    assert [r["result.square"] for r in rows] == [x * x if x != 7 else None for x in range(9)]


def test_two_programs_merge_the_parts_of_one_folder(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    """One program has listed a part that the other merges and removes before it is read, or removes the part itself."""
    from hqp.sweep import store

    run(toml(tmp_path))
    listed, gone = store._parts, tmp_path / "out" / "part-0-gone.parquet"
    answers = iter([[gone]])
    monkeypatch.setattr(store, "_parts", lambda folder: next(answers, listed(folder)))
    assert len(sweep.read(tmp_path / "out").to_pylist()) == 9
    monkeypatch.setattr(store, "MANY_PARTS", 0)
    monkeypatch.setattr(store, "read", lambda folder: (gone.unlink(missing_ok=True), sweep.read(folder))[1])
    with store.Store(tmp_path / "out") as kept:
        gone.write_bytes(next(iter(listed(tmp_path / "out"))).read_bytes())
        assert kept.done()
    assert len(sweep.read(tmp_path / "out").to_pylist()) == 9


def test_grids_multiply_cases(tmp_path: Path) -> None:
    text = """
function = "toy_function:square"
[grid]
x = [1, 2]
step = {{start = 0.0, stop = 0.3, step = 0.1}}
[[case]]
kind = "a"
[[case]]
kind = "b"
"""
    made = sweep.load(toml(tmp_path, text), trust=True)
    assert len(made) == 12
    assert sorted({round(c["step"], 6) for c in made.arguments}) == [0.0, 0.1, 0.2]


@pytest.mark.parametrize(
    ("text", "says"),
    [
        ("[grid]\nx = [1]", "does not name a function"),
        ('function = "toy_function:cube"', "no function 'toy_function:cube'"),
        ('function = "toy_function"', "no function"),
        ('function = "toy_function:square"\n[grid]\nx = 3', "not a range of values"),
        ('function = "toy_function:square"\n[gird]\nx = [3]', "unknown gird"),
        ("function = ", "cannot be read"),
        ('function = "toy_function:square"\n[fixed]\nx = 1979-05-27', "plain JSON"),
        ('function = ":square"', "no function"),
        ('function = "toy_function..a:square"', "no function"),
        ('function = "toy_function:square"\ngrid = 3', "must be tables"),
        ('function = "toy_function:square"\ncase = 3', "must be tables"),
        ('function = "toy_function:square"\n[grid]\nx = {{stop = "a"}}', "not a range of values"),
        ('function = "toy_function:square"\n[grid]\nx = {{stop = 1e300}}', "not a range of values"),
        ('function = "toy_function:square"\n[grid]\nx = {{stop = 100000000}}', "too many cases"),
    ],
)
def test_a_file_that_is_none_is_refused_with_what_is_wrong(tmp_path: Path, text: str, says: str) -> None:
    with pytest.raises(DeclarationError, match=says):
        sweep.load(toml(tmp_path, text), trust=True)


@pytest.mark.parametrize(
    "function",
    ["os:system", "subprocess:run", "toy_function:square", "__main__:run", "hqp.sweep.running:contextmanager"],
)
def test_a_function_from_elsewhere_is_not_called_without_trust(
    tmp_path: Path, function: str, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.chdir(tmp_path)
    path = toml(tmp_path, f'function = "{function}"\n[fixed]\ncommand = "touch {tmp_path}/called"')
    with pytest.raises(DeclarationError, match=r"a sweep file runs code.*--trust"):
        sweep.load(path)


def test_a_package_from_elsewhere_is_not_imported_without_trust(tmp_path: Path) -> None:
    package, cases = tmp_path / "installed" / "package_of_others", tmp_path / "cases"
    package.mkdir(parents=True)
    cases.mkdir()
    (package / "__init__.py").write_text(f"open({str(tmp_path / 'imported')!r}, 'w')\ndef f(): return {{}}")
    path = toml(cases, 'function = "package_of_others:f"')
    sys.path.append(str(package.parent))
    try:
        with pytest.raises(DeclarationError, match="--trust"):
            sweep.load(path)
        assert not (tmp_path / "imported").exists()
        assert len(sweep.load(path, trust=True)) == 1
    finally:
        sys.path.remove(str(package.parent))


def test_functions_of_hqp_and_of_the_folder_need_no_trust(tmp_path: Path) -> None:
    (tmp_path / "beside_its_cases.py").write_text("def f(): return {'a': 1}")
    assert sweep.run(sweep.load(toml(tmp_path, 'function = "beside_its_cases:f"')), tmp_path / "out", on="serial").ran
    assert len(sweep.load(toml(tmp_path, 'function = "hqp.commands.doctor:blas_threads"'))) == 1


def test_the_command(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    path = toml(tmp_path)
    options = ["sweep", str(path), "--out", str(tmp_path / "out"), "--on", "serial", "--trust", "--quiet"]
    assert main(options) == 1  # one case failed
    assert "9 run, 1 with an exception" in capsys.readouterr().out
    assert main(options) == 2
    assert "already has results" in capsys.readouterr().err
    assert main([*options, "--resume"]) == 0
    assert main([*options[:-4], "--resume", "--trust", "--on", "the moon"]) == 0  # nothing is missing: no connection
