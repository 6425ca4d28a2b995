"""Operators over UDP and over a websocket: accepted messages and their effect."""

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


def guide(follow: Follow, state: Any, send: Callable[[float, float], None]) -> Any:
    """Rest until the reference follows, move 6 cm within 0.8 s, and rest there; return the final reference.

    Stamps are real times, and the function awaits the end: a busy machine takes longer.
    """
    home, begin = HAND.value(state), float("inf")
    end = time.monotonic() + 60.0
    while (now := time.monotonic()) < end:
        u = min(max((now - begin) / 0.8, 0.0), 1.0)
        send(0.06 * u * u * (3.0 - 2.0 * u), now)
        reference = follow.reference(state)
        if begin > now and not reference.remarks:
            begin = now
        if u == 1.0 and abs(np.linalg.norm(reference.value[:3, 3] - home[:3, 3]) - 0.06) < 1e-3:
            break
        time.sleep(1.0 / 72.0)
    return reference


def test_hands_over_udp_move_the_reference(state: Any) -> None:
    follow = Follow(HAND, clutch=True, max_age=5.0)  # delays of a busy machine are no silence
    home = HAND.value(state)
    with UdpReceiver({"right": follow}) as receiver, socket.socket(socket.AF_INET, socket.SOCK_DGRAM) as client:

        def send(shift: float, sent: float) -> None:
            told = message(shift, sent, token=receiver.token)
            client.sendto(json.dumps(told).encode(), ("127.0.0.1", receiver.port))

        reference = guide(follow, state, send)
        assert receiver.hands.refused == 0
    assert reference.value[:3, 3] - home[:3, 3] == pytest.approx([0.06, 0.0, 0.0], abs=2e-3)
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

    follow = Follow(HAND, clutch=True, frame=WEBXR, max_age=5.0)
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

            def send(shift: float, sent: float) -> None:
                told = message(0.0, sent)
                told["hands"]["right"]["position"] = [0.0, 0.0, -shift]  # ahead, in WebXR's axes
                connection.send(json.dumps(told))

            reference = guide(follow, state, send)
            connection.send("nonsense")
            until(lambda: page.hands.refused == 1)
    assert reference.value[:3, 3] - home[:3, 3] == pytest.approx([0.06, 0.0, 0.0], abs=2e-3)


def grip(engaged: Any = True, **more: Any) -> str:
    told = message(**more)
    if engaged is None:
        del told["hands"]["right"]["engaged"]
    else:
        told["hands"]["right"]["engaged"] = engaged
    return json.dumps(told)


@pytest.mark.parametrize("engaged", [None, "true", "false", 1, [], {}])
def test_a_hand_is_engaged_only_if_its_message_says_true(state: Any, engaged: Any) -> None:
    follow = Follow(HAND, clutch=True)
    hands = Hands({"right": follow})
    for i in range(5):
        assert hands.take(grip(engaged, shift=0.01 * i, sent=0.01 * i))
    assert "the clutch is open: held" in follow.reference(state).remarks


def test_one_sender_controls_until_another_takes_over(state: Any) -> None:
    """Drawn messages of three senders: one sender controls, and only "take_over" changes the sender in control."""
    rng = np.random.default_rng(0)
    follow = Follow(HAND, clutch=True)
    hands, holder, sent = Hands({"right": follow}), None, 0.0
    for _ in range(500):
        sent += 0.01
        sender, leaves, takes = int(rng.integers(1, 4)), rng.random() < 0.05, rng.random() < 0.1
        if leaves:
            hands.leave(sender)
            holder = None if holder == sender else holder
            continue
        if takes or holder is None:
            holder = sender
        more: dict[str, Any] = {"take_over": True} if takes else {}
        taken = hands.take(grip(sent=sent, **more), sender)
        assert (taken is not None) == (holder == sender)
        assert taken or "another operator controls" in hands.fault
        follow.reference(state)


@pytest.mark.parametrize("take_over", [None, 1, "true", "false", []])
def test_only_true_takes_over(take_over: Any) -> None:
    hands = Hands({"right": Follow(HAND)})
    assert hands.take(grip(), 1)
    assert hands.take(grip(take_over=take_over), 2) is None
    assert hands.take(grip(), 1)


@pytest.mark.parametrize("how", ["takes over", "comes after"])
def test_a_new_operator_needs_a_new_squeeze(state: Any, how: str, monkeypatch: pytest.MonkeyPatch) -> None:
    """The robot's hand does not move on while a grip is closed that began before its operator had control."""
    now = 100.0
    monkeypatch.setattr("hqp.teleoperation.follow.monotonic", lambda: now)
    follow = Follow(HAND, clutch=True, max_age=5.0)
    hands, home = Hands({"right": follow}), HAND.value(state)

    def act(sender: int, begin: int, engaged: bool, **more: Any) -> Any:
        nonlocal now
        for i in range(begin, begin + 30):
            t = i / 72.0
            now = 100.0 + t
            hands.take(grip(engaged, shift=2e-3 * i, sent=t, **more), sender)
            found = follow.reference(state)
        return found.value[0, 3] - home[0, 3]

    assert act(1, 0, True) > 0.02
    if how == "comes after":
        hands.leave(1)
    before = act(2, 30, True, take_over=how == "takes over")
    assert abs(act(2, 60, True) - before) < 0.02
    act(2, 90, False)
    assert act(2, 120, True) > 0.02


def test_a_second_page_is_told_who_controls(state: Any) -> None:
    client = pytest.importorskip("websockets.sync.client")
    from hqp.teleoperation import WEBXR, OperatorPage

    with OperatorPage({"right": Follow(HAND, clutch=True, frame=WEBXR)}) as page:
        way = f"{page.url.partition('?')[0].replace('http', 'ws')}operator?token={page.doors.token}"
        with client.connect(way) as one, client.connect(way) as two:
            one.send(grip())
            until(lambda: page.hands.taken == 1)
            two.send(grip())
            assert "another operator controls" in json.loads(two.recv(timeout=30.0))["refused"]
            two.send(grip(take_over=True))
            assert json.loads(two.recv(timeout=30.0))["refused"] == ""
            one.send(grip())
            assert "another operator controls" in json.loads(one.recv(timeout=30.0))["refused"]
            two.close()
            until(lambda: page.hands.controlling is None)
            one.send(grip())
            assert json.loads(one.recv(timeout=30.0))["refused"] == ""


def test_the_operators_page_listens_where_it_is_told() -> None:
    pytest.importorskip("websockets")
    from hqp.teleoperation import OperatorPage

    with socket.socket() as free:
        free.bind(("127.0.0.1", 0))
        port = free.getsockname()[1]
    with OperatorPage({"right": Follow(HAND)}, port=port) as page:
        assert f":{port}/" in page.url
        with socket.create_connection(("127.0.0.1", port), timeout=5.0):
            pass
        with pytest.raises(HqpError, match="did not start"):
            OperatorPage({"right": Follow(HAND)}, port=port)
