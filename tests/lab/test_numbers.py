"""Numbers of benches and comparisons: bad ones are refused by name, from Python and from the command."""

from __future__ import annotations

import math
from pathlib import Path

import pytest

import hqp
from hqp.__main__ import main
from hqp.comparison import compare
from hqp.errors import DeclarationError
from hqp.lab.closed_loop import bench
from hqp.lab.rivals import compare_rivals
from hqp.lab.teleop import compare_teleop

ROOT = Path(__file__).parents[2]
BAD = [0.0, -1.0, math.nan, math.inf]
ALLOWED = dict.fromkeys(("certify_every", "repeats", "rounds"), "a whole number from 1 up")


@pytest.mark.parametrize("value", BAD)
@pytest.mark.parametrize(
    ("call", "name"),
    [
        (bench, "dt"),
        (bench, "seconds"),
        (bench, "certify_every"),
        (compare, "dt"),
        (compare, "repeats"),
        (compare_rivals, "dt"),
        (compare_rivals, "seconds"),
        (compare_rivals, "rounds"),
        (compare_teleop, "dt"),
        (compare_teleop, "seconds"),
    ],
)
def test_numbers_that_are_not_positive_and_finite_are_refused(call: object, name: str, value: float) -> None:
    stack = hqp.serial.load(ROOT / "examples/ur5.toml")
    with pytest.raises(DeclarationError, match=f"{name} .*{ALLOWED.get(name, 'a finite number above 0')}"):
        call(stack, None, **{name: value})  # type: ignore[operator]


@pytest.mark.parametrize("value", BAD)
@pytest.mark.parametrize(
    ("command", "name"),
    [
        ("bench examples/ur5.toml --robot ur5", "dt"),
        ("bench examples/ur5.toml --robot ur5", "seconds"),
        ("compare examples/ur5.toml --robot ur5", "dt"),
        ("export examples/ur5.toml --robot ur5 -o {}/a.hqp", "dt"),
        ("walk --robot g1", "seconds"),
        ("walk --robot g1 --output {}/a.npz", "fps"),
    ],
)
def test_commands_refuse_them(
    command: str, name: str, value: float, tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    words = [str(ROOT / word) if word.startswith("examples/") else word.format(tmp_path) for word in command.split()]
    assert main([*words, f"--{name}={value}"]) == 2
    said = capsys.readouterr().err.splitlines()[-1]
    assert name in said
    assert "allowed" in said
