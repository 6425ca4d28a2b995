"""A robot goes through each row of the table of states of docs/operation.md; arms of pages wait for resume."""

from __future__ import annotations

import ast
import re
from collections.abc import Callable
from pathlib import Path

import numpy as np
import pytest

import hqp
from hqp import Braking, Level, Stack, Status
from hqp.solvers.lexicographic import kernel
from hqp.tasks import JointLimits, Posture

pytestmark = pytest.mark.skipif(not kernel(), reason="no native kernel here")

PAGE = Path(__file__).parents[2] / "docs" / "operation.md"
HEAD = "| in | event | status of the next tick |\n|---|---|---|\n"
ROWS = [
    tuple(re.sub("`", "", cell.strip()) for cell in line.strip("|").split("|"))
    for line in PAGE.read_text(encoding="utf-8").split(HEAD)[1].partition("\n\n")[0].splitlines()
]
LEVELS = {"velocity": hqp.Velocity, "acceleration": hqp.Acceleration, "torque": hqp.Torque}
DT, AFTER = 0.002, 0.02
POSTURE = Posture()


class Operated:
    """A UR5 at rest, brought into a state of the page."""

    def __init__(self, level: str, resume: str) -> None:
        self.robot = hqp.robots.load("ur5")
        braking = Braking(resume=resume, after=AFTER)
        limits = [JointLimits()] if level == "velocity" else []
        controller = hqp.Controller(
            Stack(Level(POSTURE), subject_to=limits), LEVELS[level](), braking=braking, deadline=np.inf
        )
        self.session = controller.session(self.robot, DT, max_age=0.01, stuck=False)
        self.now = 0.0
        self.goal = self.robot.home

    def step(self, *, valid: bool = True, age: float = 0.0) -> Status:
        self.now += DT
        q = self.robot.home if valid else np.full(self.robot.nq, np.nan)
        state = self.robot.state(q, np.zeros(self.robot.nv), time=self.now - age)
        return self.session.step(state, POSTURE.at(self.goal), now=self.now).status

    def enter(self, state: str) -> None:
        """Bring the session into one of the page's states."""
        assert self.step() is Status.OPTIMAL
        if state == "stopped":
            self.session.stop("test")
            assert self.step() is Status.STOPPED
        elif state == "held":
            assert self.step(valid=False) is Status.INVALID_STATE
        else:
            assert state == "runs"

    def happens(self, event: str) -> Status:
        """Status of the tick after an event of the page."""
        session, run = self.session, self.step
        calls: dict[str, Callable[[], None]] = {
            "stop": session.stop,
            "resume": session.resume,
            "begin": lambda: session.begin(command=np.zeros(6)),
            "change": lambda: session.change(Stack(Level(POSTURE))),
        }
        ticks: dict[str, Callable[[], Status]] = {
            "a valid state": run,
            "an invalid state": lambda: run(valid=False),
            "a state older than max_age": lambda: run(age=0.011),
            "a joint does not follow": self.blocked,
        }
        if event in calls:
            calls[event]()
            return run()
        if event in ticks:
            return ticks[event]()
        assert event.startswith("no usable answer for longer than after")
        return [run(valid=False) for _ in range(round(AFTER / DT) + 1)][-1]

    def blocked(self) -> Status:
        """Status of the last tick of a second in which a far goal moves no joint."""
        self.goal = self.robot.home + 1.0
        found = [self.step() for _ in range(500)]
        return next((status for status in found if status is not Status.OPTIMAL), found[-1])


CASES = [(*row, level) for row in ROWS for level in LEVELS if (row[1], level) != ("a joint does not follow", "torque")]
"""At torque level a blocked joint looks like a load: it is a note."""


@pytest.mark.parametrize(("where", "event", "expected", "level"), CASES)
def test_every_row_of_the_table_of_states(where: str, event: str, expected: str, level: str) -> None:
    operated = Operated(level, "ask" if event.endswith('"ask"') else "auto")
    operated.enter(where)
    assert operated.happens(event) is Status[expected]


def test_the_table_has_every_state() -> None:
    assert len(ROWS) > 12
    assert {row[0] for row in ROWS} == {"runs", "held", "stopped"}
    assert {row[2] for row in ROWS} == {"OPTIMAL", "INVALID_STATE", "NOT_FOLLOWING", "STOPPED"}


def arm(call: ast.Call) -> bool:
    """Return true for a call that loads a robot with a fixed base by its name."""
    if ast.unparse(call.func) != "hqp.robots.load" or not isinstance(call.args[0], ast.Constant):
        return False
    given = [ast.literal_eval(k.value) for k in call.keywords if k.arg == "floating"]
    return not (given[0] if given else call.args[0].value in FLOATING)


def calls(text: str) -> list[ast.Call]:
    """Calls in the order of their lines."""
    found = [node for node in ast.walk(ast.parse(text)) if isinstance(node, ast.Call)]
    return sorted(found, key=lambda call: (call.lineno, call.col_offset))


def code(path: Path) -> str:
    """The Python of an example, or of a page."""
    text = path.read_text(encoding="utf-8")
    if path.suffix == ".py":
        return text
    return "\n".join(re.findall(r"^```python\n(.*?)^```", text, re.DOTALL | re.MULTILINE))


ROOT = PAGE.parents[1]
CATALOGUE = (ROOT / "hqp" / "robots" / "catalogue.toml").read_text(encoding="utf-8")
FLOATING = {"cbi", "dreamer", *re.findall(r"^\[(\w+)\]\n(?:[^\[\n].*\n)*?floating = true", CATALOGUE, re.MULTILINE)}
SOURCES = [*(ROOT / "examples").glob("*.py"), *(ROOT / "docs").glob("*.md"), ROOT / "README.md"]
ARMS = [path for path in SOURCES if any(arm(call) for call in calls(code(path)))]


def test_there_are_arms_on_pages_and_in_examples() -> None:
    assert {"README.md", "tutorial-arm.md", "teleoperation.md", "operation.md", "arm_reach.py"} <= {
        p.name for p in ARMS
    }


@pytest.mark.parametrize("path", ARMS, ids=lambda path: path.name)
def test_arms_of_pages_and_examples_ask_before_they_return(path: Path) -> None:
    loaded = False  # true if an arm was loaded last
    for call in calls(code(path)):
        if ast.unparse(call.func) == "hqp.robots.load":
            loaded = arm(call)
        if ast.unparse(call.func) == "hqp.Controller" and loaded:
            braking = [ast.unparse(k.value) for k in call.keywords if k.arg == "braking"]
            assert len(braking) == 1, ast.unparse(call)
            assert re.search(r"Braking\(resume='ask'", braking[0]), ast.unparse(call)
