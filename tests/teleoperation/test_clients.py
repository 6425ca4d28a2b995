"""Operators over UDP and over a websocket: what is let in, and what becomes of it."""

from __future__ import annotations

import json
import socket
import time
import urllib.error
import urllib.request
from collections.abc import Callable
from typing import Any

import numpy as np
import pytest

import hqp
from hqp import Follow, Level, Stack
from hqp.errors import DeclarationError, HqpError
from hqp.tasks import Com, Orientation, Pose, Position, Posture
from hqp.teleoperation import UdpReceiver
from hqp.teleoperation.messages import Hands

HAND = Pose(frame="tool0", name="hand")


@pytest.fixture(scope="module")
def state() -> Any:
    robot = hqp.robots.load("ur5")
    return robot.state(robot.home)


def message(shift: float = 0.0, sent: float = 0.0, **more: Any) -> dict[str, Any]:
    hand = {"position": [shift, 0.0, 0.0], "quaternion": [0.0, 0.0, 0.0, 1.0], "engaged": True}
    return {"sent": sent, "hands": {"right": hand}, **more}


def until(done: Callable[[], bool]) -> None:
    end = time.monotonic() + 60.0
    while not done():
        assert time.monotonic() < end
        time.sleep(0.005)


def test_hands_over_udp_move_the_reference(state: Any) -> None:
    follow = Follow(HAND, clutch=True)
    home = HAND.value(state)
    with UdpReceiver({"right": follow}) as receiver, socket.socket(socket.AF_INET, socket.SOCK_DGRAM) as client:
        reference = follow.reference(state)
        for i in range(60):
            told = message(1e-3 * i, i / 72.0, token=receiver.token)
            client.sendto(json.dumps(told).encode(), ("127.0.0.1", receiver.port))
            time.sleep(1.0 / 72.0)
            reference = follow.reference(state)
        until(lambda: receiver.hands.taken == 60)
        assert receiver.hands.refused == 0
    assert 0.04 < reference.value[0, 3] - home[0, 3] < 0.065
    receiver.close()


def test_without_the_token_nothing_is_taken(state: Any) -> None:
    follow = Follow(HAND)
    with UdpReceiver({"right": follow}) as receiver, socket.socket(socket.AF_INET, socket.SOCK_DGRAM) as client:
        assert receiver._socket.getsockname()[0] == "127.0.0.1"
        for told in (message(), message(token="guess"), message(token=None), {"token": receiver.token}):
            client.sendto(json.dumps(told).encode(), ("127.0.0.1", receiver.port))
        until(lambda: receiver.hands.refused == 4)
        assert receiver.hands.taken == 0
        with pytest.raises(HqpError, match="UDP port"):
            UdpReceiver({}, port=receiver.port)
    with pytest.raises(DeclarationError, match="token"):
        UdpReceiver({}, token="")


@pytest.mark.parametrize(
    "text",
    ["", "{", "[]", "1", "null", '{"hands": 3}', '{"hands": {"right": 3}}', '{"hands": {"right": {}}}',
     '{"hands": {"right": {"position": [0, 0, 0]}}}',
     '{"sent": "x", "hands": {"right": {"position": 0, "quaternion": 0}}}',
     b"\xff\xfe", "[" * 50_000, '{"hands": {}}' + " " * 70_000],
)  # fmt: skip
def test_what_is_no_message_is_refused(text: Any) -> None:
    hands = Hands({"right": Follow(HAND)})
    assert hands.take(text) is None
    assert (hands.taken, hands.refused) == (0, 1)
    assert hands.fault


def test_poses_that_are_none_reach_the_notes(state: Any) -> None:
    follow = Follow(HAND)
    hands = Hands({"right": follow})
    hands.take('{"hands": {"right": {"position": [NaN, 0, 0], "quaternion": [0, 0, 0, 1]}}}')
    hands.take('{"hands": {"right": {"position": [1, 2], "quaternion": [0, 0, 0, 1]}, "left": {}}}')
    assert hands.taken == 2
    remarks = follow.reference(state).remarks
    assert [remark[:16] for remark in remarks[:2]] == ["packet discarded"] * 2


def test_positions_and_rotations_take_their_part(state: Any) -> None:
    follows = {"place": Follow(Position(frame="tool0")), "turn": Follow(Orientation(frame="tool0"))}
    hands = Hands(follows)
    for i in range(3):
        part = {"place": {"position": [0, 0, 1]}, "turn": {"quaternion": [0, 0, 0, -1]}}
        assert hands.take(json.dumps({"sent": float(i), "hands": part}))
    for follow in follows.values():
        assert not any("left out" in remark for remark in follow.reference(state).remarks)


def test_who_moves_what() -> None:
    webxr = pytest.importorskip("hqp.teleoperation.webxr")
    left, right = Pose(frame="left_palm"), Position(frame="b", name="right hand")
    stack = Stack(Level(Com()), Level(left, right), Level(Orientation(frame="head"), Posture()))
    found = webxr.operators(stack)
    assert {side: follow.element.name for side, follow in found.items()} == {
        "left": "left_palm", "right": "right hand", "phone": "right hand",
    }  # fmt: skip
    assert webxr.operators(Stack(Level(HAND)))["right"].element is HAND
    assert webxr.operators(Stack(Level(Com()))) == {}


def test_the_page_is_for_who_has_the_address(state: Any) -> None:
    client = pytest.importorskip("websockets.sync.client")
    from hqp.teleoperation import WEBXR, OperatorPage

    follow = Follow(HAND, clutch=True, frame=WEBXR)
    home = HAND.value(state)
    with OperatorPage({"right": follow}) as page:
        with urllib.request.urlopen(page.url) as answer:
            assert b"Enter XR" in answer.read()
        bare = page.url.partition("?")[0]
        for url, code in ((bare, 403), (bare + "?token=guess", 403), (bare + "other?token=" + page.doors.token, 404)):
            with pytest.raises(urllib.error.HTTPError) as refused:
                urllib.request.urlopen(url)
            assert refused.value.code == code
        way = bare.replace("http", "ws") + "operator"
        with pytest.raises(Exception, match="403"):
            client.connect(way)
        with pytest.raises(Exception, match="403"):
            client.connect(f"{way}?token={page.doors.token}", origin="http://elsewhere.org")
        with client.connect(f"{way}?token={page.doors.token}") as connection:
            for i in range(72):
                told = message(0.0, i / 72.0)
                told["hands"]["right"]["position"] = [0.0, 0.0, -1e-3 * i]  # ahead, as WebXR has it
                connection.send(json.dumps(told))
                time.sleep(1.0 / 72.0)
                reference = follow.reference(state)
            connection.send("nonsense")
            until(lambda: page.hands.taken + page.hands.refused == 73)
        assert page.hands.refused == 1
    moved = reference.value[:3, 3] - home[:3, 3]
    assert 0.05 < moved[0] < 0.075
    assert np.abs(moved[1:]).max() < 1e-6
