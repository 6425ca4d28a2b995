"""Commands stay within the limits of the model with any rows in the stack: independent code clamps them."""

from __future__ import annotations

import math
from pathlib import Path
from typing import Any

import numpy as np
import pytest

import hqp
from hqp import PD, Controller, Level, P, Stack
from hqp.loop import compiled
from hqp.tasks import FixedContact, JointLimits, PointContact, Position, Posture
from hqp.torque.motors import OVERLOAD

DT = 0.002
FORMULATIONS = {"velocity": hqp.Velocity, "acceleration": hqp.Acceleration, "torque": hqp.Torque}
TOOLS = {"ur5": "tool0", "panda": "panda_hand_tcp", "talos": "", "g1": "", "go2": "FL_foot"}
NAMES = tuple(TOOLS)


def controller(robot: Any, kind: str, gain: float = 300.0, limits: bool = False, **more: Any) -> Controller:
    """Tool or trunk with a distant target, without joint limits."""
    law = P(gain) if kind == "velocity" else PD(gain * gain, 2.0 * gain)
    soles = robot.landmarks.get("soles", ()) if robot.floating else ()
    feet = ["FR_foot", "RL_foot", "RR_foot"] if robot.name == "go2" else []
    frame = TOOLS[robot.name] or robot.landmarks["palms"][0]
    return Controller(
        Stack(
            Level(Position(frame=frame, law=law, name="tool")),
            Level(Posture(law=P(1.0) if kind == "velocity" else PD(4.0, 4.0))),
            subject_to=[
                *(FixedContact(frame=f) for f in soles),
                *(PointContact(frame=f) for f in feet),
                *([JointLimits()] if limits else []),
            ],
        ),
        FORMULATIONS[kind](),
        deadline=math.inf,
        **more,
    )


def far(robot: Any, session: Any) -> Any:
    state = robot.copy().state(robot.home)
    frame = next(e for e in session.stack if e.name == "tool").frame
    return Position(frame=frame, name="tool").at(state.position(frame) + np.array([2.0, 1.0, 0.5]))


def excess(robot: Any, kind: str, v: Any, tick: Any) -> float:
    """Largest share of a limit that a command takes; exact stacks have no clamp at torque level."""
    motors = robot.actuated
    if kind == "torque":
        return float(np.max(np.abs(tick.command) / (OVERLOAD * robot.effort_limit[motors])))
    speed = tick.command if kind == "velocity" else v[motors] + DT * tick.command
    return float(np.max(np.abs(speed) / robot.velocity_limit[motors]))


@pytest.mark.parametrize(
    ("kind", "price"),
    [("velocity", 0), ("velocity", None), ("acceleration", 0), ("acceleration", None), ("torque", None)],
)
@pytest.mark.parametrize("name", NAMES)
def test_commands_stay_within_the_limits_of_the_model(name: str, kind: str, price: Any) -> None:
    robot = hqp.robots.load(name)
    session = controller(robot, kind, price=price).session(robot, DT)
    target, q, v, noted = far(robot, session), robot.home.copy(), np.zeros(robot.nv), False
    for _ in range(40):
        tick = session.step(robot.state(q, v), target)
        assert excess(robot, kind, v, tick) <= 1.0 + 1e-5
        noted = noted or any(note.element == "motors" for note in tick.notes)
        q, v = tick.advance()
    assert noted or kind != "velocity" or price is None


def test_a_note_names_the_motor_and_the_cure_is_declared_limits() -> None:
    robot = hqp.robots.load("ur5")
    session = controller(robot, "velocity", price=0).session(robot, DT)
    tick = session.step(robot.state(robot.home), far(robot, session))
    (note,) = (n for n in tick.notes if n.element == "motors")
    assert "rad/s, allowed 3.2 rad/s" in note.detail
    assert any(joint in note.detail for joint in robot.joint_names)
    free = controller(robot, "velocity", calm=False).session(robot, DT)
    assert excess(robot, "velocity", None, free.step(robot.state(robot.home), far(robot, free))) > 10.0


@pytest.mark.parametrize("kind", FORMULATIONS)
@pytest.mark.parametrize("name", NAMES)
def test_commands_within_the_limits_keep_their_bits(name: str, kind: str, monkeypatch: pytest.MonkeyPatch) -> None:
    robot = hqp.robots.load(name)

    def run() -> list[bytes]:
        session = controller(robot, kind, gain=3.0, limits=True).session(robot, DT)
        target, q, v, found = far(robot, session), robot.home.copy(), np.zeros(robot.nv), []
        for _ in range(15):
            tick = session.step(robot.state(q, v), target)
            found.append(tick.command.tobytes())
            q, v = tick.advance()
        return found

    checked = run()
    monkeypatch.setattr(compiled, "motor_limits", lambda *_: None)
    assert checked == run()


@pytest.mark.parametrize("kind", FORMULATIONS)
def test_files_and_batches_send_the_same(kind: str, tmp_path: Path) -> None:
    robot = hqp.robots.load("ur5")
    declared = controller(robot, kind, price=None if kind == "torque" else 0)
    session = declared.session(robot, DT)
    session.export(tmp_path / "arm.hqp")
    loaded, batch = hqp.load(tmp_path / "arm.hqp"), hqp.Batch(declared, robot, 2, dt=DT)
    target, q, v = far(robot, session), robot.home.copy(), np.zeros(robot.nv)
    for _ in range(10):
        tick = session.step(robot.state(q, v), target)
        assert np.all(tick.command == loaded.step(q, v, {"tool": target.value}).command)
        both = batch.step(np.stack((q, q)), np.stack((v, v)), {"tool": np.stack((target.value, target.value))})
        assert np.all(both.commands == tick.command)
        q, v = tick.advance()


@pytest.mark.parametrize("kind", ["velocity", "acceleration"])
def test_a_joint_that_is_too_fast_gets_no_faster(kind: str) -> None:
    robot = hqp.robots.load("ur5")
    session = controller(robot, kind, price=0).session(robot, DT)
    target, q, v = far(robot, session), robot.home.copy(), np.zeros(robot.nv)
    v[0], v[1] = 1.5 * robot.velocity_limit[0], -2.0
    for _ in range(20):
        tick = session.step(robot.state(q, v), target)
        before = v
        q, v = tick.advance()
        assert np.all(np.abs(v) <= np.maximum(robot.velocity_limit, np.abs(before)) * (1.0 + 1e-5))
