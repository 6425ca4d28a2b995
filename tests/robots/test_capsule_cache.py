"""Cache fitted capsules by the surface that they were fitted to; fit again if the cached file is damaged."""

from __future__ import annotations

import json
import sys
import warnings
from pathlib import Path
from typing import Any

import numpy as np
import pytest

import hqp.robots
from hqp import user_cache
from hqp.errors import ModelWarning
from hqp.robots import capsules
from tests.damage.kinds import HAND

pytest.importorskip("mujoco")


@pytest.fixture
def fits(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> list[int]:
    """Return the corners of each fitted surface, with an empty cache and a ball as an instant fit."""
    seen: list[int] = []

    def counted(part: Any) -> Any:
        points = part.points()
        seen.append(len(points))
        centre = points.mean(axis=0)
        return [(centre, centre, float(np.linalg.norm(points - centre, axis=1).max()))]

    monkeypatch.setattr(capsules, "fit", counted)
    monkeypatch.setenv("XDG_CACHE_HOME", str(tmp_path / "cache"))
    return seen


def load(folder: Path, text: str = HAND) -> Any:
    path = folder / "hand.xml"
    path.write_text(text)
    with warnings.catch_warnings():
        warnings.simplefilter("ignore")
        return hqp.robots.load(path)


def kept(folder: Path) -> Path:
    (path,) = (folder / "cache" / "hqp" / "capsules").iterdir()
    return path


def test_capsules_are_fitted_once(tmp_path: Path, fits: list[int]) -> None:
    with pytest.warns(ModelWarning, match="fitting capsules.*cached in"):
        first = load(tmp_path).capsules
    assert len(fits) == len({c.body for c in first}) == 4
    with warnings.catch_warnings():
        warnings.simplefilter("error")
        assert load(tmp_path).capsules == first
    assert len(fits) == 4
    assert first == capsules.fitted(load(tmp_path))


def test_copies_share_the_fit_and_hold_no_meshes(tmp_path: Path, fits: list[int]) -> None:
    robot = load(tmp_path)
    copy = robot.copy()
    with pytest.warns(ModelWarning, match="fitting capsules"):
        found = copy.capsules
    assert robot.capsules is robot.copy().capsules is found
    assert len(fits) == 4
    assert robot._geometry is copy._geometry is None
    assert robot.geometry.ngeoms == robot.copy().geometry.ngeoms > 0


def test_another_shape_is_another_model(tmp_path: Path, fits: list[int]) -> None:
    with pytest.warns(ModelWarning, match="fitting capsules"):
        small = load(tmp_path).capsules
    with pytest.warns(ModelWarning, match="fitting capsules"):
        large = load(tmp_path, HAND.replace('size=".01 .01 .02"', 'size=".02 .02 .02"')).capsules
    assert small != large
    assert len(list((tmp_path / "cache" / "hqp" / "capsules").iterdir())) == 2


@pytest.mark.parametrize("damage", ["cut", "digit", "text", "bytes", "empty", "other", "nan"])
def test_a_damaged_file_is_fitted_anew(tmp_path: Path, fits: list[int], damage: str) -> None:
    with pytest.warns(ModelWarning, match="fitting capsules"):
        first = load(tmp_path).capsules
    path = kept(tmp_path)
    content = path.read_text()
    rows = json.loads(content)["content"]
    if damage == "other":  # intact, but of another robot
        path.write_text(json.dumps({"sha256": user_cache._checksum(Path("other"), rows), "content": rows}))
    elif damage == "nan":
        rows[0][4] = float("nan")
        path.write_text(json.dumps({"sha256": user_cache._checksum(path, rows), "content": rows}))
    else:
        at = content.rindex(str(rows[0][4])) if damage == "digit" else 0
        digit = content[:at] + "9" + content[at + 1 :]
        changed = {"cut": content[:-20], "digit": digit, "text": "[1, 2]", "empty": ""}
        path.write_bytes(b"\xff\xfe\x00" if damage == "bytes" else changed[damage].encode())
    with pytest.warns(ModelWarning, match="fitting capsules"):
        assert load(tmp_path).capsules == first
    assert path.read_text() == content
    assert len(fits) == 8


@pytest.mark.filterwarnings("ignore:hand:hqp.errors.ModelWarning")
def test_a_cache_that_cannot_be_written_is_told(tmp_path: Path, fits: list[int]) -> None:
    (tmp_path / "cache").write_text("in the way")
    with pytest.warns(ModelWarning, match="cannot be cached"):
        assert load(tmp_path).capsules
    assert len(fits) == 4


def test_where_the_cache_is(monkeypatch: pytest.MonkeyPatch, tmp_path: Path) -> None:
    monkeypatch.setenv("XDG_CACHE_HOME", str(tmp_path))
    assert user_cache.folder("capsules") == tmp_path / "hqp" / "capsules"
    monkeypatch.setenv("XDG_CACHE_HOME", "relative")  # its specification ignores relative paths
    monkeypatch.setattr(sys, "platform", "linux")
    assert user_cache.folder("capsules") == Path.home() / ".cache" / "hqp" / "capsules"
    monkeypatch.setattr(sys, "platform", "darwin")
    assert user_cache.folder("capsules") == Path.home() / "Library" / "Caches" / "hqp" / "capsules"
