"""Phases that follow one another by time, measured loads, errors and signals; late phases get a note."""

from __future__ import annotations

from typing import Any

import numpy as np
import pytest

import hqp
import hqp.robots
import hqp.tasks as t
from hqp import Level, Phase, Sequence, Stack, Status, serial
from hqp.declare.robot import Robot
from hqp.errors import DeclarationError
from hqp.sequence import loaded, near, signal, unloaded

DT = 0.01
HAND = t.Position(frame="r_palm", name="hand")
LEFT = t.FixedContact(frame="l_sole", name="left", when=("stand", "land"))
RIGHT = t.FixedContact(frame="r_sole", name="right")
STACK = Stack(Level(HAND, when="swing"), Level(t.Posture()), subject_to=[LEFT, RIGHT])
STEPS = Sequence(
    Phase(name="stand", after=0.03),
    Phase(name="swing", after=0.02, until=loaded("left", 40.0), within=0.1, late="stop"),
    Phase(name="land", until=signal("go")),
    Phase(name="stop"),
)


@pytest.fixture(scope="module")
def robot() -> Robot:
    return hqp.robots.load("cbi")


def begin(robot: Robot, sequence: Sequence = STEPS, **actions: Any) -> Any:
    session = hqp.Controller(STACK, hqp.Velocity()).session(robot, DT)
    return sequence.run(session, **actions)


def walked(run: Any, robot: Robot, loads: list[float]) -> list[tuple[str, str]]:
    ticks = [run.step(robot.state(robot.home), LEFT.at().loaded(load)) for load in loads]
    assert all(tick.status is Status.OPTIMAL for tick in ticks)
    return [(tick.phase, tick.event) for tick in ticks]


def test_times_and_loads_lead_on(robot: Robot) -> None:
    """A phase lasts ``after``, then until the contact bears its load; elements switch with it."""
    run = begin(robot)
    found = walked(run, robot, [50.0] * 3 + [0.0] * 3 + [39.0, 41.0])
    assert found == [
        ("stand", "stand"), ("stand", ""), ("stand", ""), ("swing", "swing"), ("swing", ""), ("swing", ""),
        ("swing", ""), ("land", "land"),
    ]  # fmt: skip
    assert run.session.program.out == {"hand"}
    run.signal("go")
    assert walked(run, robot, [50.0]) == [("stop", "stop")]
    assert run.session.program.out == {"hand", "left"}


def test_what_does_not_come_in_time_is_told_once(robot: Robot) -> None:
    run = begin(robot)
    found = walked(run, robot, [50.0] * 3 + [0.0] * 11 + [100.0])
    assert found[13] == ("stop", "late swing")
    assert [event for _, event in found] == ["stand", *["" for _ in range(2)], "swing", *[""] * 9, "late swing", ""]
    alone = Sequence(Phase(name="stand"), Phase(name="swing", until=near("hand", 0.5), within=0.02), Phase(name="land"))
    run = begin(robot, alone)
    run.go("swing")
    far = HAND.at(robot.state(robot.home).position("r_palm") + [0.9, 0.0, 0.0])
    events = [run.step(robot.state(robot.home), far).event for _ in range(5)]
    assert events == ["swing", "", "late swing", "", ""]
    assert run.step(robot.state(robot.home), HAND.at()).event == "land"


def test_actions_are_called_at_entry_and_exit(robot: Robot) -> None:
    said: list[tuple[str, float]] = []
    run = begin(
        robot,
        entry={"swing": lambda state: said.append(("in", run.since))},
        exit={"stand": lambda state: said.append(("out", round(run.since, 9)))},
    )
    walked(run, robot, [50.0] * 5)
    assert said == [("out", 0.03), ("in", 0.0)]


def test_an_invalid_state_does_not_age_a_phase(robot: Robot) -> None:
    run = begin(robot)
    run.step(robot.state(robot.home))
    for _ in range(10):
        tick = run.step(robot.state(np.full(robot.nq, np.nan)))
        assert (tick.phase, tick.status) == ("stand", Status.INVALID_STATE)
    assert run.since == 0.0


def test_files_hold_sequences_beside_stacks() -> None:
    text = serial.dumps(STACK) + "\n" + serial.dumps_phases(STEPS)
    assert serial.loads(text) == STACK
    assert serial.loads_phases(text) == STEPS
    assert hash(serial.loads_phases(text)) == hash(STEPS)
    assert 'until = { type = "loaded", name = "left", newtons = 40.0 }' in text
    with pytest.raises(DeclarationError, match="unknown type"):
        serial.loads_phases('[[phase]]\nname = "a"\nuntil = { type = "lost" }')
    with pytest.raises(DeclarationError, match="unknown key"):
        serial.loads_phases('[[phase]]\nname = "a"\nuntill = 3')


def test_names_that_are_not_there_are_refused(robot: Robot) -> None:
    stand = Phase(name="stand"), Phase(name="swing"), Phase(name="land")
    for phases, text in (
        ((*stand, Phase(name="x", to="stnd")), "unknown phase"),
        ((*stand, Phase(name="x", until=loaded("hand", 1.0))), "unknown contact"),
        ((*stand, Phase(name="x", until=near("hands", 1.0))), "unknown element"),
        (stand[:2], "unknown phase"),
        ((*stand, Phase(name="stand")), "duplicate name"),
        ((), "no phases"),
    ):
        with pytest.raises(DeclarationError, match=text):
            begin(robot, Sequence(*phases))
    with pytest.raises(DeclarationError, match="unknown phase"):
        begin(robot, entry={"jump": print})
    for bad in ({"after": -1.0}, {"within": np.nan}, {"until": "loaded"}, {"late": "x"}, {"after": True}):
        with pytest.raises(DeclarationError):
            Phase(name="x", **bad)  # type: ignore[arg-type]
    assert unloaded("left", 5.0) != loaded("left", 5.0)


def test_a_phase_without_support_is_refused(robot: Robot) -> None:
    """A phase that the stack does not name switches off every element with a ``when``."""
    feet = [t.FixedContact(frame=f"{side}_sole", name=side, when="stand") for side in "lr"]
    stack = Stack(Level(t.Posture()), subject_to=feet)
    session = hqp.Controller(stack, hqp.Torque(holding=None)).session(robot, DT)
    Sequence(Phase(name="stand")).run(session)
    with pytest.raises(DeclarationError, match="phase fly: without l, r constraints and actuators do not determine"):
        Sequence(Phase(name="stand"), Phase(name="fly")).run(session)
