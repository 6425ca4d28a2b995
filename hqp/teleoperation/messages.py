"""Messages of an operator's client, over UDP or a websocket: the poses of hands as JSON."""

from __future__ import annotations

import json
import secrets
from collections.abc import Hashable, Mapping
from typing import Any

from .follow import Follow

LARGEST = 65_536
"""Longer messages are refused [bytes]."""


class Hands:
    """Packets of named hands to the sources of references that follow them; nothing in a message raises.

    A message is an object with ``hands``: by name ``position`` (3 numbers [m]), ``quaternion`` (x, y, z, w; not needed
    for a Position), ``engaged`` (false without it); and ``sent`` [s], on any clock of the client's.  A hand that nobody
    follows is passed over.  One sender controls: the first one, until it leaves or another one sends ``take_over``
    true; then the clutches open until a new squeeze.  token: required value of the field ``token``, empty for any.
    taken, refused: numbers of messages; fault: why the last one was refused; controlling: the sender that controls.
    """

    def __init__(self, follows: Mapping[str, Follow], token: str = "") -> None:
        self._follows, self._token = dict(follows), token.encode()
        self.taken, self.refused, self.fault = 0, 0, ""
        self.controlling: Hashable | None = None

    def take(self, text: str | bytes, sender: Hashable = "") -> dict[str, Any] | None:
        """Take a message; return its content, None if it was refused.

        sender: the connection or address it came from.
        """
        try:
            if len(text) > LARGEST:
                raise ValueError("too long")
            message = json.loads(text)
            if self._token and not secrets.compare_digest(str(message["token"]).encode(), self._token):
                raise ValueError("another token")
            hands = message["hands"]
            self._admit(sender, message.get("take_over") is True)
            for name, hand in hands.items():
                follow = self._follows.get(name)
                if follow is not None:
                    follow.receive(self._value(follow, hand), **self._about(message, hand))
        except (ValueError, TypeError, KeyError, AttributeError, RecursionError, OverflowError) as error:
            self.refused, self.fault = self.refused + 1, f"{type(error).__name__}: {error}"[:200]
            return None
        self.taken += 1
        found: dict[str, Any] = message
        return found

    def leave(self, sender: Hashable) -> None:
        """Open the clutches if this sender controls; the next one that sends does."""
        if self.controlling == sender:
            self._hand_over(None, "the operator left")

    def _admit(self, sender: Hashable, takes_over: bool) -> None:
        """Raise ValueError for a sender that does not control."""
        if self.controlling is None:
            self.controlling = sender
        elif self.controlling != sender:
            if not takes_over:
                raise ValueError('another operator controls: send "take_over": true to take over')
            self._hand_over(sender, "another operator took over")

    def _hand_over(self, sender: Hashable | None, reason: str) -> None:
        self.controlling = sender
        for follow in self._follows.values():
            follow.disengage(reason)

    @staticmethod
    def _value(follow: Follow, hand: Mapping[str, Any]) -> Any:
        if follow.takes == "rotation":
            return hand["quaternion"]
        return (hand["position"], hand["quaternion"]) if follow.takes == "pose" else hand["position"]

    @staticmethod
    def _about(message: Mapping[str, Any], hand: Mapping[str, Any]) -> dict[str, Any]:
        sent = message.get("sent")
        return {"sent": None if sent is None else float(sent), "engaged": hand.get("engaged", False)}
