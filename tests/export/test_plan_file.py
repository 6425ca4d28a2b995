"""The file of a plan: contents, refused files, and reports of faults."""

from __future__ import annotations

import json
import re
import subprocess
import sys
from dataclasses import dataclass
from pathlib import Path
from time import monotonic
from typing import Any

import numpy as np
import pytest

import hqp
import hqp.tasks as t
from hqp import Level, Stack, Status
from hqp.__main__ import main
from hqp.errors import DeclarationError, HqpError, UnknownReference
from hqp.export.loaded import LoadedSession
from hqp.loop.file import FORMAT, fnv1a, read, text
from hqp.solvers.lexicographic import kernel
from tests.scenes.stacks import FORMULATIONS, scene

pytestmark = pytest.mark.skipif(not kernel(), reason="no native kernel here")
ROOT = Path(__file__).parents[2]


@pytest.fixture(scope="module")
def file() -> bytes:
    return text(scene("ur5")[0])


def test_the_same_declarations_give_the_same_bytes(file: bytes, tmp_path: Path) -> None:
    session, given = scene("ur5")
    for i in range(5):
        session.step(session.robot.state(), *given(i))
    session.export(tmp_path / "ur5.hqp")
    assert (tmp_path / "ur5.hqp").read_bytes() == file
    assert read(tmp_path / "ur5.hqp")["robot"]["name"] == session.robot.name
    assert list(tmp_path.iterdir()) == [tmp_path / "ur5.hqp"]


def test_versions_are_those_of_the_package() -> None:
    source = (ROOT / "hqp/cpp/session/version.hpp").read_text()
    assert re.findall(r'kVersion = "(.*?)"', source) == [hqp.__version__]
    assert re.findall(r"kFormat = (\d+)", source) == [str(FORMAT)]


def test_other_files_are_refused_with_a_sentence(file: bytes) -> None:
    head, body = file.split(b"\n", 1)
    for other, why in (
        (b"[0]", "not a plan file"),
        (head.replace(b"format 1", b"format 2") + b"\n" + body, "format 2"),
        (re.sub(rb"version [^,]*", b"version 0.0.1", head) + b"\n" + body, "written by hqp 0.0.1"),
        (file[:-7], "cut short"),
        (file.replace(b"shoulder", b"shoulber", 1), "changed"),
        (file.replace(b", size", b", 7size", 1), "first line"),
    ):
        with pytest.raises(HqpError, match=why):
            LoadedSession(other)


@pytest.mark.long
def test_damage_behind_a_right_hash_is_refused_too(file: bytes) -> None:
    """Damage with a correct hash: the structure is checked before use, without a promise against forgery."""
    _, body = file.split(b"\n", 1)
    rng = np.random.default_rng(0)
    refused = 0
    for _ in range(300):
        at = int(rng.integers(len(body) - 8))
        try:
            LoadedSession(sealed(body[:at] + body[at + int(rng.integers(1, 8)) :]))
        except HqpError:
            refused += 1
    assert refused > 180  # the rest changes names, the fingerprint or digits


def sealed(body: bytes) -> bytes:
    """Seal a body into a file."""
    head = f"hqp plan, format {FORMAT}, version {hqp.__version__}, size {len(body)}, hash {fnv1a(body):016x}\n"
    return head.encode() + body


PLACES = {
    "body of a frame": ("motion", "operations", 0, "plan", "frame", "body"),
    "column of a frame": ("motion", "operations", 0, "plan", "frame", "columns", -1),
    "axis": ("motion", "operations", 2, "plan", "axes", -1),
    "body of a centre of mass": ("motion", "operations", 3, "plan", "part"),
    "coordinate of a joint's limits": ("motion", "operations", 5, "plan", "joints", "columns", -1),
    "place in q of a posture": ("motion", "operations", 6, "plan", "positions", -1),
    "place of a joint in q": ("motion", "joints", 1, 1),
    "place of a joint in v": ("motion", "joints", 1, 2),
    "kind of a joint": ("motion", "joints", 1, 0),
    "parent of a joint": ("motion", "joints", 1, 4, 0),
    "parent of a frame": ("motion", "frames", 0, 0),
    "parent of a body": ("motion", "bodies", 1, 0),
    "coordinate before": ("motion", "torque", "parents", -1),
    "motor": ("motion", "torque", "actuated", -1),
    "motor that brakes": ("robot", "actuated", -1),
    "levels of constraints": ("solver", "constraints"),
}


@pytest.mark.parametrize("what", PLACES)
@pytest.mark.parametrize("wild", [-1, 10_000])
def test_a_wild_place_behind_a_right_hash_is_refused(what: str, wild: int, legged: bytes) -> None:
    plan = json.loads(legged.split(b"\n", 1)[1])
    if (what, wild) == ("coordinate before", -1):
        wild = -2
    *way, last = PLACES[what]
    at = plan
    for step in way:
        at = at[step]
    at[last] = wild
    with pytest.raises(HqpError, match="plan"):
        LoadedSession(sealed(json.dumps(plan).encode()))


MISFITS: dict[str, tuple[tuple[str | int, ...], Any]] = {
    "no Jacobian": (("motion", "operations", 0, "J"), None),
    "torques of velocities": (("motion", "order"), 1),
    "a motor twice": (("motion", "torque", "actuated", 1), 6),
    "a reference that goes nowhere": (("motion", "slots", 0, "target"), None),
    "a solver of other variables": (("solver", "n"), 28),
    "motion rows as constraints": (("elements", -1, "level"), -1),
}


@pytest.mark.parametrize("what", MISFITS)
def test_parts_that_do_not_fit_each_other_are_refused(what: str, legged: bytes) -> None:
    plan = json.loads(legged.split(b"\n", 1)[1])
    (*way, last), value = MISFITS[what]
    at = plan
    for step in way:
        at = at[step]
    assert at[last] != value
    at[last] = value
    with pytest.raises(HqpError, match="plan"):
        LoadedSession(sealed(json.dumps(plan).encode()))


def test_a_reference_for_no_element_is_left_alone(legged: bytes) -> None:
    body = legged.split(b"\n", 1)[1]
    plan = json.loads(body)
    plan["motion"]["slots"][0]["name"] = "nobody"
    session = LoadedSession(sealed(json.dumps(plan).encode()))
    first = session.step(session.home)
    session.reset()
    np.testing.assert_array_equal(session.step(session.home).x, first.x)


@pytest.fixture(scope="module")
def legged() -> bytes:
    return text(scene("g1", "torque")[0])


@dataclass(frozen=True, kw_only=True)
class Mine(t.Position):
    """Position with rows written in Python."""

    def jacobian(self, state: Any) -> Any:
        return super().jacobian(state)


def test_rows_in_python_are_refused_by_name() -> None:
    robot = hqp.robots.load("ur5")
    stack = Stack(Level(Mine(frame=robot.frame_names[-1], name="mine")), Level(t.Posture()))
    with pytest.raises(DeclarationError, match="mine: cannot be exported: its rows are written in Python"):
        text(hqp.Controller(stack).session(robot, dt=0.002))
    other = hqp.Controller(Stack(Level(t.Posture())), solver="cascade").session(robot, dt=0.002)
    with pytest.raises(DeclarationError, match="solver: cannot be exported"):
        text(other)


def test_references_that_do_not_fit_are_refused(file: bytes) -> None:
    session = LoadedSession(file)
    with pytest.raises(UnknownReference, match="closest: hand"):
        session.step(session.home, None, {"hands": np.zeros(3)})
    with pytest.raises(DeclarationError, match="hand: its value needs 3 numbers"):
        session.step(session.home, None, {"hand": np.zeros(4)})
    with pytest.raises(DeclarationError, match="wrong shape"):
        session.step(np.zeros(3))


def told(tick: hqp.Tick) -> tuple[hqp.Note, ...]:
    """Notes of a tick, without those on tasks and limits from an account of the levels."""
    robot = tick.state.robot
    known = ("rates", "session", *map(robot.joint_name, range(robot.nv)))
    return tuple(n for n in tick.notes if n.status is not Status.OPTIMAL or n.element in known)


@pytest.mark.parametrize("formulation", FORMULATIONS)
def test_faults_are_statuses_as_in_python(formulation: str) -> None:
    session, given = scene("g1", formulation)
    robot = session.robot
    file = LoadedSession(text(session))
    q, v = robot.home.copy(), np.zeros(robot.nv)
    nan = {"hand": np.full(3, np.nan)}
    assert (
        told(session.step(robot.state(q, np.full(robot.nv, np.nan)))) == file.step(q, np.full(robot.nv, np.nan)).notes
    )
    for i in range(40):
        at = q.copy()
        references: tuple[hqp.Reference, ...] = given(i + 1)
        targets: dict[str, Any] = {r.name: (r.value, *([] if r.velocity is None else [r.velocity])) for r in references}
        if i in (10, 11, 12):
            at[9] = np.nan
        if i == 15:
            at[3:7] *= 1.2
        if i == 16:
            v[2] = 1e6
        if i == 17:
            v[2], at[1] = 0.0, 1e300
        if i == 18:
            at[8] = 1e6
        if i == 19:
            at[0] = 2e4
        if i == 20:
            references, targets = (hqp.Reference("hand", nan["hand"]),), dict(nan)
        tick = session.step(robot.state(at, v), *references)
        if i == 0:
            for name, value in session.hold_values.items():
                if name in file.names:
                    file.hold(name, value)
        found = file.step(at, v, targets)
        assert (found.status, found.held) == (tick.status, tick.held), f"tick {i}: {found.notes}"
        assert found.notes == told(tick), f"tick {i}"
        np.testing.assert_allclose(found.command, tick.command, rtol=1e-9, atol=1e-9, err_msg=f"tick {i}")
        if tick.status is not Status.INVALID_STATE:
            q, v = tick.advance()


@pytest.mark.parametrize("formulation", FORMULATIONS)
def test_what_cannot_hold_is_told_word_for_word(formulation: str) -> None:
    """Conflicting limits, limits under a rate limit, and contacts without load."""
    robot = hqp.robots.load("g1")
    feet = [t.FixedContact(frame=sole) for sole in robot.landmarks["soles"]]
    hand = t.Position(frame="left_rubber_hand", axes="x")
    over = [t.Within(hand, lower=1.5, name="up"), t.Within(hand, upper=-1.5, name="down")]
    posture = t.Posture(name="posture")
    stack = Stack(Level(posture), subject_to=[t.JointLimits(), *feet, *over])
    rates = hqp.RateLimits(velocity=0.05, acceleration=1e3, torque=100.0)
    session = hqp.Controller(stack, FORMULATIONS[formulation](), deadline=np.inf, rates=rates).session(robot, 0.002)
    file = LoadedSession(text(session))
    q, v = robot.home.copy(), np.zeros(robot.nv)
    seen = set()
    for i in range(30):
        aim = posture.at(robot.home[7:] + 0.3)
        references = [*(foot.at().loaded(0.1) for foot in feet), aim]
        tick = session.step(robot.state(q, v), *references)
        for name, value in session.hold_values.items() if i == 0 else ():
            if name in file.names:
                file.hold(name, value)
        for foot in feet:
            file.load(foot.name, 0.1)
        found = file.step(q, v, {"posture": aim.value})
        assert (found.status, found.notes) == (tick.status, told(tick)), f"tick {i}"
        seen |= {note.element for note in found.notes}
        q, v = tick.advance()
    assert {"rates", feet[0].name, over[0].name} <= seen


ARM = t.Position(frame="tool0", name="arm")
LIMITS: dict[str, tuple[str, Stack, str, float, str]] = {
    "alternate": (
        "ur5", Stack(Level(ARM, price=0), Level(t.Posture(), price=0), subject_to=[t.JointLimits(acceleration=None)]),
        "elbow_joint", 0.0, "alternates",
    ),
    "passed": ("ur5", Stack(Level(t.Posture()), subject_to=[t.JointLimits()]), "elbow_joint", 2.5, "rad"),
    "passed by metres": (
        "panda", Stack(Level(t.Posture()), subject_to=[t.JointLimits(acceleration=20.0)]),
        "panda_finger_joint1", 1.0, "m",
    ),
}  # fmt: skip


@pytest.mark.parametrize("formulation", FORMULATIONS)
@pytest.mark.parametrize("what", LIMITS)
def test_limits_are_told_word_for_word(what: str, formulation: str) -> None:
    """Limits between which a command alternates, and limits exceeded by a joint that cannot brake harder."""
    name, stack, joint, speed, unit = LIMITS[what]
    robot = hqp.robots.load(name)
    session = hqp.Controller(stack, FORMULATIONS[formulation](), deadline=np.inf).session(robot, 0.002)
    file = LoadedSession(text(session))
    q, v = robot.home.copy(), np.zeros(robot.nv)
    j = robot.joint_names.index(joint)
    if speed:
        q[j], v[j] = robot.upper[j] - 0.01 * speed, speed
    targets = {"arm": robot.state(q).position(ARM.frame) + [1.5, 0.0, 0.2]} if "arm" in session else {}
    seen = []
    for i in range(400 if targets else 40):
        tick, found = session.tick(q, v, targets), file.step(q, v, targets)
        assert found.notes == told(tick), f"tick {i}"
        seen += [note.detail for note in found.notes]
        q, v = tick.advance()
    assert any(unit in detail.split() for detail in seen) or (formulation, what) == ("torque", "alternate")


def test_old_states_are_refused_as_in_python(tmp_path: Path) -> None:
    source, _ = scene("ur5")
    robot = source.robot
    session = source.controller.session(robot, dt=0.002, max_age=0.01)
    file = LoadedSession(text(session))
    assert file.step(file.home).notes[0].detail == "it has no time, but max_age needs one"
    assert session.step(robot.state()).notes[0].detail.startswith(file.step(file.home).notes[0].detail)
    for now in (5.0, 5.009, 5.02, 4.9995, 4.0, np.nan):
        tick, found = session.step(robot.state(time=5.0), now=now), file.step(file.home, time=5.0, now=now)
        assert (found.status, found.notes) == (tick.status, tick.notes)
        assert found.status is (Status.OPTIMAL if 4.999 < now < 5.01 else Status.INVALID_STATE)
    assert file.step(file.home, time=monotonic()).status is Status.OPTIMAL
    session.export(tmp_path / "aged.hqp")
    assert hqp.Batch.load(tmp_path / "aged.hqp", 1).step(robot.home[None]).solved.all()


@pytest.mark.long
def test_no_pinocchio_is_needed(file: bytes, tmp_path: Path) -> None:
    (tmp_path / "ur5.hqp").write_bytes(file)
    code = (
        "import sys; sys.modules.update(dict.fromkeys(('pinocchio', 'mujoco', 'coal', 'hppfcl')))\n"
        f"import hqp, numpy as np; path = {str(tmp_path / 'ur5.hqp')!r}\n"
        "session = hqp.load(path); print(session.step(session.home).status.name)\n"
        "print(hqp.Batch.load(path, 2).step(np.tile(session.home, (2, 1))).statuses()[1].name)"
    )
    found = subprocess.run([sys.executable, "-c", code], capture_output=True, text=True, check=True)
    assert found.stdout == "OPTIMAL\nOPTIMAL\n"


def test_the_command_writes_it(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    path = tmp_path / "g1.hqp"
    assert main(["export", str(ROOT / "examples/g1.toml"), "--robot", "g1", "-o", str(path)]) == 0
    assert hqp.load(path).robot == "g1"
