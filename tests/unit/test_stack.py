from __future__ import annotations

import math
from pathlib import Path

import pytest

from hqp import Level, P, Price, Stack, serial
from hqp.declare.law import PD
from hqp.errors import DeclarationError
from hqp.tasks import Com, FixedContact, JointLimits, Orientation, Position, Posture


def example() -> Stack:
    return Stack(
        Level(FixedContact(frame="l_sole"), Com(axes="xy", law=P(2.0), name="com_xy"), name="critical"),
        Level(Position(frame="r_palm", law=P(5.0, max_velocity=0.5), weight=2.0)),
        Level(Posture(joints=["B_TR", "B_TAA"], law=P((1.0, 2.0)))),
        subject_to=[JointLimits()],
    )


def test_prints_as_the_paper_writes_it() -> None:
    assert str(example()) == "l_sole + com_xy > r_palm > posture   s.t. joint_limits"


def test_names_default_to_frames_and_are_unique() -> None:
    with pytest.raises(DeclarationError, match="duplicate name"):
        Stack(Level(Position(frame="r_palm")), Level(Orientation(frame="r_palm")))
    assert Position(frame="r_palm").name == "r_palm"
    assert JointLimits().name == "joint_limits"


@pytest.mark.parametrize(
    ("make", "message"),
    [
        (lambda: Stack(), "empty"),
        (lambda: Stack(Level()), "empty"),
        (lambda: Stack(Position(frame="a")), "not a Level"),
        (lambda: Level("hand"), "not a task"),
        (lambda: Stack(Level(Posture()), subject_to=["limits"]), "not a task"),
        (lambda: Position(frame="a", weight=0.0), "weight"),
        (lambda: Position(frame="a", weight=math.nan), "weight"),
        (lambda: Position(frame="a", law=2.0), "law"),
        (lambda: Com(axes="xw"), "axes"),
    ],
)
def test_bad_declarations(make: object, message: str) -> None:
    with pytest.raises(DeclarationError, match=message):
        make()  # type: ignore[operator]


def test_find_without_replace() -> None:
    stack = example()
    hand = stack.find("r_palm", Position)
    assert hand.weight == 2.0
    with pytest.raises(DeclarationError, match=r"r_palm"):
        stack.find("r_pam")
    with pytest.raises(DeclarationError, match="Position"):
        stack.find("r_palm", Com)
    assert "r_palm" not in stack.without("r_palm")
    assert len(stack.without("r_palm").levels) == 2
    assert stack.with_laws({"r_palm": P(1.0)}).find("r_palm").law == P(1.0)
    assert stack == example()
    assert hash(stack) == hash(example())
    assert stack != stack.without("com_xy")


def test_round_trip_through_toml() -> None:
    stack = example()
    assert serial.from_dict(serial.to_dict(stack)) == stack
    assert serial.loads(serial.dumps(stack)) == stack
    fast = Stack(Level(Posture(law=PD(100.0))))
    assert serial.loads(serial.dumps(fast)) == fast


@pytest.mark.parametrize("price", [None, 0, Price(tau=0.07), Price(turning=False), Price()], ids=repr)
def test_prices_of_levels_are_kept_in_files(price: Price | int | None, tmp_path: Path) -> None:
    priced = Level(Position(frame="r_palm"), name="hand", price=price)
    stack, path = Stack(priced, Level(Posture())), tmp_path / "stack.toml"
    path.write_text(serial.dumps(stack), encoding="utf-8")
    for found in (serial.from_dict(serial.to_dict(stack)), serial.load(path)):
        assert found == stack
        assert found.levels[0].price == priced.price
        assert found.levels[1].price is None


def test_a_turning_that_is_no_bool_is_refused() -> None:
    with pytest.raises(DeclarationError, match=r"Price\.turning"):
        Price(turning=0.5)  # type: ignore[arg-type]


@pytest.mark.parametrize(
    ("text", "message"),
    [
        ("[[level", "not TOML"),
        ("[[levels]]\nname = 'a'", "unknown key"),
        ("[[level]]\n[[level.element]]\ntype = 'Positon'", "closest: .*Position"),
        ("[[level]]\n[[level.element]]\ntype = 'Position'\nframes = 'a'", "unknown key"),
        ("[[level]]\n[[level.element]]\ntype = 'Position'", "frame"),
        ("[[level]]\n[[level.element]]\ntype = 'Posture'\nlaw = { type = 'PID' }", "P, PD"),
    ],
)
def test_bad_files_are_explained(text: str, message: str) -> None:
    with pytest.raises(DeclarationError, match=message):
        serial.loads(text)


def test_missing_file() -> None:
    with pytest.raises(DeclarationError, match="cannot be read"):
        serial.load("nowhere.toml")
