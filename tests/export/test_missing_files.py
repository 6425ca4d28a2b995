"""Loaders refuse files that cannot be read, by name."""

from __future__ import annotations

from collections.abc import Callable
from pathlib import Path
from typing import Any

import pytest

import hqp
from hqp.errors import DeclarationError
from hqp.policies import PolicyFilters
from hqp.walking import Walkers

LOADERS: dict[str, Callable[[Path], Any]] = {
    "load": hqp.load,
    "Batch": lambda path: hqp.Batch.load(path, 2),
    "Walkers": lambda path: Walkers.load(path, 2),
    "PolicyFilters": lambda path: PolicyFilters.load(path, 2),
}


@pytest.mark.parametrize("owner", LOADERS)
@pytest.mark.parametrize("kind", ["missing", "folder", "below a file"])
def test_a_file_that_cannot_be_read_is_named(owner: str, kind: str, tmp_path: Path) -> None:
    (tmp_path / "file").touch()
    path = {"missing": tmp_path / "none.hqp", "folder": tmp_path, "below a file": tmp_path / "file" / "plan.hqp"}[kind]
    with pytest.raises(DeclarationError, match=f"{owner}: no file: .*{path}.*a file that export has written"):
        LOADERS[owner](path)


@pytest.mark.parametrize("owner", LOADERS)
@pytest.mark.parametrize("given", [None, 3, b"plan.hqp"])
def test_what_is_no_path_is_refused(owner: str, given: Any) -> None:
    with pytest.raises(DeclarationError, match=f"{owner}: bad path"):
        LOADERS[owner](given)
