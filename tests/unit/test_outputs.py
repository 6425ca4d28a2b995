"""Files that commands write: a path that cannot be written is refused before the work begins."""

from __future__ import annotations

import os
from pathlib import Path

import pytest

from hqp.__main__ import main

ROOT = Path(__file__).parents[2]

OPTIONS = {
    "bench nothing.toml --robot nothing": ("--html", "--md", "--json", "--parquet"),
    "export nothing.toml --robot nothing": ("-o", "--output"),
    "retarget nothing.bvh --robot nothing": ("-o", "--output", "--html"),
    "walk --robot nothing": ("--output",),
    "capsules nothing": ("--output",),
}
"""Options that name a file to write, by a command whose work fails at once."""

CASES = [(command, option) for command, options in OPTIONS.items() for option in options]


@pytest.mark.parametrize(("command", "option"), CASES)
def test_a_path_that_cannot_be_written_is_refused_first(
    command: str, option: str, tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    kept = tmp_path / "kept.npz"
    kept.write_text("of another run")
    paths = {tmp_path / "none" / "a.npz": "no folder", tmp_path: "is a folder"}
    if os.geteuid():
        kept.chmod(0o400)
        paths[kept] = "no permission"
    for path, reason in paths.items():
        with pytest.raises(SystemExit) as stopped:
            main([*command.split(), option, str(path)])
        assert stopped.value.code == 2
        last = capsys.readouterr().err.splitlines()[-1]
        assert reason in last
        assert str(path.parent) in last
    assert kept.read_text() == "of another run"


@pytest.mark.long
def test_results_are_written_if_the_older_run_cannot_be_read(
    tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    files = [tmp_path / f"a.{kind}" for kind in ("json", "md", "parquet", "html")]
    named = [word for path in files for word in (f"--{path.suffix[1:]}", str(path))]
    stack = ["bench", str(ROOT / "examples/ur5.toml"), "--robot", "ur5", "--seconds", "0.05"]
    assert main([*stack, *named, "--against", str(tmp_path / "none")]) == 2
    assert "against: not a bench's JSON" in capsys.readouterr().err
    assert all(path.stat().st_size > 0 for path in files)


def test_a_file_that_is_missing_is_named(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    export = ["export", str(ROOT / "examples/ur5.toml"), "--robot", "ur5", "-o", str(tmp_path / "a.hqp")]
    assert main([*export, "--key", str(tmp_path / "none")]) == 2
    assert capsys.readouterr().err.splitlines()[-1] == f"hqp: {tmp_path}/none: No such file or directory"
