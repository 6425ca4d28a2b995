"""Every example runs as for a user."""

from __future__ import annotations

import importlib.util
import math
import os
import re
from pathlib import Path

import pytest

import hqp
import hqp.tasks
from hqp.declare.element import REGISTRY
from tests.examples.playing import play

EXAMPLES = Path(__file__).parents[2] / "examples"
ELSEWHERE = {"ros2_node"}
"""Examples that need what no index has: test_ros.py."""
NEEDS = {
    "aloha": "gym_aloha",
    "hand_with_cube": "gymnasium_robotics",
    "pink_g1": "pink",
    "stretch": "stretch_urdf",
    "tidybot": "robosuite",
    "view_g1": "viser",
    "walkers_in_gymnasium": "gymnasium",
    "yumi": "robosuite_models",
}
ARGUMENTS = {"view_g1": ["2"]}
CORPUS = Path(os.environ.get("HQP_CORPUS", "build/corpus")).absolute()
MODELS = {
    "aloha": "gym_aloha/assets",
    "hand_with_cube": "gymnasium_robotics/envs/assets/hand/manipulate_block.xml",
    "stretch": "stretch_urdf/SE3/stretch_description_SE3_eoa_wrist_dw3_tool_sg3.urdf",
    "tidybot": "robosuite/models/assets",
    "yumi": "robosuite_models/assets/robots/yumi/robot.xml",
}
"""Models of other packages, which ``make corpus`` fetches."""


LONG = {
    "ball_shoulders", "lean_on_a_table", "lift_a_foot", "moving_balls", "quadruped_paw", "two_arms_apart", "waiter",
    "walk_talos", "walkers_in_gymnasium",
}  # fmt: skip
"""Examples with long motions."""
PROGRAMS = [
    pytest.param(path, id=path.stem, marks=[pytest.mark.slow] if path.stem in LONG else [])
    for path in sorted(EXAMPLES.glob("*.py"))
    if path.stem not in ELSEWHERE
]


def test_there_are_a_dozen() -> None:
    assert len(list(EXAMPLES.glob("*.py"))) - len(ELSEWHERE) >= 12


@pytest.mark.parametrize("name", sorted(REGISTRY))
def test_every_element_is_in_a_program_and_has_a_picture(name: str) -> None:
    if not hasattr(hqp.tasks, name):
        pytest.skip("a test's own")
    used = re.compile(rf"\b{name}\(|, {name}, ")
    assert any(used.search(path.read_text().split("import hqp", 1)[1]) for path in EXAMPLES.glob("*.py"))
    pages = [page.read_text() for page in (EXAMPLES.parent / "docs/elements").glob("*.md") if page.stem != "in-files"]
    shown = re.compile(rf"^(#|\|)[^\n]*\b{name}\b.*?!\[", re.MULTILINE | re.DOTALL)
    assert any(shown.search(page) for page in pages)


@pytest.mark.parametrize("path", PROGRAMS)
def test_it_runs(path: Path, tmp_path: Path) -> None:
    if path.stem in NEEDS and importlib.util.find_spec(NEEDS[path.stem]) is None:
        pytest.skip(f"needs {NEEDS[path.stem]}")
    run(path, tmp_path, *ARGUMENTS.get(path.stem, []))


@pytest.mark.parametrize("path", sorted(EXAMPLES.glob("*.toml")), ids=lambda path: path.stem)
def test_the_stacks_of_the_readme_run_on_the_robot_they_are_named_after(path: Path) -> None:
    robot = hqp.robots.load(path.stem)
    tick = hqp.Controller(hqp.serial.load(path), deadline=math.inf).session(robot, 0.002).step(robot.state())
    assert tick.status.name == "OPTIMAL"


@pytest.mark.corpus
@pytest.mark.parametrize("name", MODELS)
def test_it_runs_on_the_model_of_its_package(name: str, tmp_path: Path) -> None:
    if not (CORPUS / MODELS[name]).exists():
        pytest.skip("no corpus here: make corpus")
    run(EXAMPLES / f"{name}.py", tmp_path, str(CORPUS / MODELS[name]))


def run(path: Path, folder: Path, *arguments: str) -> None:
    status, printed = play(path, folder, *arguments)
    assert status == 0, printed
    assert printed.strip()
