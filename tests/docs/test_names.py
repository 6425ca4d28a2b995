"""Every name of hqp in the prose of README and docs exists at the named place."""

from __future__ import annotations

import importlib
import re
from pathlib import Path
from typing import Any

import pytest

import hqp
from hqp import Level, Stack
from hqp.errors import HqpError
from hqp.tasks import Posture

ROOT = Path(__file__).parents[2]
PAGES = [ROOT / "README.md", *sorted((ROOT / "docs").rglob("*.md"))]
CODE = re.compile(r"^```.*?^```", re.MULTILINE | re.DOTALL)
DOTTED = re.compile(r"`(hqp(?:\.\w+)+)[(`]")
CLASS = re.compile(r"`([A-Z][a-z]+(?:[A-Z]\w*)?)[(`]")
MEMBER = re.compile(r"`(robot|session|state|stack|tick)\.(\w+)")
PUBLIC = (
    "hqp", "hqp.tasks", "hqp.robots", "hqp.errors", "hqp.estimation", "hqp.recorder", "hqp.sweep", "hqp.declare.plans",
    "hqp.motion", "hqp.policies", "hqp.walking", "hqp.teleoperation",
)  # fmt: skip
OTHERS = {  # classes of pink, mink, placo, tsid and roboplan, of the kernel's C++, values of Python
    "ComTask", "ConfigurationLimit", "DynamicsSolver", "False", "FrameTask", "MinkTask", "None", "Operation",
    "PinkTask", "PostureTask", "RobotWrapper", "SimpleIk", "TaskComEquality", "TaskJointBounds", "TaskJointPosture",
    "TaskSE3Equality", "True", "VelocityLimit",
}  # fmt: skip
EXTRAS = {"gymnasium", "isaacteleop", "mujoco", "viser"}


def prose(page: Path) -> str:
    return CODE.sub("", page.read_text(encoding="utf-8"))


def find(dotted: str) -> Any:
    """Import the object of a dotted name; raise ImportError if there is none."""
    value: Any = hqp
    parts = dotted.split(".")
    for k, part in enumerate(parts[1:], start=2):
        try:
            value = getattr(value, part)
        except AttributeError:
            value = importlib.import_module(".".join(parts[:k]))
    return value


def find_or_skip(dotted: str) -> None:
    """Find a dotted name; skip modules whose extra is missing here."""
    try:
        find(dotted)
    except (ModuleNotFoundError, HqpError) as error:
        missing = error if isinstance(error, ModuleNotFoundError) else error.__cause__
        if not isinstance(missing, ModuleNotFoundError) or missing.name not in EXTRAS:
            raise


@pytest.fixture(scope="module")
def things() -> dict[str, Any]:
    robot, stack = hqp.robots.load("cbi"), Stack(Level(Posture()))
    session = hqp.Controller(stack).session(robot, dt=0.002)
    state = robot.state()
    return {"robot": robot, "stack": stack, "session": session, "state": state, "tick": session.step(state)}


@pytest.mark.parametrize("page", PAGES, ids=lambda p: p.name)
def test_names_in_prose_can_be_imported(page: Path) -> None:
    for name in sorted(set(DOTTED.findall(prose(page)))):
        find_or_skip(name)


@pytest.mark.parametrize("page", PAGES, ids=lambda p: p.name)
def test_classes_in_prose_are_where_a_reader_looks(page: Path) -> None:
    modules = [importlib.import_module(name) for name in PUBLIC]
    for name in sorted(set(CLASS.findall(prose(page))) - OTHERS):
        assert any(hasattr(module, name) for module in modules), f"{page.name}: {name}"


@pytest.mark.parametrize("page", PAGES, ids=lambda p: p.name)
def test_members_in_prose_are_those_of_their_class(page: Path, things: dict[str, Any]) -> None:
    for thing, name in sorted(set(MEMBER.findall(prose(page)))):
        assert hasattr(things[thing], name), f"{page.name}: {thing}.{name}"


def test_public_names_can_be_had() -> None:
    for module in (hqp, hqp.robots):
        for name in module.__all__:
            assert getattr(module, name) is not None


def test_the_api_page_has_every_public_name() -> None:
    told = re.findall(r"^::: (\S+)$", (ROOT / "docs" / "api.md").read_text(encoding="utf-8"), re.MULTILINE)
    assert len(told) == len(set(told))
    for name in told:
        find_or_skip(name)
    short = {name.rpartition(".")[2] for name in told} | set(hqp.errors.__dict__)
    elsewhere = {"robots", "tasks", "recorder", "estimation", "sweep"}  # modules whose names are listed one by one
    assert {*hqp.__all__, *hqp.robots.__all__} - elsewhere <= short
