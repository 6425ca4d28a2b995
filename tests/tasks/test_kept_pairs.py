"""Pairs of links that may touch are kept in the user's cache: equal ones, in another file for other inputs."""

from __future__ import annotations

import json
from collections.abc import Callable
from pathlib import Path
from typing import Any

import pytest

import hqp
from hqp import user_cache
from hqp.tasks import CollisionAvoidance, touching
from hqp.tasks.collision_pairs import candidates
from tests.tasks.test_touching import load


def pairs(robot: Any, clearance: float = 0.02) -> Any:
    """Pairs of a process that has judged none."""
    touching._FOUND.clear()
    return candidates(CollisionAvoidance(), robot, (), "auto", clearance)


@pytest.fixture
def judged(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> list[int]:
    """Sizes of the problems that are judged, with an empty cache."""
    seen, whole = [], touching._judged

    def counted(shapes: Any, capsules: Any, apart: Any, *rest: Any) -> Any:
        seen.append(len(apart))
        return whole(shapes, capsules, apart, *rest)

    monkeypatch.setattr(touching, "_judged", counted)
    monkeypatch.setenv("XDG_CACHE_HOME", str(tmp_path / "cache"))
    return seen


def files(folder: Path) -> list[Path]:
    return sorted((folder / "cache" / "hqp" / "pairs").iterdir())


@pytest.mark.long
@pytest.mark.parametrize("name", ["ur5", "go2", "drawn 0", "drawn 1"])
def test_pairs_are_judged_once(name: str, tmp_path: Path, judged: list[int]) -> None:
    first = pairs(load(name))
    assert pairs(load(name)) == first
    assert len(judged) == len(files(tmp_path)) == 1


@pytest.mark.long
@pytest.mark.parametrize(
    ("change", "clearance"),
    [
        pytest.param(lambda robot: robot.with_capsules(robot.capsules[:-1]), 0.02, id="capsules"),
        pytest.param(lambda robot: narrowed(robot), 0.02, id="ranges"),
        pytest.param(lambda robot: robot, 0.03, id="clearance"),
    ],
)
def test_other_inputs_are_judged_anew(
    change: Callable[[Any], Any], clearance: float, tmp_path: Path, judged: list[int]
) -> None:
    robot = load("drawn 0")
    pairs(robot)
    pairs(change(robot), clearance)
    assert len(judged) == len(files(tmp_path)) == 2


def narrowed(robot: Any) -> Any:
    """The robot with half of a joint's range."""
    model = robot.model.copy()
    model.upperPositionLimit[-1] *= 0.5
    return hqp.robots.Robot(model, name=robot.name).with_capsules(robot.capsules)


@pytest.mark.long
@pytest.mark.parametrize("damage", ["empty", "cut", "changed", "other"])
def test_a_damaged_file_is_judged_anew(damage: str, tmp_path: Path, judged: list[int]) -> None:
    first = pairs(load("drawn 1"))
    (path,) = files(tmp_path)
    text = path.read_text()
    data = json.loads(text)
    data["content"][0] = data["content"][0][1:]
    path.write_text(
        {"empty": "", "cut": text[: len(text) // 2], "changed": json.dumps(data), "other": "[1, 2]"}[damage]
    )
    assert pairs(load("drawn 1")) == first
    assert len(judged) == 2
    assert path.read_text() == text


def test_other_code_judges_anew() -> None:
    """The digest is of all files, those that judge pairs and read shapes among them."""
    package = Path(hqp.__file__).parent
    assert {package / name for name in ("tasks/touching.py", "robots/surface.py", "shapes.py")} <= {
        *user_cache.source_files()
    }


@pytest.mark.long
def test_a_cache_that_cannot_be_written_costs_no_pairs(tmp_path: Path, judged: list[int]) -> None:
    (tmp_path / "cache").write_text("a file in the place of the folder")
    assert pairs(load("drawn 0")) == pairs(load("drawn 0"))
    assert len(judged) == 2
