"""Progress of long work: printed text, times of printing, quality of the estimate."""

from __future__ import annotations

import io
import re
import sys

import numpy as np
import pytest

from hqp import progress


class Terminal(io.StringIO):
    """Standard error of a terminal."""

    def isatty(self) -> bool:
        return True


class Clock:
    """A clock that work moves on."""

    now = 100.0

    def monotonic(self) -> float:
        return self.now


def shown(
    monkeypatch: pytest.MonkeyPatch, error: io.StringIO, costs: list[float], known: bool
) -> list[tuple[int, str]]:
    """Lines written while each item takes its cost [s]; with the number of items done by then."""
    clock = Clock()
    monkeypatch.setattr(progress, "time", clock)
    monkeypatch.setattr(sys, "stderr", error)
    lines, seen, yielded = [], 0, []
    for k, cost in enumerate(progress.tracked(costs, "work", (lambda cost: cost) if known else (lambda cost: 1.0))):
        if text := error.getvalue()[seen:]:
            lines.append((k, text))
            seen += len(text)
        yielded.append(cost)
        clock.now += cost
    assert yielded == costs
    return lines


@pytest.mark.parametrize("seed", range(8))
def test_the_time_left_is_that_which_the_work_takes(monkeypatch: pytest.MonkeyPatch, seed: int) -> None:
    rng, error = np.random.default_rng(seed), Terminal()
    costs = rng.uniform(0.05, 3.0, int(rng.integers(3, 60))).tolist()
    lines = shown(monkeypatch, error, costs, known=True)
    assert bool(lines) == any(sum(costs[:k]) >= progress.PATIENCE for k in range(len(costs)))
    for done, text in lines:
        assert sum(costs[:done]) >= progress.PATIENCE
        (left,) = re.findall(r"about (\d+) s left", text)
        assert float(left) == pytest.approx(sum(costs[done:]), abs=0.51)
    assert error.getvalue().endswith(" \r") or not lines  # the line is erased


def test_short_work_and_files_show_nothing(monkeypatch: pytest.MonkeyPatch) -> None:
    for error, costs in ((Terminal(), [0.3] * 6), (io.StringIO(), [3.0] * 6)):
        assert shown(monkeypatch, error, costs, known=False) == []
        assert error.getvalue() == ""


def test_what_ends_early_erases_its_line(monkeypatch: pytest.MonkeyPatch) -> None:
    error, clock = Terminal(), Clock()
    monkeypatch.setattr(progress, "time", clock)
    monkeypatch.setattr(sys, "stderr", error)

    def work() -> None:
        for k in progress.tracked(range(10), "work"):
            clock.now += 1.5
            if k == 4:
                raise KeyError(k)

    with pytest.raises(KeyError):
        work()
    error_text = error.getvalue()
    assert "work: 40 %, about 9 s left" in error_text
    assert error_text.endswith("\r")
