"""Subjects of commits: at most 72 characters, a verb in the imperative first."""

from __future__ import annotations

import subprocess
from pathlib import Path

import pytest

SUBJECT = Path(__file__).parents[2] / ".ci" / "subject"

GOOD = (
    "Fix the sign of the drift", "Press toes down", "Pass references by name", "Focus the page", "Bias the start",
    "Bring feet down", "Feed forward the rate", "Speed up rows", "Need a scene for each number", "Document phases",
    "Test levels", "Re-run figures", "Order rows", "Mention units", 'Revert "Words on limits"', "Release 0.3.0",
    "Merge branch 'main'", "Embed the map", "Discuss prices", "Address a warning",
)  # fmt: skip
BAD = (
    "The check has one name", "A face is tried first", "What a tick says", "Levels not met", "Words on limits",
    "Changelog: rows", "docs: calm", "Added a test", "Fixes the drift", "Walking on slopes", "Stages: lengths of rows",
    "C++ loops", "How often", "Below unmet levels", "Elimination in C++", "calm is kept", "Two feet",
)  # fmt: skip


def refused(text: str) -> bool:
    return subprocess.run([SUBJECT], input=text + "\n", text=True, capture_output=True).returncode != 0


@pytest.mark.parametrize("subject", GOOD)
def test_a_verb_passes(subject: str) -> None:
    assert not refused(subject)


@pytest.mark.parametrize("subject", BAD)
def test_anything_else_is_refused(subject: str) -> None:
    assert refused(subject)


def test_length() -> None:
    assert not refused("Fix " + "x" * 68)
    assert refused("Fix " + "x" * 69)


def test_no_subject_passes() -> None:
    """A branch without own commits."""
    assert not refused("")


def test_the_first_line_of_a_file_counts(tmp_path: Path) -> None:
    message = tmp_path / "message"
    message.write_text("Fix the drift\n\nThe sign was wrong: what was added is taken off.\n")
    assert subprocess.run([SUBJECT, message]).returncode == 0
